"""Commands end in a sentence and exit code 2, without a traceback, where the machine does not let
them do what they are asked for; Python users read of their own options."""

import os
import subprocess
import sys
import warnings

import pytest

import sepmc
from sepmc import cache_folder, wording
from sepmc.campaign.store import shards
from sepmc.campaign.store.untrusted import StoreError
from sepmc.scene.messages import RunWarning, SceneWarning

FLY = ("campaign", "table2.toml", "--cases", "2", "--no-plots", "--quiet", "--out", "run")


def command(tmp_path, *words, **environment):
    """Exit code and errors of a command, run in an empty folder."""
    done = subprocess.run(
        [sys.executable, "-m", "sepmc", *words],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=tmp_path,
        env={**os.environ, **environment},
        check=False,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("NUMBA_NUM_THREADS", "0", "must be a whole number >= 1"),
        ("NUMBA_NUM_THREADS", "-2", "must be a whole number >= 1"),
        ("NUMBA_NUM_THREADS", "many", "must be a whole number >= 1"),
        ("NUMBA_THREADING_LAYER", "foo", "must be one of default, omp"),
        ("NUMBA_THREADING_LAYER_PRIORITY", "omp foo", "must name tbb, omp and workqueue"),
    ],
)
def test_settings_of_threads(tmp_path, name, given, message):
    """Also where the number of cases, an option, is what needs the package first."""
    code, errors = command(tmp_path, *FLY, **{name: given})
    assert (code, errors.count("\n")) == (2, 1)
    assert errors.startswith(f"error: {name} = {given}: ")
    assert message in errors
    assert not (tmp_path / "run" / "cases").exists()


def test_other_commands_with_no_threads(tmp_path):
    for words in (("check", "table2"), ("run", "table1.toml", "--out", "one")):
        code, errors = command(tmp_path, *words, NUMBA_NUM_THREADS="0")
        assert (code, errors.count("\n")) == (2, 1), words


NOWHERE = """
import sys, tempfile
tempfile._candidate_tempdir_list = lambda: ["/proc/nowhere"]  # no temporary folder either
from sepmc.cli.app import main
if __name__ == "__main__":
    main(sys.argv[1:], prog_name="sepmc")
"""


@pytest.mark.slow
@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no folder that nobody can write")
@pytest.mark.parametrize(
    "words",
    [
        ("campaign", "table2.toml", "--cases", "2", "--quiet"),
        ("compile", "table2.toml"),
        ("check", "table2.toml"),
        ("run", "table1.toml"),
    ],
)
def test_nothing_can_be_written(tmp_path, words):
    """Neither the cache, nor a temporary folder, nor the one that the command runs in."""
    script = tmp_path / "nowhere.py"
    script.write_text(NOWHERE, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script), *words],
        capture_output=True,
        text=True,
        timeout=120,
        cwd="/proc",
        env={**os.environ, "SEPMC_CACHE_DIR": "/proc/nowhere"},
        check=False,
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith("error: ")
    assert "cannot be written" in done.stderr


def test_the_cache_says_what_moves_it(monkeypatch, tmp_path):
    """In Python too."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("SEPMC_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(cache_folder.tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    with pytest.raises(OSError, match=r"nor can a temporary folder.*SEPMC_CACHE_DIR moves"):
        cache_folder.cache_folder("name")


def test_missing_engines_are_told_first(monkeypatch):
    """Before anything is flown."""
    from click.testing import CliRunner
    from oracles.__main__ import main
    from oracles.external_engines import compare

    monkeypatch.setattr(compare, "installed", lambda say: {})
    called = CliRunner().invoke(main, ["engines"])
    assert called.exit_code == 2
    assert "none of heyoka, pinocchio, exudyn is installed" in called.output


# whose options


def test_options_are_named_as_the_reader_gives_them():
    assert (wording.option("keep_columns"), wording.switch("resume")) == (
        "keep_columns",
        "resume=True",
    )
    with wording.on_command_line():
        assert (wording.option("keep_columns"), wording.switch("resume")) == (
            "--keep-columns",
            "--resume",
        )
        assert wording.option("cases", "3:9") == "--cases 3:9"
    assert wording.option("cases", "3:9") == "cases=3:9"


def test_errors_in_python_name_no_options_of_commands(tmp_path):
    """Folders in the way, runs that are not continued, places, and what until needs."""
    campaign = sepmc.load("table2", {"run.history_step_s": 0.0, "solver.step_s": 0.1})
    folder, other = tmp_path / "run", tmp_path / "other"
    campaign.run(cases=6, out=folder)
    other.mkdir()
    (other / "mine.txt").touch()
    rare = {"dispersion": {"body.upper.mass_kg": {"discrete": [[458.0, 400.0], [0.999, 0.001]]}}}
    attempts = [
        lambda: campaign.run(cases=6, out=folder),
        lambda: campaign.run(cases=3, out=folder, resume=True),
        lambda: campaign.run(cases=6, seed=3, out=folder, resume=True),
        lambda: campaign.run(cases=6, out=folder, resume=True, stats_only=True),
        lambda: campaign.with_settings({"body.upper.mass_kg": 460.0}).run(
            cases=6, out=folder, resume=True
        ),
        lambda: campaign.run(cases=6, out=other),
        lambda: campaign.run(cases=6, out=other / "mine.txt"),
        lambda: campaign.with_settings(rare).run(cases=64, until="separation_speed_m_s:0.1"),
    ]
    for attempt in attempts:
        with pytest.raises((ValueError, StoreError)) as error:
            attempt()
        assert "--" not in str(error.value), error.value
    (folder / "cases").joinpath(os.listdir(folder / "cases")[0]).unlink()
    with pytest.raises(StoreError, match="is gone") as error:
        shards.read_cases(folder)
    assert "--" not in str(error.value)


# where warnings point


def test_warnings_point_at_the_line_of_the_user():
    """Whatever lies between: loading, settings, runs, single flights, filters."""
    wide = {"dispersion": {"body.upper.inertia_kg_m2.xx": {"uniform": 30.0}}}
    campaign = sepmc.load("table2", {"solver.step_s": 0.25, "run.history_step_s": 0.0})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sepmc.load("table2", wide)
        campaign.with_settings(wide)
        result = campaign.run(cases=8)
        result.statistics("case>99")
        campaign.with_settings({"solver.step_s": 0.5}).simulate(step_s=0.1)
    assert {SceneWarning, RunWarning} <= {each.category for each in caught}
    assert {each.filename for each in caught} == {__file__}
    assert len({each.lineno for each in caught}) >= 3
