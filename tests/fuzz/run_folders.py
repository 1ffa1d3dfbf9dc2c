"""Run folders: damaged, forged with valid checksums, with links, pipes and huge files; the commands
that read them, and the files beside them."""

import json
import math
import os
import pickle
import shutil

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
from click.testing import CliRunner

from fuzz import mutate
from fuzz.places import scratch
from fuzz.tables import _METADATA, damage
from fuzz.watch import Wrong, turns
from sepmc.campaign.store import folders, ledger, manifests
from sepmc.cli import app
from sepmc.scene.messages import InputError

_SETTINGS = ["--set=run.chunk=4", "--set=run.history_step_s=0.1"]
_NEW = (
    "manifest.json.tmp", "checksums.jsonl.tmp", "campaign.toml.tmp", "statistics.csv.tmp",
    "cases/part-0000000099.parquet", "cases/part-0000000004.parquet.tmp", "report.html",
    "sensitivity.csv", "causes.csv", "distributions.csv", "samples.parquet", "history.parquet",
    "separation.png",
    "cases", "histories",
)  # fmt: skip
_LONG = ("replay", "campaign", "run", "compare", "plot", "report")  # these commands run or plot


def run_folders(rng, count, until, tried):
    """Changed run folders, each read by a command."""
    with scratch() as place:
        whole = _whole(place)
        for number in turns(count, until, tried):
            kind = rng.choice(("cases", "cases", "cases", "single", "plan", "stats"))
            at = place / str(number)
            folder = shutil.copytree(whole[kind], at / "run")
            _outside(at)
            done = [_change(folder, at / "outside", rng) for _ in range(rng.choice((1, 1, 2)))]
            words = _command(rng, folder, whole["cases"])
            before = _listing(at, folder)
            limit = 60.0 if words[0] in _LONG or "--repair" in words else 5.0
            said = (kind, done, [w.replace(str(at), "") for w in words])
            tried.look(said, lambda words=words: call(words), limit)
            if _listing(at, folder) != before:
                tried.found("written outside of the run", said)
            shutil.rmtree(at, ignore_errors=True)


def call(words):
    """Run a command; raises InputError if it refuses, other errors as they are."""
    done = CliRunner().invoke(app.main, words)
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    if "Traceback" in done.output or "\x1b" in done.output or "Warning:" in done.output:
        raise Wrong(f"printed: {done.output[-300:]}")
    if done.exit_code == 2:
        raise InputError(done.output[-200:].replace("\0", "?") or "nothing is said")


def _whole(place):
    """Intact runs of every kind."""
    whole = place / "whole"
    runs = {kind: whole / kind for kind in ("cases", "single", "plan", "stats")}
    fly = ["campaign", "table2.toml", "--cases", "14", "--quiet", "--no-plots", *_SETTINGS]
    one = ["run", "table1.toml", "--every-s", "0.05", "--quiet", "--no-plots"]
    plan = str(place / "plan.csv")
    for words in (
        [*fly, "--out", str(runs["cases"])],
        [*one, "--out", str(runs["single"])],
        ["sample", "table2.toml", "--cases", "8", "--out", plan],
        [*fly[:2], "--samples", plan, "--quiet", "--no-plots", "--out", str(runs["plan"])],
        [*fly, "--stats-only", "--out", str(runs["stats"])],
    ):
        done = CliRunner().invoke(app.main, words)
        if done.exit_code:
            raise RuntimeError(done.output) from done.exception
    return runs


def _outside(at):
    """Create files beside a run, which must not change."""
    outside = at / "outside"
    (outside / "cases").mkdir(parents=True)
    (outside / "file").write_text("precious\n")
    (outside / "part-0000000000.parquet").write_text("precious\n")
    (outside / "cases" / "part-0000000000.parquet").write_text("precious\n")
    (outside / "cases" / "part-0000000004.parquet.tmp").write_text("precious\n")


def _listing(at, folder):
    """Names, sizes and contents of all files beside a run."""
    return [
        (str(path), path.read_bytes() if path.is_file() else b"")
        for path in sorted(at.rglob("*"))
        if path != folder
        and folder not in path.parents
        and (at / "new") not in (path, *path.parents)
    ]


def _command(rng, folder, other):
    run, out = str(folder), str(folder.parent / "new")
    ways = (
        (10, ["stats", run]),
        (4, ["stats", run, "--json"]),
        (4, ["stats", run, "--where", "upper_pitch_deg>0"]),
        (8, ["doctor", run]),
        (6, ["doctor", run, "--repair", "--quiet"]),
        (5, ["replay", run, "--case", "3", "--every-s", "0.1", "--no-plots", "--out", out]),
        (3, ["replay", run, "--min", "separation_distance_mm", "--no-plots", "--out", out]),
        (6, ["campaign", run, "--out", run, "--resume", "--no-plots", "--quiet"]),
        (3, ["campaign", run, "--out", run, "--overwrite", "--no-plots", "--quiet"]),
        (4, ["compare", run, str(other)]),
        (4, ["compare", str(other), run, "--out", out]),
        (4, ["sensitivity", run, "--no-plots"]),
        (4, ["fit", run]),
        (3, ["run", run, "--case", "2", "--every-s", "0.1", "--no-plots", "--out", out]),
        (3, ["check", run, "--no-flight"]),
        (0.5, ["plot", run]),
        (0.2, ["report", run, "--quiet", "--no-replay"]),
    )
    return list(rng.choices([way for _, way in ways], [weight for weight, _ in ways])[0])


