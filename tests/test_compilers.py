"""Processes that compile: they are kept for the next kernel, replaced when they die, and what they
cannot compile is said."""

import pytest

from sepmc.engine import cache, compilers

PLAIN = '"""Nothing to compile, number {}."""\n'


@pytest.fixture(autouse=True)
def none_running():
    """No process of another test, and none left."""
    compilers.end_all()
    yield
    compilers.end_all()
    assert compilers.running() == []


def names(*numbers):
    return cache.write([PLAIN.format(number) for number in numbers])


def test_processes_are_kept():
    seen = []
    assert compilers.compile_all(names(1, 2, 3), lambda done, total: seen.append((done, total)))
    first = compilers.running()
    assert sorted(seen) == [(1, 3), (2, 3), (3, 3)]
    assert first
    assert compilers.compile_all(names(4))
    assert compilers.running() == first


def test_one_that_died_is_replaced():
    assert compilers.compile_all(names(1))
    (first,) = compilers.running()
    first.process.kill()
    first.process.wait()
    assert compilers.compile_all(names(2))
    assert first not in compilers.running()


def test_what_cannot_be_compiled():
    """The call says so, and whoever loads the module then gets the error itself."""
    (bad,) = cache.write(["raise ValueError('no kernel')\n"])
    assert not compilers.compile_all([bad])
    assert compilers.running() == []
    with pytest.raises(ValueError, match="no kernel"):
        cache.module(bad)


def test_they_end_by_themselves(monkeypatch):
    monkeypatch.setattr(compilers, "IDLE_S", 0.05)
    assert compilers.compile_all(names(1))
    (one,) = compilers.running()
    assert one.process.wait(timeout=30.0) != 0


def test_nothing_to_do():
    assert compilers.compile_all([])
    assert compilers.running() == []


def test_how_a_kernel_is_split_is_kept(monkeypatch):
    """Split once, and again where a piece is gone from the folder."""
    import sepmc
    from sepmc.campaign.pilot import kernel_text
    from sepmc.kernel.pieces import split

    text = kernel_text(sepmc.load("table2", {"run.history_step_s": 0.0}))
    names = cache.names_of(text)
    assert names == cache.write([piece.text for piece in split(text)])
    calls = []
    monkeypatch.setattr(cache, "split", lambda text: calls.append(text) or split(text))
    assert cache.names_of(text) == names
    assert calls == []
    lost = cache.CACHE_FOLDER / f"{names[3]}.py"
    kept = lost.read_text(encoding="utf-8")
    lost.unlink()
    assert cache.names_of(text) == names
    assert (calls, lost.read_text(encoding="utf-8")) == ([text], kept)
