"""Groups of a suite in parallel: the same lines in the same order as in sequence; errors in a group
are raised."""

import time

import pytest

from sepmc.validation.groups import side_by_side
from sepmc.validation.verify import verify


@pytest.mark.slow
def test_side_by_side():
    """Two groups in workers, one in this process; each is reported when done."""
    names, done = ["free_body", "rod_pendulum", "welded"], []
    groups = side_by_side(verify, names, in_process=["rod_pendulum"], on_done=done.append)
    assert list(groups) == names
    assert sorted(done) == sorted(names)
    assert groups == {name: verify([name]) for name in names}


def _wait(names):
    """Groups that take long, and one interrupted by Ctrl-C."""
    if names == ["interrupted"]:
        raise KeyboardInterrupt
    time.sleep(600.0)


def test_an_interrupt_ends_all_groups():
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        side_by_side(_wait, ["one", "two", "interrupted"], in_process=["interrupted"])
    assert time.monotonic() - begun < 300.0


def test_a_group_that_raises():
    with pytest.raises(KeyError, match="no such"):
        side_by_side(verify, ["no such", "free_body"])
