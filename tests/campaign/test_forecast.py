"""What a run takes is told before it is flown, and refused where the disk cannot hold it."""

import shutil
from collections import namedtuple
from pathlib import Path

import pytest

import sepmc
from sepmc.campaign.execution.forecast import forecast
from sepmc.campaign.store.untrusted import StoreError


def size_of(folder):
    return sum(path.stat().st_size for path in folder.rglob("*.parquet"))


@pytest.mark.parametrize("settings", [{}, {"run.history_step_s": 0.0}])
def test_a_folder_is_as_large_as_foretold(settings, tmp_path):
    campaign = sepmc.load("table2", settings)
    campaign.run(cases=20_000, out=tmp_path / "run")
    least, most = forecast(campaign, 20_000, campaign.has_histories).disk_bytes
    assert least < size_of(tmp_path / "run") < most


def test_too_much_for_a_disk_is_refused(tmp_path, monkeypatch):
    """Before anything is flown, with the figures and what would help."""
    usage = namedtuple("usage", "total used free")
    paths = []
    monkeypatch.setattr(shutil, "disk_usage", lambda path: paths.append(path) or usage(0, 0, 10**6))
    with pytest.raises(StoreError, match=r"take 11 MB to .*, and 1 MB are free") as caught:
        sepmc.load("table2").run(cases=10_000, out=tmp_path / "new" / "run")
    assert "stats_only=True" in str(caught.value)
    assert 'run.history_step_s": 0' in str(caught.value)
    assert Path(paths[0]) in (tmp_path, tmp_path / "new", tmp_path / "new" / "run")
    assert not (tmp_path / "new" / "run").exists()
    sepmc.load("table2").run(cases=100, out=tmp_path / "run")
    sepmc.load("table2").run(cases=10_000, out=tmp_path / "stats", stats_only=True)


def test_what_takes_long_is_said():
    takes = forecast(sepmc.load("table2"), 10**7, True)
    assert takes.sentence(1e-9, on_disk=False) == ""
    message = takes.sentence(1e-4, on_disk=True)
    assert message.startswith(
        "about 17 min for 10000000 cases (100 us each), up to 21.3 GB on disk, "
    )
    assert takes.memory_bytes < 1e9