def _change(folder, outside, rng):
    ways = (
        _bytes,
        _link,
        _link,
        _odd,
        _manifest,
        _ledger,
        _table,
        _table,
        _damaged,
        _campaign,
        _vast,
    )
    way = rng.choice(ways)
    try:
        said = way(folder, outside, rng)
    except (
        OSError,
        pa.ArrowException,
        ValueError,
        RecursionError,
        folders.StoreError,
    ) as error:  # changed before
        said = f"not done: {error}"
    return f"{way.__name__[1:]} {said}"


def _any(folder, rng, kind="*"):
    """A file of a run, of some kind."""
    files = sorted(p for p in folder.rglob(kind) if _is_own(p))
    if not files:
        raise OSError(f"no {kind} left")
    return rng.choice(files)


def _bytes(folder, _, rng):
    path = _any(folder, rng)
    damage(rng, path)
    return path.name


def _link(folder, outside, rng):
    names = [p.relative_to(folder).as_posix() for p in folder.rglob("*")]
    path = folder / rng.choice((*names, *_NEW))
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    elif os.path.lexists(path):
        path.unlink()
    to = rng.choice(
        (outside / "file", outside, outside / "cases", "/dev/zero", "/dev/null", path,
         outside / "new", "../outside/file")
    )  # fmt: skip
    path.parent.mkdir(exist_ok=True)
    path.symlink_to(to)
    return f"{path.name} -> {to}"


def _odd(folder, outside, rng):
    """Replace a file by a pipe or a folder, remove it, or add a second name; replace a folder by a
    file."""
    path = rng.choice([*sorted(folder.rglob("*")), *(folder / name for name in _NEW)])
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
        path.write_bytes(b"")
        return f"file {path.name}"
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    way = rng.choice(("pipe", "folder", "gone", "second name", "empty"))
    if way == "pipe":
        os.mkfifo(path)
    elif way == "folder":
        path.mkdir()
    elif way == "second name":
        os.link(outside / "file", path)
    elif way == "empty":
        path.write_bytes(b"")
    return f"{way} {path.name}"


def _manifest(folder, _, rng):
    path = _own(folder / folders.MANIFEST)
    said = json.loads(path.read_text())
    made = _Values()
    for _ in range(rng.choice((1, 1, 2, 4))):
        said = made.change(said, rng)
    if rng.random() < 0.03:
        path.write_text("[" * 100_000)
        return "deep"
    if isinstance(said, dict):
        _seal(folder, said)
    return repr(said)[:60]


class _Values(mutate.Trees):
    """Changes of the values of a tree."""

    def __init__(self):
        self.words = ["cases", "digest", "case", "numbers", "of", "seed", "until", "sha256", "x"]
        values = {"case": [3, None], "stats_only": [True, 1], "numbers": ["0:1000000000", "3,,"],
                  "complete": [False, "no"], "cases": [10**15, -1, "x"], "of": [10**15],
                  "sessions": [[], [{}]], "notes": ["x", ["\x1b[2J"]],
                  "seed": [None, 2**62]}  # fmt: skip
        self.values = {key: [pickle.dumps(x) for x in some] for key, some in values.items()}


def _is_own(path):
    return path.is_file() and not path.is_symlink() and path.stat().st_size < 10**8


def _own(path):
    """True for a file that may be read and written: not a link out of the folder."""
    if not _is_own(path):
        raise OSError("changed already")
    return path


def _entries(folder):
    """Entries of the list of files of a run, by path."""
    entries = {}
    for line in _own(folder / ledger.LEDGER).read_bytes().splitlines():
        try:
            one = msgspec.json.decode(line.rpartition(b" ")[0], type=ledger.Entry)
        except (msgspec.MsgspecError, ValueError):
            continue
        entries[one.file] = one
    return entries


def _seal(folder, manifest):
    """Write a manifest with valid checksums."""
    campaign = ledger.checksum(_own(folder / folders.CAMPAIGN).read_bytes())
    files = _entries(folder).values()
    sealed = manifest | {"files": len(files), "files_sha256": ledger.digest(files)}
    if "campaign_sha256" in manifest:
        sealed["campaign_sha256"] = campaign
    try:
        text = json.dumps({**sealed, "sha256": manifests._checksum_of(sealed)}, default=str)
    except (ValueError, TypeError, OverflowError):
        return
    _own(folder / folders.MANIFEST).write_text(text)


def _reseal(folder, entries=None):
    """Write valid checksums of all files, or of some entries."""
    if entries is None:
        entries = []
        for one in _entries(folder).values():
            path = folder / one.file
            if _is_own(path):
                entries.append(ledger.make_entry(one.file, path.read_bytes(), one.first, one.cases))
    _own(folder / ledger.LEDGER).write_text("".join(one.line for one in entries))
    _seal(folder, json.loads(_own(folder / folders.MANIFEST).read_text()))


