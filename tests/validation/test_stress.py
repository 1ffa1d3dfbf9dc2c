"""No line of `sepmc stress` is silent about an error; reasonable inputs are accurate, as many as
before; wrong lines are detected; the table keeps its width."""

import dataclasses
import math

import pytest

from sepmc.schema import AUDIT_BOUNDS
from sepmc.validation import references, stress
from sepmc.validation.stresses.line import ACCURATE, FLAGGED, SILENT, Bound, Stress

LINE = Stress("input", "quantity", 1e-12, Bound(1e-10, "reason"), "ok")

SLOW = (
    *("hour", "light_link", "long_steps", "grazing", "peak_loads", "step_lengths"),
    *("angle_limits", "unresolved", "two_balls", "four_bar", "short_rods", "hidden", "absurd"),
    *("angles_at_long_steps", "not_finite", "resolved_spins", "proximity", "spent_springs"),
)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in stress.STRESSES]
)
def test_stress(name):
    """All lines of one stress pass, as many of them accurate as before."""
    lines = stress.stress([name])
    print(stress.table(lines))
    assert lines
    assert all(line.passes for line in lines), "\n" + stress.table(
        [line for line in lines if not line.passes]
    )
    assert stress.counts(lines) == stress.EXPECTED[name], "\n" + stress.table(lines)


def test_an_accurate_line_that_becomes_flagged_changes_the_counts(monkeypatch):
    """Lines whose steps no longer meet the audit: every one passes, for it is flagged, but the
    counts of this stress are no longer those expected."""
    name = "inertias"
    assert not any(line.resolved for line in stress.stress([name]))
    monkeypatch.setitem(AUDIT_BOUNDS, "steps", 1.0)
    lines = stress.stress([name])
    assert all(line.passes for line in lines)
    assert stress.counts(lines) == (0, sum(stress.EXPECTED[name]))
    assert stress.counts(lines) != stress.EXPECTED[name]


def test_every_stress_has_expected_counts():
    assert list(stress.EXPECTED) == list(stress.STRESSES)


def test_verdict():
    """Within the bound accurate, beyond it or NaN silent; with a flag flagged, whatever the
    error."""
    assert LINE.verdict == ACCURATE
    for error in (2e-10, math.inf, math.nan):
        wrong = dataclasses.replace(LINE, error=error)
        assert wrong.verdict == SILENT
        assert not wrong.passes
        assert dataclasses.replace(wrong, status="unresolved").verdict == FLAGGED
        assert dataclasses.replace(wrong, beyond=("energy_residual",)).verdict == FLAGGED
    flagged = dataclasses.replace(LINE, status="unresolved")
    assert flagged.passes
    assert not dataclasses.replace(flagged, resolved=True).passes
    assert dataclasses.replace(LINE, resolved=True).passes


def test_an_unreported_error_is_silent(monkeypatch):
    """A spring 1e-6 too stiff in the reference: the lines of stiff springs are SILENT, for status
    and audit cannot know."""
    spring_extension = references.spring_extension
    monkeypatch.setattr(
        references,
        "spring_extension",
        lambda t, m, f, k, d=0.0: spring_extension(t, m, f, k * (1.0 + 1e-6), d),
    )
    lines = stress.stress(["stiff"])
    assert {line.verdict for line in lines} == {SILENT}
    assert SILENT in stress.table(lines)


def test_an_audit_beyond_its_bound_is_flagged(monkeypatch):
    """The same with the bound of the steps taken: all lines are flagged."""
    monkeypatch.setitem(AUDIT_BOUNDS, "steps", 1.0)
    assert {line.verdict for line in stress.stress(["stiff"])} == {FLAGGED}


def test_table():
    """At most 140 columns, one line each, faults marked and counted."""
    audits = ("joint_angle_rate_residual_rad_s",) * 3
    long = Stress(
        "an input " * 9,
        "a quantity " * 9,
        1e-300,
        Bound(1e-300, "a reason " * 9),
        "ok",
        audits,
        resolved=True,
    )
    text = stress.table([long, LINE, dataclasses.replace(LINE, error=math.nan)]).splitlines()
    assert max(map(len, text)) <= 140
    assert text[1].endswith(f"{FLAGGED} !")
    assert text[2].endswith(ACCURATE)
    assert text[3].endswith(f"{SILENT} !")
    assert text[-1].startswith(f"3 lines: 1 {ACCURATE}, 1 {FLAGGED}, 1 {SILENT}; 2 ")
