"""Compile processes: kept for the next kernel, replaced when they die, with compile failures
reported."""

import ctypes

import numpy as np
import pytest

from sepmc.engine import cache_files, compile_workers, kernel_cache
from sepmc.translator.compiler import compile_text

SHORT = """from sepmc.translator.units import compile_unit, workspace
@compile_unit("")
def entry(address):
    w = workspace(address)
    w[0] = {}.0
"""


@pytest.fixture(autouse=True)
def none_running():
    """No process from another test, and none left running."""
    compile_workers.end_all()
    yield
    compile_workers.end_all()
    assert compile_workers.running() == []


def names(*numbers):
    """Modules of short compile units."""
    return kernel_cache.write_modules([SHORT.format(number) for number in numbers])


def test_processes_stay_alive():
    seen = []
    assert compile_workers.compile_all(
        names(1, 2, 3), lambda done, total: seen.append((done, total))
    )
    first = compile_workers.running()
    assert sorted(seen) == [(1, 3), (2, 3), (3, 3)]
    assert first
    assert compile_workers.compile_all(names(4))
    assert compile_workers.running() == first


def compile_units(*sources):
    """Kernel of modules that are all to be compiled."""
    names = tuple(kernel_cache.write_modules(sources))
    for name in names:
        (kernel_cache.CACHE_FOLDER / f"{name}.code").unlink(missing_ok=True)
    return kernel_cache.CompileUnits(names, 0, 0, 0, 0, ())


@pytest.mark.parametrize("waiting", [False, True])
def test_short_units_start_no_process(waiting):
    """Few short units are compiled before a process has started; one that waits is used."""
    cache_files.is_stored(cache_files.LOOP) or kernel_cache._compile(cache_files.LOOP)
    seen = []
    if waiting:
        assert compile_workers.compile_all(names(21))
    units = compile_units(*(SHORT.format(30 + 2 * waiting + k) for k in range(2)))
    assert kernel_cache.compile_missing(units, lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]
    assert kernel_cache.missing_units(units) == []
    assert bool(compile_workers.running()) == waiting
    assert kernel_cache.compile_missing(units)  # nothing is missing


@pytest.mark.parametrize(
    "source", [SHORT + "# " + kernel_cache._SHORT * "x", SHORT + f"# {kernel_cache._SLOW[0]}"]
)
def test_long_and_slow_units_are_compiled_by_a_process(source):
    cache_files.is_stored(cache_files.LOOP) or kernel_cache._compile(cache_files.LOOP)
    assert kernel_cache.compile_missing(compile_units(source.format(41)))
    assert compile_workers.running()


def test_dead_process_is_replaced():
    assert compile_workers.compile_all(names(1))
    (first,) = compile_workers.running()
    first.process.kill()
    first.process.wait()
    assert compile_workers.compile_all(names(2))
    assert first not in compile_workers.running()


def test_compile_failure():
    """The call reports a failure, and compiling in this process raises the error itself."""
    (bad,) = kernel_cache.write_modules(["raise ValueError('no kernel')\n"])
    assert not compile_workers.compile_all([bad])
    assert compile_workers.running() == []
    with pytest.raises(ValueError, match="no kernel"):
        compile_text((kernel_cache.CACHE_FOLDER / f"{bad}.py").read_text(encoding="utf-8"), bad)


def test_idle_processes_end(monkeypatch):
    monkeypatch.setattr(compile_workers, "IDLE_S", 0.05)
    assert compile_workers.compile_all(names(1))
    (one,) = compile_workers.running()
    assert one.process.wait(timeout=30.0) != 0


def test_nothing_to_do():
    assert compile_workers.compile_all([])
    assert compile_workers.running() == []


def test_split_is_stored(monkeypatch):
    """A kernel is split once, and again if a unit is missing in the folder."""
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
    removed = kernel_cache.CACHE_FOLDER / f"{pieces.names[3]}.py"
    content = removed.read_text(encoding="utf-8")
    for damage in (removed.unlink, lambda: removed.write_text(content[:-9], encoding="utf-8")):
        damage()
        assert kernel_cache.compile_units_of(text) == pieces
        assert (calls, removed.read_text(encoding="utf-8")) == ([text], content)
        calls.clear()


def value_of(name):
    """Value that a unit writes, called by the address at which it is linked."""
    workspace = np.zeros(1)
    ctypes.CFUNCTYPE(None, ctypes.c_void_p)(cache_files.link(name))(workspace.ctypes.data)
    return workspace[0]


DAMAGES = ["none", "cut short", "one bit", "empty", "gone"]


@pytest.mark.slow
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_code_is_compiled_again(damage):
    """Damaged code is never loaded, and is compiled again when needed."""
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
    damaged = {"cut short": written[:-1], "one bit": bytes(changed), "empty": b""}
    if damage == "gone":
        path.unlink()
    elif damage != "none":
        path.write_bytes(damaged[damage])
    assert (name in kernel_cache.missing_units(pieces)) == (damage != "none")
    if damage != "none":
        assert cache_files.link(name) == 0
        assert compile_workers.compile_all([name])
    assert value_of(name) == number


def test_renamed_file_counts_as_missing():
    """An undamaged file under another name counts as missing."""
    one, other = kernel_cache.write_modules([SHORT.format(201), SHORT.format(202)])
    assert compile_workers.compile_all([one, other])
    paths = [kernel_cache.CACHE_FOLDER / f"{name}.code" for name in (one, other)]
    contents = [path.read_bytes() for path in paths]
    for path, content in zip(paths, reversed(contents), strict=True):
        path.write_bytes(content)
    assert [cache_files.link(name) for name in (one, other)] == [0, 0]


def test_undefined_symbols():
    """LLVM would load it, and a call would end the process."""
    (name,) = kernel_cache.write_modules([SHORT.format(7)])
    assert compile_workers.compile_all([name])
    symbols, code = cache_files._read(name)
    cache_files.store("needy", [*symbols, "no_such_function"], code)
    with pytest.raises(RuntimeError, match="needs no_such_function"):
        cache_files.link("needy")


def test_text_is_written_once(monkeypatch):
    """A text is written again for another scene, method or history."""
    import sepmc
    from sepmc.campaign.execution.step_selection import kernel_text
    from sepmc.engine import kernel_texts
    from sepmc.kernel.emit import module

    quiet = {"run.history_step_s": 0.0}
    campaign = sepmc.load("table2", {**quiet, "body.upper.mass_kg": 458.1})
    first, calls = kernel_text(campaign), []
    write = module.emit
    monkeypatch.setattr(
        module, "emit", lambda *arguments: calls.append(arguments) or write(*arguments)
    )
    assert kernel_text(sepmc.load("table2", {**quiet, "body.upper.mass_kg": 458.1})) == first
    assert calls == []
    assert kernel_text(campaign, "rk4") != first
    assert kernel_text(campaign, history=True) != first
    assert all(
        write(*arguments) == kernel_text(campaign, *arguments[1:]) for arguments in list(calls)
    )
    calls.clear()
    for path in kernel_cache.CACHE_FOLDER.glob("text_*.sealed"):
        if first.encode() in path.read_bytes():
            path.write_bytes(path.read_bytes()[:-2])
    kernel_texts._texts.clear()
    assert kernel_text(campaign) == first
    assert len(calls) == 1
    other = sepmc.load("table2", {**quiet, "phase": [{"name": "free"}]})
    assert kernel_text(other) != first
