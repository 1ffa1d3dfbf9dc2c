"""Campaign files: parsed, validated, written and parsed again; and the kernels generated for
them."""

import ast
import json
import re
import tomllib
from pathlib import Path

from fuzz import mutate
from fuzz.watch import Wrong, turns
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import diagnostics, runner, step_selection
from sepmc.campaign.store.sample_file import read_input_table
from sepmc.kernel.spec import describe
from sepmc.scene.messages import SceneError
from sepmc.scene.read import parse_campaign, read_text

_TABLES = ("body", "joint", "motor", "spring", "load", "phase", "release", "event", "clearance")


def parse(tree):
    """Campaign of a tree, with all properties that follow from its numbers."""
    campaign = Campaign(parse_campaign(tree, "fuzz.toml", reader=read_input_table))
    _ = campaign.layout, campaign.columns, campaign.slots, campaign.digest
    return campaign


def trees(rng, count, until, tried):
    """Structural changes: keys and values deleted, duplicated, renamed, exchanged, copied from
    elsewhere."""
    made = mutate.Trees()
    for _ in turns(count, until, tried):
        tree = made.changed(rng)
        campaign = tried.look(tree, lambda tree=tree: parse(tree))
        if campaign is not None and rng.random() < 0.2:
            tried.look(tree, lambda c=campaign: again(c))
        if campaign is not None and rng.random() < 0.02:
            tried.look(tree, lambda c=campaign: checked(c))


def texts(rng, count, until, tried):
    """Text changes: bytes flipped, removed, duplicated, copied from another file."""
    made = mutate.Trees()
    for _ in turns(count, until, tried):
        text = made.text(rng)
        tried.look(text, lambda text=text: parse(read_text(text, "fuzz.toml")))


def sizes(rng, count, until, tried):
    """Large inputs: many bodies, rows, values of a distribution; deep trees; long words."""
    for _ in turns(count, until, tried):
        what, tree = mutate.huge(rng)
        campaign = tried.look(what, lambda tree=tree: parse(tree))
        if campaign is not None:
            tried.look(what, lambda c=campaign: again(c))
            tried.look(what, lambda c=campaign: drawn(c))


def kernels(rng, count, until, tried):
    """Kernels generated for files with recognisable names."""
    made = mutate.Trees()
    for number in turns(count, until, tried):
        tree = made.any(rng) if number % 2 else made.changed(rng)
        try:
            renamed, names = rename(tree, rng)
            campaign = parse(renamed)
        except (SceneError, ValueError):
            tried.counts["not renamed"] += 1
            continue
        tried.look(renamed, lambda c=campaign, n=names: written(c, n), 60.0)


def again(campaign):
    """Check that a written campaign is the same when read again."""
    text = campaign.file.toml
    tree = tomllib.loads(text)
    other = Campaign(parse_campaign(tree, "again.toml", reader=read_input_table))
    same = (
        repr(other.scene) == repr(campaign.scene)
        and repr(other.file.dispersions) == repr(campaign.file.dispersions)
        and other.digest == campaign.digest
        and other.file.requirements == campaign.file.requirements
        and other.file.copulas == campaign.file.copulas
    )
    if not same:
        raise Wrong("another campaign comes back from its text")


def drawn(campaign):
    """Sample the first cases of a campaign, unless more are requested than allowed."""
    campaign.select_cases()
    table = campaign.in_si(campaign.sample(0, min(64, campaign.scene.run.cases)))
    if table.shape[1] != len(campaign.file.dispersions):
        raise Wrong("other columns are drawn")


def checked(campaign):
    """Run the checks of ``sepmc check`` without a simulation."""
    drawn(campaign)
    numbers, total = campaign.select_cases()
    describe.lines(campaign.layout)
    step_selection.stage_names(step_selection.kernel_spec(campaign))
    diagnostics.file_notes(campaign)
    list(diagnostics.sampling_notes(campaign, numbers))
    runner.implausible_note(campaign.implausible_inertias(campaign.sample(0, 1, None, total)), 1)


def rename(tree, rng):
    """Tree with names that occur nowhere else, and these names."""
    names, text = {}, json.dumps(tree, default=str)
    for table in _TABLES:
        items = tree.get(table, {})
        own = items if isinstance(items, dict) else [
            x.get("name") for x in items if isinstance(x, dict)
        ] if isinstance(items, list) else []  # fmt: skip
        for name in own:
            if isinstance(name, str) and name.isidentifier() and name not in mutate_words():
                names.setdefault(name, f"Zq{rng.randrange(10**6)}w{len(names)}")
    for old, new in names.items():
        text = re.sub(rf'(?<=["._]){re.escape(old)}(?=["._])', new, text)
    renamed = json.loads(text)
    renamed["title"] = "Zqtitle __import__('os')"
    return renamed, list(names.values())


_words = set()


def mutate_words():
    """Words of the format: names equal to one of them cannot be recognised."""
    if not _words:
        for path in sorted((mutate.ROOT / "sepmc" / "scene").glob("*.py")):
            _words.update(re.findall(r"\w+", path.read_text(encoding="utf-8")))
    return _words


def written(campaign, names):
    """Check that the kernel of a campaign contains no name of its file."""
    text = step_selection.kernel_text(campaign, history=campaign.has_histories)
    ast.parse(text)
    body = text.split('"""', 2)[2]
    if "Zq" in body or "__import__" in body or any(name in body for name in names):
        raise Wrong("a name of the file is in its kernel")
    for name in (*campaign.scene.body, *campaign.scene.joint):
        if len(name) > 8 and re.search(rf"\b{re.escape(name)}\b", body):
            raise Wrong(f"{name} of the file is in its kernel")
    if Path(text.splitlines()[0]).is_absolute():
        raise Wrong("a path")
