"""Runs of a campaign and of its scenarios, one by one with common random numbers, to compare."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from sepmc.campaign.result import Result
from sepmc.campaign.run_options import RunOptions
from sepmc.scene.messages import InputError, Log
from sepmc.scene.scenarios import BASELINE
from sepmc.wording import never_overwriting

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

Progress = Callable[[str, int, int, int], None]  # scenario, cases done, all of them, failures


@dataclass(frozen=True)
class ScenarioRuns:
    """Results of the runs of a campaign and of each of its scenarios.

    Attributes
    ----------
    results : dict of str to Result
        By name of the scenario; the campaign itself is the first, ``baseline``.
    titles : dict of str to str
        Title of each, by the same names; empty if the file gives none.
    """

    results: dict[str, Result]
    titles: dict[str, str]

    @property
    def table(self) -> pd.DataFrame:
        """Verdicts of all runs, a row for each scenario and requirement: ``scenario`` and its
        ``title``, ``run`` and ``ok`` (numbers of cases run, and of those with status ok), and the
        fields of `sepmc.analysis.requirements.Verdict`. A scenario without requirements has one
        row, without these fields."""
        frames = []
        for name, result in self.results.items():
            frame = result.requirements().reset_index()
            if frame.empty:  # without requirements, a row with the counts
                frame = pd.DataFrame(index=[0])
            counts = result.status_counts
            frame.insert(0, "ok", counts.get("ok", 0))
            frame.insert(0, "run", sum(counts.values()))
            frame.insert(0, "title", self.titles[name])
            frame.insert(0, "scenario", name)
            frames.append(frame)
        return pd.concat(frames, ignore_index=True)


def run_scenarios(
    campaign: "Campaign",
    cases: int | None = None,
    seed: int | None = None,
    threads: int | None = None,
    out: Path | None = None,
    announce: Log | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> ScenarioRuns:
    """Run a campaign and each of its scenarios on common random numbers.

    Parameters
    ----------
    campaign : Campaign
    cases, seed, threads : int, optional
        Of each run, as for `Campaign.run`.
    out : path, optional
        Folder in which each run gets a run folder with the name of its scenario; that of the
        campaign itself is ``baseline``. If None, runs are in memory.
    announce : callable (text), optional
        Called with messages.
    progress : callable (scenario, done, total, failures), optional
        Called with the name of the scenario that runs, and its numbers of cases.
    resume : bool
        Run only the cases that the run folders in ``out`` do not contain yet.

    Returns
    -------
    ScenarioRuns

    Raises
    ------
    InputError
        If the campaign has no scenario.
    SceneError
        If a scenario gives no valid campaign; raised before anything is run.
    StoreError
        If a run folder in ``out`` contains a run and ``resume`` is False.
    """
    scenarios = campaign.scenarios()
    if not scenarios:
        raise InputError(
            f'{campaign.name}: has no scenario: give [[scenario]] with name = "..." and set = '
            "{KEY = VALUE}"
        )
    results = {}
    for name, one in {BASELINE: campaign, **scenarios}.items():
        report = None if progress is None else _of_scenario(progress, name)
        folder = None if out is None else out / name
        started = resume and folder is not None and folder.exists()
        options = RunOptions(announce=announce, progress=report, resume=started)
        with never_overwriting():
            results[name] = one.run(cases, seed, threads, folder, options=options)
    titles = {BASELINE: campaign.file.title}
    titles |= {one.name: one.title for one in campaign.file.scenarios}
    return ScenarioRuns(results, titles)


def _of_scenario(progress: Progress, name: str) -> Callable[[int, int, int], None]:
    """Return a progress callback (done, total, failures) of one run, which calls ``progress`` with
    the name of its scenario first."""
    return lambda done, total, failed: progress(name, done, total, failed)
