"""Processes that compile: they are kept for the next kernel, replaced when they die, and what they
cannot compile is said."""

import ctypes

import numpy as np
import pytest

from sepmc.engine import cache_files, compile_workers, kernel_cache

SHORT = """from sepmc.engine.compile_units import compile_unit, workspace
@compile_unit("")
def flown(address):
    w = workspace(address)
    w[0] = {}.0
"""


@pytest.fixture(autouse=True)
def none_running():
    """No process of another test, and none left."""
    compile_workers.end_all()
    yield
    compile_workers.end_all()
    assert compile_workers.running() == []


def names(*numbers):
    return kernel_cache.write_modules([SHORT.format(number) for number in numbers])


def test_processes_are_kept():
    seen = []
    assert compile_workers.compile_all(
        names(1, 2, 3), lambda done, total: seen.append((done, total))
    )
    first = compile_workers.running()
    assert sorted(seen) == [(1, 3), (2, 3), (3, 3)]
    assert first
    assert compile_workers.compile_all(names(4))
    assert compile_workers.running() == first


def test_one_that_died_is_replaced():
    assert compile_workers.compile_all(names(1))
    (first,) = compile_workers.running()
    first.process.kill()
    first.process.wait()
    assert compile_workers.compile_all(names(2))
    assert first not in compile_workers.running()


def test_what_cannot_be_compiled():
    """The call says so, and whoever loads the module then gets the error itself."""
    (bad,) = kernel_cache.write_modules(["raise ValueError('no kernel')\n"])
    assert not compile_workers.compile_all([bad])
    assert compile_workers.running() == []
    with pytest.raises(ValueError, match="no kernel"):
        kernel_cache.load_module(bad)


def test_they_end_by_themselves(monkeypatch):
    monkeypatch.setattr(compile_workers, "IDLE_S", 0.05)
    assert compile_workers.compile_all(names(1))
    (one,) = compile_workers.running()
    assert one.process.wait(timeout=30.0) != 0


def test_nothing_to_do():
    assert compile_workers.compile_all([])
    assert compile_workers.running() == []


def test_how_a_kernel_is_split_is_kept(monkeypatch):
    """Split once, and again where a piece is gone from the folder."""
    import sepmc
    from sepmc.campaign.execution.step_selection import kernel_text
    from sepmc.kernel.emit.compile_units import split

    text = kernel_text(sepmc.load("table2", {"run.history_step_s": 0.0}))
    pieces = kernel_cache.compile_units_of(text)
    assert list(pieces.names) == kernel_cache.write_modules([piece.text for piece in split(text)])
    calls = []
    monkeypatch.setattr(kernel_cache, "split", lambda text: calls.append(text) or split(text))
    assert kernel_cache.compile_units_of(text) == pieces
    assert calls == []
    monkeypatch.setattr(cache_files, "is_stored", lambda name: False)  # as if none was compiled
    lost = kernel_cache.CACHE_FOLDER / f"{pieces.names[3]}.py"
    kept = lost.read_text(encoding="utf-8")
    for damage in (lost.unlink, lambda: lost.write_text(kept[:-9], encoding="utf-8")):
        damage()
        assert kernel_cache.compile_units_of(text) == pieces
        assert (calls, lost.read_text(encoding="utf-8")) == ([text], kept)
        calls.clear()


def flown_by(name):
    """What a piece writes, called by the address at which it is linked."""
    room = np.zeros(1)
    ctypes.CFUNCTYPE(None, ctypes.c_void_p)(cache_files.link(name))(room.ctypes.data)
    return room[0]


DAMAGES = ["none", "cut short", "one bit", "empty", "gone"]


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_code_is_compiled_again(damage):
    """It never gets into the process, and the next who asks compiles it."""
    number = 100 + DAMAGES.index(damage)
    (name,) = kernel_cache.write_modules([SHORT.format(number)])
    pieces = kernel_cache.CompileUnits((name,), 0, 0, 0, 0, ())
    path = kernel_cache.CACHE_FOLDER / f"{name}.code"
    path.unlink(missing_ok=True)
    assert name in kernel_cache.missing_units(pieces)
    assert compile_workers.compile_all([name])
    written = path.read_bytes()
    changed = bytearray(written)
    changed[len(changed) // 2] ^= 1
    to = {"cut short": written[:-1], "one bit": bytes(changed), "empty": b""}
    if damage == "gone":
        path.unlink()
    elif damage != "none":
        path.write_bytes(to[damage])
    assert (name in kernel_cache.missing_units(pieces)) == (damage != "none")
    if damage != "none":
        assert cache_files.link(name) == 0
        assert compile_workers.compile_all([name])
    assert flown_by(name) == number


def test_no_file_stands_in_for_another():
    """Whole by itself, under the name of another: it counts as not there."""
    one, other = kernel_cache.write_modules([SHORT.format(201), SHORT.format(202)])
    assert compile_workers.compile_all([one, other])
    paths = [kernel_cache.CACHE_FOLDER / f"{name}.code" for name in (one, other)]
    contents = [path.read_bytes() for path in paths]
    for path, content in zip(paths, reversed(contents), strict=True):
        path.write_bytes(content)
    assert [cache_files.link(name) for name in (one, other)] == [0, 0]


def test_code_that_needs_what_is_not_there():
    """LLVM would load it, and the process would end when it calls."""
    (name,) = kernel_cache.write_modules([SHORT.format(7)])
    assert compile_workers.compile_all([name])
    symbols, code = cache_files._read(name)
    cache_files.store("needy", [*symbols, "no_such_function"], code)
    with pytest.raises(RuntimeError, match="needs no_such_function"):
        cache_files.link("needy")


def test_a_text_is_written_once(monkeypatch):
    """And anew for another scene, method or history."""
    import sepmc
    from sepmc.campaign.execution.step_selection import kernel_text
    from sepmc.kernel.emit import module

    quiet = {"run.history_step_s": 0.0}
    campaign = sepmc.load("table2", {**quiet, "body.upper.mass_kg": 458.1})
    first, calls = kernel_text(campaign), []
    write = module.emit
    monkeypatch.setattr(module, "emit", lambda *given: calls.append(given) or write(*given))
    assert kernel_text(sepmc.load("table2", {**quiet, "body.upper.mass_kg": 458.1})) == first
    assert calls == []
    assert kernel_text(campaign, "rk4") != first
    assert kernel_text(campaign, history=True) != first
    assert all(write(*given) == kernel_text(campaign, *given[1:]) for given in list(calls))
    calls.clear()
    for path in kernel_cache.CACHE_FOLDER.glob("text_*.sealed"):
        if first.encode() in path.read_bytes():
            path.write_bytes(path.read_bytes()[:-2])
    assert kernel_text(campaign) == first
    assert len(calls) == 1
    other = sepmc.load("table2", {**quiet, "phase": [{"name": "free"}]})
    assert kernel_text(other) != first
