"""A run from Python and one from the command line leave the same folder, figures excepted."""

import pytest
from click.testing import CliRunner

import sepmc
from sepmc.campaign.store import ledger
from sepmc.cli import app

SETTINGS = {"run.history_step_s": 0.0, "run.seed": 5}
WORDS = [word for key, value in SETTINGS.items() for word in ("--set", f"{key}={value}")]
STATISTICS = ("statistics.csv", "statistics.json")


def from_command_line(folder, *words):
    called = CliRunner().invoke(
        app.main,
        ["campaign", "table2.toml", *WORDS, "--no-plots", "--quiet", *words, "--out",
         str(folder)],
    )  # fmt: skip
    assert called.exit_code in (0, 3), called.output


def texts(folder):
    return {name: (folder / name).read_bytes() for name in STATISTICS}


@pytest.fixture(scope="module")
def campaign():
    return sepmc.load("table2.toml", SETTINGS)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, []),
        ({"stats_only": True}, ["--stats-only"]),
        ({"keep": "every:7"}, ["--keep", "every:7"]),
        ({"until": "separation_speed_m_s:1%"}, ["--until", "separation_speed_m_s:1%"]),
        ({"max_failures": 0}, ["--fail-fast"]),
    ],
    ids=["rows", "stats_only", "keep", "until", "max_failures"],
)
def test_both_doors_leave_the_same_files(campaign, tmp_path, options, words):
    campaign.run(60, out=tmp_path / "python", announce=lambda text: None, **options)
    from_command_line(tmp_path / "words", "--cases", "60", *words)
    assert texts(tmp_path / "python") == texts(tmp_path / "words")
    one, two = (set(ledger.read(tmp_path / name)) for name in ("python", "words"))
    assert one == two


def test_a_resumed_run_has_statistics_of_all_its_cases(campaign, tmp_path):
    for folder in ("python", "words"):
        campaign.run(20, out=tmp_path / folder, announce=lambda text: None)
    first = texts(tmp_path / "python")
    campaign.run(60, out=tmp_path / "python", resume=True, announce=lambda text: None)
    from_command_line(tmp_path / "words", "--cases", "60", "--resume")
    assert texts(tmp_path / "python") == texts(tmp_path / "words") != first


@pytest.mark.slow
def test_workers_leave_statistics_too(campaign, tmp_path):
    from sepmc.cluster import dask_executor

    with dask_executor(2, None, 1) as workers:
        campaign.run(60, out=tmp_path / "many", executor=workers, announce=lambda text: None)
    campaign.run(60, out=tmp_path / "one", announce=lambda text: None)
    assert texts(tmp_path / "many") == texts(tmp_path / "one")
