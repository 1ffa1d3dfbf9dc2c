"""Selected steps are kept, in memory and on disk, and are the same as selected anew."""

import pickle
import tomllib
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import sepmc
from sepmc import code_cache
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection, step_store
from sepmc.campaign.execution.step_selection import select_steps
from sepmc.code_cache import CACHE_FOLDER
from sepmc.scene.campaign_files import shipped_campaigns
from sepmc.scene.read import parse_campaign

QUIET = {"run.history_step_s": 0.0}


@pytest.fixture
def quiet():
    """Shipped campaign without histories."""
    return sepmc.load("table2", QUIET)


@pytest.fixture
def counted(monkeypatch):
    """Calls of the selection."""
    calls, select = [], step_selection._select

    def counting(campaign, *arguments):
        calls.append(campaign)
        return select(campaign, *arguments)

    monkeypatch.setattr(step_selection, "_select", counting)
    return calls


def alike(a, b):
    """Return True if two nested values are equal, arrays to the last bit."""
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.tobytes() == b.tobytes()
    if hasattr(a, "__dataclass_fields__"):
        return all(alike(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(alike(a[key], b[key]) for key in a)
    return bool(np.array_equal(a, b, equal_nan=isinstance(a, float)))


def test_steps_are_selected_once_for_any_seed_and_number_of_cases(quiet, counted):
    step_store.forget()
    first = quiet.run(200, seed=1)
    n_selected = len(counted)
    for other in (quiet.run(300, seed=2), sepmc.load("table2", QUIET).run(200, seed=1)):
        assert other.timing["steps"] == other.timing["compile"] == 0.0
    step_store.forget()  # as in a new process
    again = quiet.run(200, seed=1)
    assert len(counted) == n_selected <= 1
    assert again.timing["steps"] == 0.0
    assert again.to_pandas().equals(first.to_pandas())


def test_stored_steps_have_the_bits_of_selected_ones(quiet):
    selected = select_steps(quiet, again=True)
    for _ in range(2):  # stored, then from memory
        kept = select_steps(quiet)
        assert alike(kept.packed, selected.packed)
        assert kept.kernel.address == selected.kernel.address
        assert [f.variant for f in kept.fallbacks] == [f.variant for f in selected.fallbacks]
        assert kept.notes == selected.notes
        step_store.forget()


CHANGES = {
    "body.upper.mass_kg": 470.0,
    "solver.accuracy": 1e-7,
    "run.end_time_s": 0.51,
    "motor.retro.thrust_N": 510.0,
}


@pytest.mark.parametrize("path", CHANGES)
def test_what_matters_has_another_key(quiet, path):
    size = step_selection.CalibrationSize(24, 512)
    other = quiet.with_settings({path: CHANGES[path]})
    assert step_store.key_of(other, False, size) != step_store.key_of(quiet, False, size)


def test_what_does_not_matter_has_the_same_key(quiet):
    size = step_selection.CalibrationSize(24, 512)
    key = step_store.key_of(quiet, False, size)
    for settings in ({"run.seed": 9}, {"run.cases": 77}, {"title": "other"}):
        assert step_store.key_of(quiet.with_settings(settings), False, size) == key
    assert step_store.key_of(quiet, True, size) != key
    assert step_store.key_of(quiet, False, step_selection.CalibrationSize(24, 64)) != key


@pytest.mark.parametrize("content", [b"", b"damaged", None])
def test_damaged_steps_are_selected_again(quiet, counted, content):
    integration = select_steps(quiet)
    size = step_selection.CalibrationSize(step_selection.CORNERS, step_selection.SAMPLE)
    path = CACHE_FOLDER / f"steps_{step_store.key_of(quiet, False, size)}.sealed"
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]) if content is None else content)
    step_store.forget()
    before = len(counted)
    assert alike(select_steps(quiet).packed, integration.packed)
    assert len(counted) == before + 1
    assert path.read_bytes() != (content or b"")


def test_files_of_steps_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(step_store, "_MAX_FILES", 3)
    for number in range(6):
        (tmp_path / f"steps_{number}.sealed").write_bytes(pickle.dumps(number))
    (tmp_path / "text_0.sealed").write_bytes(b"")
    step_store._prune(tmp_path)
    assert len(list(tmp_path.glob("steps_*"))) == 3
    assert (tmp_path / "text_0.sealed").exists()


def test_steps_follow_from_every_source_that_is_not_compiled():
    root = Path(sepmc.__file__).parent
    in_digest = {path for pattern in step_store._SOURCES for path in root.glob(pattern)}
    compiled = {path for pattern in code_cache._SOURCES for path in root.glob(pattern)}
    rooms = ("analysis", "campaign", "engine", "kernel", "physics", "routines", "scene")
    needed = {path for room in rooms for path in (root / room).rglob("*.py")}
    assert needed | {root / "schema.py"} <= in_digest | compiled


def reordered(tree, table):
    """A tree with one of its tables in the other order."""
    return {k: dict(reversed(v.items())) if k == table else v for k, v in tree.items()}


@pytest.mark.parametrize("name", shipped_campaigns())
def test_resolved_file_has_the_same_text(name):
    """A replay uses the steps that its run selected, also where the run had settings."""
    body = next(iter(sepmc.load(name).scene.body))
    load = {"name": "thruster", "body": body, "moment_N_m": {"z": 3.0}}
    campaign = sepmc.load(name, {"load": [load]})
    tree = tomllib.loads(campaign.file.toml)
    assert Campaign(parse_campaign(tree, name)).ordered_text == campaign.ordered_text


@pytest.mark.slow
def test_order_of_a_file_selects_again(quiet):
    """Parameters and columns have the order of the file."""
    select_steps(quiet)
    swapped = Campaign(parse_campaign(reordered(quiet.file.tree, "body"), "table2"))
    assert swapped.digest == quiet.digest
    ours, theirs = swapped.run(40).to_pandas(), quiet.run(40).to_pandas()
    step_store.forget()
    assert ours.equals(Campaign(swapped.file).run(40).to_pandas())
    for name in ("separation_distance_mm", "separation_speed_m_s", "upper_pitch_deg"):
        np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-8)
    size = step_selection.CalibrationSize(24, 512)
    keys = {step_store.key_of(each, False, size) for each in (quiet, swapped)}
    assert len(keys) == 2
