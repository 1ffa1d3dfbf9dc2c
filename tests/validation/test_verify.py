"""Every line of `sepmc verify` passes; a wrong reference fails; the table is plain text of bounded
width."""

import dataclasses
import math

import pytest
from oracles import shipped_campaigns

from sepmc.physics import joints
from sepmc.validation import lagrange, references, verify
from sepmc.validation.line import Line, table, worst

SLOW = ("top", "orders", "no_work", "full_against_reduced", "cases", "phases")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in verify.CHECKS]
)
def test_check(name):
    """All lines of one check, within tolerances set beforehand."""
    lines = verify.verify([name])
    print(table(lines))
    assert lines
    assert all(line.passes for line in lines), "\n" + table(
        [line for line in lines if not line.passes]
    )


@pytest.mark.slow
@pytest.mark.parametrize("check", [shipped_campaigns.scenes, shipped_campaigns.campaigns])
def test_against_independent_simulations(check):
    """Every outcome of the scenes of this suite, and of cases of shipped campaigns."""
    lines = check()
    assert lines
    assert all(line.passes for line in lines), "\n" + table(
        [line for line in lines if not line.passes]
    )


def test_a_wrong_reference_fails(monkeypatch):
    """Gravity of the reference 1e-9 too strong: the lines of the rod pendulum fail, by ten times
    the tolerance."""
    pendulum = references.pendulum
    monkeypatch.setattr(
        references,
        "pendulum",
        lambda t, frequency, *start: pendulum(t, frequency * (1.0 + 1e-9), *start),
    )
    lines = verify.verify(["rod_pendulum"])
    failed = {line.quantity for line in lines if not line.passes}
    assert {"position, m", "tension, N"} <= failed
    assert "FAIL" in table(lines)


def test_a_wrong_row_fails(monkeypatch):
    """Without the gap in the lever arm on the first body, every kind with a translation fails, and
    no other."""
    translation = joints.translation
    monkeypatch.setattr(joints, "translation", lambda d, *rest: translation((0.0, 0.0, 0.0), *rest))
    kinds = {
        line.case.removeprefix("rows of ") for line in verify.verify(["rows"]) if not line.passes
    }
    assert kinds == set(lagrange.KINDS) - {"rod", "free"}


def test_a_line():
    """The tolerance itself passes, more does not, and NaN on either side does not. A lower bound
    may be exceeded by any amount."""
    line = Line("case", "quantity, m", 1.0, 1.5, 0.5)
    bound = Line("case", "order, at least", 4.0, 9.0, 0.5, at_least=True)
    assert bound.passes
    assert not dataclasses.replace(bound, measured=3.4).passes
    assert not dataclasses.replace(bound, measured=math.nan).passes
    assert line.passes
    assert not dataclasses.replace(line, tolerance=0.49).passes
    assert not dataclasses.replace(line, measured=math.nan).passes
    assert not dataclasses.replace(line, reference=math.nan).passes


def test_worst():
    """The element that differs most; NaN before all others; the tolerance from the largest
    reference or a size."""
    line = worst("case", "quantity", [1.0, 20.0, 3.0], [1.0, 20.5, 2.0], 1e-3)
    assert (line.reference, line.measured, line.tolerance) == (3.0, 2.0, 0.02)
    assert worst("case", "quantity", 0.0, 1e-3, 1e-3, size=2.0).tolerance == 2e-3
    assert math.isnan(worst("case", "quantity", [1.0, 2.0], [1.0, math.nan]).measured)


def test_table():
    """Columns stand below each other, no line is wider than 140, and the failures are counted."""
    lines = [
        Line("a long name " * 6, "a long quantity " * 6, -math.pi * 1e-300, math.e * 1e-300, 1e-10),
        Line("b", "q, m", 1.0, 2.0, 0.1),
    ]
    text = table(lines)
    assert max(len(row) for row in text.splitlines()) <= 140
    assert text.splitlines()[-1] == "2 lines, 1 FAILED"
    assert text.splitlines()[1].endswith("pass")
