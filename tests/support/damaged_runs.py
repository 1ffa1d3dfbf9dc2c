"""Run folders, random damage to their files, and checks of what ``sepmc doctor`` does about it."""

import contextlib
import json

from click.testing import CliRunner

from sepmc.campaign.store import folders, manifests, shards
from sepmc.cli import app

# runs that keep all rows, and ones that count and keep some
RUNS = {"rows": (), "counts": ("--keep", "failed,every:5")}
SETTINGS = {"run.chunk": 4, "run.history_step_s": 0.1}
WAYS = ("deleted", "cut short", "flipped", "swapped", "edited", "grown")


def fly(folder, *words):
    """A small run with all kinds of files that it has, by further words of a command; returns
    it."""
    settings = [f"--set={path}={value}" for path, value in SETTINGS.items()]
    words = ["--cases", "14", "--quiet", "--out", str(folder), *settings, *words]
    assert call("campaign", "table2.toml", *words) == 0
    return folder


def call(*words):
    """Exit code of a command."""
    done = CliRunner().invoke(app.main, words)
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code


def files(folder):
    """Files of a run, by their paths in it."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def damage(folder, rng):
    """Damage a file of a run folder, or two; returns how, and which."""
    way, name = str(rng.choice(WAYS)), str(rng.choice(files(folder)))
    path = folder / name
    content = bytearray(path.read_bytes())
    if way == "deleted":
        path.unlink()
    elif way == "cut short":
        path.write_bytes(content[: int(rng.integers(0, len(content)))])
    elif way == "flipped":
        for place in rng.integers(0, len(content), int(rng.integers(1, 65))):
            content[place] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(content)
    elif way == "swapped":
        other = str(rng.choice([one for one in files(folder) if one != name]))
        path.write_bytes((folder / other).read_bytes())
        (folder / other).write_bytes(content)
        name = f"{name} and {other}"
    elif way == "edited":  # a digit is another
        digits = [k for k, byte in enumerate(content) if 48 <= byte <= 57]
        place = int(rng.choice(digits)) if digits else 0
        content[place] = 48 + (content[place] - 47) % 10
        path.write_bytes(content)
    else:
        path.write_bytes(content + rng.bytes(int(rng.integers(1, 100))))
    return way, name


def rows(folder):
    """All rows and histories, as bytes; None if the folder is refused."""
    try:
        read = shards.read_cases(folder), shards.read_histories(folder)
    except folders.StoreError:
        return None
    return tuple(b"" if frame is None else frame.to_json().encode() for frame in read)


def contents(folder):
    """What a mended folder must have again: all but times of day and of work."""
    found = {name: (folder / name).read_bytes() for name in files(folder)}
    del found[folders.MANIFEST], found[shards.ledger.LEDGER]
    return found


def meant(contents):
    """What files say: a manifest whose numbers are written with another last digit may be the same
    to the last bit."""
    said = dict(contents)
    with contextlib.suppress(KeyError, ValueError):
        said[folders.MANIFEST] = json.loads(said[folders.MANIFEST])
    return said


def is_reported(folder, before, was):
    """Whether a damage is told, or did nothing, and no other numbers are read than before."""
    changed = meant({name: (folder / name).read_bytes() for name in files(folder)}) != meant(before)
    told = manifests.diagnose(folder)
    found = rows(folder)
    return (bool(told) or not changed) and (found is None or found == was or bool(told))


def is_repaired(folder, before):
    """Whether ``--repair`` brings back all but the campaign that was flown, and refuses where
    nothing tells any more what that was: the manifest and every part are damaged."""
    path, known = folder / folders.CAMPAIGN, bool(manifests.read_provenance(folder))
    code = call("doctor", str(folder), "--repair", "--quiet")
    if not known or not path.is_file() or path.read_bytes() != before[folders.CAMPAIGN]:
        return code == 2
    return code == 0 and contents(folder) == before
