"""The gate: so many random scenes, each flown and judged by a worker process, and one table of what
was found."""

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import tomli_w

from oracles.random_scenes.compare import FAULTS
from oracles.random_scenes.draft import Tree
from oracles.random_scenes.scenes import LATE
from oracles.random_scenes.workers import LIMIT_S, Job, Worker, judge_all
from sepmc.engine.dispatch import progress_reporter
from sepmc.scene.messages import InputError, nearest

CASES = 3  # rows of a scene
_EVERY_S = 10.0  # between words on how far it is
_DOORS = 8  # one scene in so many goes through the other doors too
_COLUMNS = ("same", "told", "tie", "refused", *FAULTS)
Found = dict[str, Any]


def gate(
    count: int,
    seed: int = 0,
    compiled: int = 0,
    say: Callable[[str], None] = print,
    cases: int = CASES,
    limit_s: float = LIMIT_S,
    kinds: Iterable[str] = (),
) -> list[Found]:
    """Judge the scenes of seeds ``seed`` to ``seed + count``.

    Parameters
    ----------
    count, seed : how many, and the first. A seed gives the same scene whatever the others are
    compiled : how many of them, the first ones, fly compiled as well
    say : told a line for every scene that fails, and now and then how far it is
    cases : rows of a scene that are flown and compared
    limit_s : a scene that takes longer as plain Python gets no verdict, and is told; compiled, at
        least `workers.COMPILED_LIMIT_S`
    kinds : later kinds (`oracles.random_scenes.scenes.LATE`) that every scene has, beside what it
    draws

    Returns
    -------
    verdicts : `oracles.random_scenes.compare.Verdict` as dicts, in the order of seeds
    """
    kinds = list(kinds)
    for kind in kinds:
        if kind not in LATE:
            raise InputError(f"--kind: {kind!r} is no kind of random scenes; {nearest(kind, LATE)}")
    usual: Job = {"cases": cases, "kinds": kinds}
    jobs: list[Job] = [
        {**usual, "seed": number, "doors": number % _DOORS == 0}
        for number in range(seed, seed + count)
    ]
    jobs += [
        {**usual, "seed": n, "compiled": True, "name": f"seed {n}, compiled"}
        for n in range(seed, seed + min(compiled, count))
    ]
    found: list[Found] = []
    tell = progress_reporter(say, _EVERY_S)

    def so_far(seconds: float) -> str:
        failing, left = sum(map(fails, found)), sum(bool(v.get("not_flown")) for v in found)
        others = f", {left} not compared" if left else ""
        return f"{len(found)} of {len(jobs)} flown in {seconds:.0f} s, {failing} fail{others}"

    for verdict in judge_all(jobs, limit_s=limit_s):
        found.append(verdict)
        if fails(verdict):
            say("\n".join(sentences(verdict)))
        tell(so_far)
    return sorted(found, key=lambda v: (v["seed"], v["name"]))


def fails(verdict: Found) -> bool:
    """Whether judging a scene crashed or found a fault."""
    return bool(verdict["crash"]) or any(verdict["rows"].get(fault) for fault in FAULTS)


def sentences(verdict: Found) -> list[str]:
    """What is wrong with a scene, and how it was flown."""
    lines = [f"  {line}" for line in verdict["said"]]
    return [f"{verdict['name']}, {_drive(verdict)}: {verdict['crash'] or 'rows differ'}", *lines]


def _drive(verdict: Found) -> str:
    return "compiled" if verdict.get("compiled") else "interpreted"


def shrunk(tree: Tree, compiled: bool = False, cases: int = CASES, most: int = 150) -> Tree:
    """A smaller tree that fails in the same way, found by a worker process."""
    worker = Worker(limit_s=3600.0)
    try:
        answer = worker.judge(
            {"tree": tree, "name": "shrunk", "shrink": most, "cases": cases, "compiled": compiled}
        )
    finally:
        worker.close()
    return answer["tree"] if answer else tree


def keep(tree: Tree, path: Path, verdict: Found) -> None:
    """Write a failing scene as a campaign file that says what differed."""
    said = "".join(f"# {line}\n" for line in sentences(verdict))
    path.write_text(said + tomli_w.dumps(tree), encoding="utf-8")


def table(verdicts: Iterable[Found]) -> str:
    """Rows and faults by how the scene was flown and by what it has, the worst agreement, the seeds
    that fail."""
    verdicts = list(verdicts)
    flown = [v for v in verdicts if not v.get("not_flown")]
    groups: dict[str, list[Found]] = {"all": flown}
    for v in flown:
        groups.setdefault(_drive(v), []).append(v)
    for feature in sorted({f for v in flown for f in v.get("features", [])}):
        groups[feature] = [v for v in flown if feature in v.get("features", [])]
    text = [
        f"{'scenes with':30s}{'scenes':>8s}"
        + "".join(f"{c:>9s}" for c in _COLUMNS)
        + f"{'crashes':>9s}"
    ]
    for name, group in groups.items():
        rows: Counter[str] = sum((Counter(v["rows"]) for v in group), Counter())
        crashes = sum(bool(v["crash"]) for v in group)
        text.append(
            f"{name:30s}{len(group):8d}"
            + "".join(f"{rows[c]:9d}" for c in _COLUMNS)
            + f"{crashes:9d}"
        )
    statuses: Counter[str] = sum((Counter(v.get("statuses", {})) for v in flown), Counter())
    text += ["", "statuses: " + ", ".join(f"{n} {label}" for label, n in statuses.most_common())]
    text += [_worst(flown)] if any(v.get("rows") for v in flown) else []
    reasons: dict[str, list[int]] = {}
    for v in verdicts:
        if v.get("not_flown"):
            reasons.setdefault(v["not_flown"][:100], []).append(v["seed"])
    for reason, seeds in sorted(reasons.items(), key=lambda item: -len(item[1])):
        named = ", ".join(map(str, seeds[:8])) + (", ..." if len(seeds) > 8 else "")
        text.append(f"not compared: {len(seeds)} x {reason} (seeds {named})")
    failing = sorted({v["seed"] for v in flown if fails(v)})
    text.append(
        f"{len(flown)} of {len(verdicts)} scenes were compared, "
        + (
            f"{len(failing)} FAIL, seeds {', '.join(map(str, failing))}"
            if failing
            else "none fails"
        )
    )
    return "\n".join(text)


def _worst(flown: list[Found]) -> str:
    """The row that agrees least of those that agree, in shares of what its run reports."""
    off = max(flown, key=lambda v: v.get("worst", 0.0) / max(v.get("reported", 0.0), 1e-9))
    missed = sum(not v.get("met", True) for v in flown)
    said = (
        f"worst agreement: {off.get('worst', 0.0):.1e} where {off.get('reported', 0.0):.1e} is "
        f"reported ({off['name']})"
    )
    return f"{said}; {missed} scenes say that their accuracy is not met"