def _ledger(folder, outside, rng):
    entries = list(_entries(folder).values())
    if not entries:
        return "none"
    place = rng.randrange(len(entries))
    one = entries[place]
    names = ("../outside/file", str(outside / "file"), "cases/../../outside/file",
             "cases/x/../y", "", ".", "..", "cases", "a\0b", "manifest.json", "x" * 5000, "C:\\x",
             "histories/part-0000000000.parquet", "\x1b[2J",
             "cases/part-0000000000.parquet")  # fmt: skip
    numbers = (0, -1, 1, 5, 10**9, 10**15, 2**62, 2**63, one.cases + 1, one.first + 1)
    way = rng.choice(("file", "first", "cases", "bytes", "sha256", "twice", "text"))
    if way == "file":
        entries[place] = msgspec.structs.replace(one, file=rng.choice(names))
    elif way == "twice":
        entries.append(msgspec.structs.replace(one, file=one.file + "x"))
    elif way == "sha256":
        entries[place] = msgspec.structs.replace(one, sha256="x")
    elif way == "text":
        said = rng.choice((b"{}", b"[]", b"null", b'{"file": 1}', b"\xff", b"[" * 20_000, b""))
        line = said + b" " + ledger.checksum(said)[:16].encode() + b"\n"
        with open(_own(folder / ledger.LEDGER), "ab") as file:
            file.write(line)
        return f"text {said[:20]}"
    else:
        entries[place] = msgspec.structs.replace(one, **{way: rng.choice(numbers)})
    _reseal(folder, entries)
    return f"{way} {entries[place]!r}"[:80]


def _damaged(folder, _, rng):
    path = _any(folder, rng, "*.parquet")
    damage(rng, path)
    _reseal(folder)
    return path.name


def _table(folder, _, rng):
    """Another table with a valid checksum."""
    path = _any(folder, rng, "*.parquet")
    table = pq.read_table(path)
    names, way = (
        table.column_names,
        rng.choice(
            (
                "drop",
                "rename",
                "type",
                "null",
                "rows",
                "text",
                "metadata",
                "swap",
                "many",
                "none",
                "nan",
            )
        ),
    )
    place = rng.choice((0, 1, 2, rng.randrange(len(names)))) % len(names)
    if way == "drop":
        table = table.remove_column(place)
    elif way == "rename":
        names[place] = rng.choice((*mutate.NAMES, names[0], "x"))
        table = table.rename_columns(names)
    elif way in ("type", "text", "null", "nan"):
        n = table.num_rows
        column = {
            "type": pa.array([rng.choice((1.5, None, math.inf))] * n),
            "text": pa.array([rng.choice(("ok", "x", "", "\x1b[2J", None))] * n, pa.string()),
            "null": pa.nulls(n, table.schema.field(place).type),
            "nan": pa.array([math.nan] * n),
        }[way]
        table = table.set_column(place, names[place], column)
    elif way == "rows":
        table = table.slice(rng.randrange(3), rng.randrange(5))
    elif way == "swap":
        table = table.take(pa.array(list(reversed(range(table.num_rows)))))
    elif way == "metadata":
        table = table.replace_schema_metadata(
            {**(table.schema.metadata or {}), **rng.choice(_METADATA),
             rng.choice((b"tally", b"digest", b"seed", b"numbers")):
             rng.choice((b"", b"{}", b"[" * 9999, b"\xff", b'{"failures": "x"}', b"1e9", b"0:5"))}
        )  # fmt: skip
    elif way == "many":
        table = pa.table({name: pa.array([0.0] * 3_000_000) for name in names[:3]})
    else:
        table = pa.table({})
    if way == "none" and rng.random() < 0.5:
        table = table.schema.empty_table()
    pq.write_table(table, path)
    _reseal(folder)
    return f"{way} {names[place]!r} of {path.name}"


def _campaign(folder, _, rng):
    path = _own(folder / folders.CAMPAIGN)
    made = mutate.Trees.__new__(mutate.Trees)
    made.texts, made.weights = [path.read_text()], [1.0]
    path.write_bytes(made.text(rng))
    _reseal(folder)
    return "text"


def _vast(folder, _, rng):
    path = folder / rng.choice(
        ("manifest.json", "checksums.jsonl", "campaign.toml", "samples.parquet", "sensitivity.csv",
         "statistics.json", "history.parquet", "cases/part-0000000000.parquet", "statistics.csv")
    )  # fmt: skip
    path.parent.mkdir(exist_ok=True)
    if os.path.lexists(path):
        _own(path)
    with open(path, "r+b" if path.exists() else "wb") as file:
        file.truncate(rng.choice((2**30, 2**34, 2**40)))
    if rng.random() < 0.3 and path.suffix == ".parquet":
        entries = {one.file: one for one in _entries(folder).values()}
        name = path.relative_to(folder).as_posix()
        entries[name] = ledger.Entry(name, path.stat().st_size, "0" * 64, 0, 4)
        _reseal(folder, entries.values())
    return f"{path.name} {path.stat().st_size}"
