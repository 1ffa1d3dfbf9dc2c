"""Run folders, random damage to their files, and checks of what ``sepmc doctor`` does about it."""

import contextlib
import json

from click.testing import CliRunner

from sepmc.campaign.store import folders, manifests, shards
from sepmc.cli import app

# runs that store all rows, and runs that count cases and store some rows
RUNS = {"rows": (), "counts": ("--keep", "failed,every:5")}
SETTINGS = {"run.chunk": 4, "run.history_step_s": 0.1}
WAYS = ("deleted", "cut short", "flipped", "swapped", "edited", "grown")


def make_run(folder, *words):
    """Run a small campaign that writes files of all kinds; returns its folder."""
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
    """Paths of the files of a run, relative to its folder."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def damage(folder, rng):
    """Damage one or two files of a run folder; returns the kind of damage and the files."""
    way, name = str(rng.choice(WAYS)), str(rng.choice(files(folder)))
    path = folder / name
    content = bytearray(path.read_bytes())
    if way == "deleted":
        path.unlink()
    elif way == "cut short":
        path.write_bytes(content[: int(rng.integers(0, len(content)))])
    elif way == "flipped":
        for position in rng.integers(0, len(content), int(rng.integers(1, 65))):
            content[position] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(content)
    elif way == "swapped":
        other = str(rng.choice([one for one in files(folder) if one != name]))
        path.write_bytes((folder / other).read_bytes())
        (folder / other).write_bytes(content)
        name = f"{name} and {other}"
    elif way == "edited":  # another digit
        digits = [k for k, byte in enumerate(content) if 48 <= byte <= 57]
        position = int(rng.choice(digits)) if digits else 0
        content[position] = 48 + (content[position] - 47) % 10
        path.write_bytes(content)
    else:
        path.write_bytes(content + rng.bytes(int(rng.integers(1, 100))))
    return way, name


def rows(folder):
    """All rows and histories as bytes; None if the folder is refused."""
    try:
        read = shards.read_cases(folder), shards.read_histories(folder)
    except folders.StoreError:
        return None
    return tuple(b"" if frame is None else frame.to_json().encode() for frame in read)


def contents(folder):
    """Contents that a repaired folder must have: all but times of day and of work."""
    result = {name: (folder / name).read_bytes() for name in files(folder)}
    del result[folders.MANIFEST], result[shards.ledger.LEDGER]
    return result


def parsed(contents):
    """Contents of files, the manifest parsed: other last digits of its numbers may mean the same
    bits."""
    parsed_files = dict(contents)
    with contextlib.suppress(KeyError, ValueError):
        parsed_files[folders.MANIFEST] = json.loads(parsed_files[folders.MANIFEST])
    return parsed_files


def is_reported(folder, before, expected):
    """True if damage is reported, or had no effect, and no other numbers are read than before."""
    changed = parsed({name: (folder / name).read_bytes() for name in files(folder)}) != parsed(
        before
    )
    reported = manifests.diagnose(folder)
    result = rows(folder)
    return (bool(reported) or not changed) and (
        result is None or result == expected or bool(reported)
    )


def is_repaired(folder, before):
    """True if ``--repair`` restores all files but the campaign, and refuses where manifest and all
    shards are damaged, so that nothing tells what the campaign was."""
    path, known = folder / folders.CAMPAIGN, bool(manifests.read_provenance(folder))
    code = call("doctor", str(folder), "--repair", "--quiet")
    if not known or not path.is_file() or path.read_bytes() != before[folders.CAMPAIGN]:
        return code == 2
    return code == 0 and contents(folder) == before
