"""Run of random scenes: each simulated and judged by a worker process, with one table of the
verdicts."""

from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from oracles.random_scenes.compare import FAULTS
from oracles.random_scenes.scenes import LATE
from oracles.random_scenes.workers import LIMIT_S, Job, judge_all
from sepmc.engine.dispatch import progress_reporter
from sepmc.scene.messages import InputError, nearest

CASES = 3  # compared per scene
_EVERY_S = 10.0  # between progress messages
_ENTRY_POINTS = 8  # entry points are compared in one scene of so many
_COLUMNS = ("same", "flagged", "tie", "refused", *FAULTS)
VerdictDict = dict[str, Any]


def judge_scenes(
    count: int,
    seed: int = 0,
    compiled: int = 0,
    log: Callable[[str], None] = print,
    cases: int = CASES,
    limit_s: float = LIMIT_S,
    kinds: Iterable[str] = (),
) -> list[VerdictDict]:
    """Judge the scenes of seeds ``seed`` to ``seed + count``.

    Parameters
    ----------
    count, seed : int
        Number of scenes, and the first seed. The scene of a seed does not depend on the others.
    compiled : int
        The first so many scenes run compiled as well.
    log : callable
        Called with the faults of every scene that fails, and from time to time with the progress.
    cases : int
        Rows of a scene that are compared.
    limit_s : float
        Time for an interpreted scene; one that takes longer is compiled, and counted there. A
        compiled one has at least `workers.COMPILED_LIMIT_S`; one that takes longer gets no
        verdict, and is reported.
    kinds : iterable of str
        Kinds of `oracles.random_scenes.scenes.LATE` that every scene has in addition.

    Returns
    -------
    list of dict
        `oracles.random_scenes.compare.Verdict` as dicts, in the order of seeds; after Ctrl-C those
        of the scenes judged until then.

    Raises
    ------
    InputError
        If a kind is unknown.
    """
    kinds = list(kinds)
    for kind in kinds:
        if kind not in LATE:
            raise InputError(f"--kind: unknown kind {kind!r}; {nearest(kind, LATE)}")
    common: Job = {"cases": cases, "kinds": kinds}
    jobs: list[Job] = [
        {**common, "seed": number, "entry_points": number % _ENTRY_POINTS == 0}
        for number in range(seed, seed + count)
    ]
    jobs += [
        {**common, "seed": n, "compiled": True, "name": f"seed {n}, compiled"}
        for n in range(seed, seed + min(compiled, count))
    ]
    finished: list[VerdictDict] = []
    progress = progress_reporter(log, _EVERY_S)

    def progress_text(seconds: float) -> str:
        """Progress as a sentence."""
        failing = sum(map(fails, finished))
        not_compared = sum(bool(v.get("not_flown")) for v in finished)
        others = f", {not_compared} not compared" if not_compared else ""
        return f"{len(finished)} of {len(jobs)} judged in {seconds:.0f} s, {failing} fail{others}"

    with suppress(KeyboardInterrupt):  # the table is then that of the scenes judged so far
        for verdict in judge_all(jobs, limit_s=limit_s):
            finished.append(verdict)
            if fails(verdict):
                log("\n".join(report_lines(verdict)))
            progress(progress_text)
    return sorted(finished, key=lambda v: (v["seed"], v["name"]))


def fails(verdict: VerdictDict) -> bool:
    """True if judging a scene crashed or found a fault."""
    return bool(verdict["crash"]) or any(verdict["rows"].get(fault) for fault in FAULTS)


def report_lines(verdict: VerdictDict) -> list[str]:
    """Lines on the faults of a scene."""
    lines = [f"  {line}" for line in verdict["said"]]
    return [f"{verdict['name']}, {_drive(verdict)}: {verdict['crash'] or 'rows differ'}", *lines]


def _drive(verdict: VerdictDict) -> str:
    """Engine drive of a verdict."""
    return "compiled" if verdict.get("compiled") else "interpreted"


def table(verdicts: Iterable[VerdictDict]) -> str:
    """Text table of rows and faults by drive and by feature, the worst agreement, and the seeds
    that fail."""
    verdicts = list(verdicts)
    judged = [v for v in verdicts if not v.get("not_flown")]
    groups: dict[str, list[VerdictDict]] = {"all": judged}
    for v in judged:
        groups.setdefault(_drive(v), []).append(v)
    for feature in sorted({f for v in judged for f in v.get("features", [])}):
        groups[feature] = [v for v in judged if feature in v.get("features", [])]
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
    late = sum(bool(v.get("late")) for v in verdicts)
    if late:
        text += ["", f"{late} scenes were compiled since they took too long interpreted"]
    statuses: Counter[str] = sum((Counter(v.get("statuses", {})) for v in judged), Counter())
    text += ["", "statuses: " + ", ".join(f"{n} {label}" for label, n in statuses.most_common())]
    text += [_worst(judged)] if any(v.get("rows") for v in judged) else []
    reasons: dict[str, list[int]] = {}
    for v in verdicts:
        if v.get("not_flown"):
            reasons.setdefault(v["not_flown"][:100], []).append(v["seed"])
    for reason, seeds in sorted(reasons.items(), key=lambda item: -len(item[1])):
        named = ", ".join(map(str, seeds[:8])) + (", ..." if len(seeds) > 8 else "")
        text.append(f"not compared: {len(seeds)} x {reason} (seeds {named})")
    failing = sorted({v["seed"] for v in judged if fails(v)})
    text.append(
        f"{len(judged)} of {len(verdicts)} scenes were compared, "
        + (
            f"{len(failing)} FAIL, seeds {', '.join(map(str, failing))}"
            if failing
            else "none fails"
        )
    )
    return "\n".join(text)


def _worst(judged: list[VerdictDict]) -> str:
    """Sentence on the row that agrees least, relative to its reported error."""
    worst = max(judged, key=lambda v: v.get("worst", 0.0) / max(v.get("reported", 0.0), 1e-9))
    missed = sum(not v.get("met", True) for v in judged)
    text = (
        f"worst agreement: {worst.get('worst', 0.0):.1e} where {worst.get('reported', 0.0):.1e} is "
        f"reported ({worst.get('column', '')} of {worst['name']})"
    )
    return f"{text}; {missed} scenes report that their accuracy is not met"
