"""Options of `sepmc.Campaign.run` beyond cases, seed, threads and run folder."""

from collections.abc import Callable
from dataclasses import dataclass

from sepmc.campaign.execution.calibration_cases import CalibrationSize
from sepmc.campaign.execution.work_ranges import Executor
from sepmc.scene.messages import Log

Progress = Callable[[int, int, int], None]  # cases done, cases in all, failures so far


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a run that most runs leave at their defaults.

    Parameters
    ----------
    overwrite : bool
        Replace the run in an existing folder ``out``.
    resume : bool
        Run only the cases missing in ``out``.
    stats_only : bool
        Store statistics, histograms, audit and counts, but no case rows and no histories; memory
        and disk do not grow with the number of cases. Percentiles are exact for fewer than 65,536
        cases, else within 0.41 % of sigma; see `sepmc.analysis.quantile_sketch`.
    until : str, optional
        Stopping rule ``METRIC:TOLERANCE``: stop as soon as the half width of the 95 % confidence
        interval of a statistic is at most TOLERANCE, in the unit of the outcome or relative
        (``1%``). METRIC is the name of an outcome for its mean (``separation_speed_m_s:0.01``), the
        name with ``.sigma`` or a percentile such as ``.p99`` for that statistic, or a status for
        its proportion. A mean or sigma counts as known only after every value of a discrete
        distribution was sampled often enough; see `sepmc.analysis.stopping`.
    keep : str, optional
        Store statistics of all cases as ``stats_only`` does, and the rows of selected cases, with
        the reason in the column ``kept_as``: ``"failed"``, ``"violating"``, ``"worst:20"`` of each
        requirement, ``"every:1000"``, ``"all"``, or several separated by commas; see
        `sepmc.campaign.store.row_selection`.
    keep_columns : str, optional
        Columns to store of the rows that ``keep`` selects, as patterns: ``"in_*,separation_*"``.
        ``case``, ``status`` and ``kept_as`` are always stored.
    float32 : bool
        Store the numbers of the rows that ``keep`` selects in single precision.
    executor : Executor, optional
        Worker processes that run the cases into ``out``, from `sepmc.cluster.dask_executor`. On
        processors of one kind, rows and statistics are bit-identical to a run without workers.
    max_failures : int, optional
        Stop soon after more than this number of cases failed, cases of a resumed run included.
        Finished cases are stored, and the run can be resumed.
    calibration : CalibrationSize, optional
        Number of calibration cases from which steps are selected; 24 corners and 512 sampled cases
        if None.
    progress : callable (done, total, failures), optional
        Called after each chunk of cases with numbers of cases: run by this command so far, to be
        run by it (without those already stored), and failed among those run.
    announce : callable (text), optional
        Called with messages about the run, such as the compilation of a kernel. If None, notes on
        the run are issued as `sepmc.RunWarning`.
    """

    overwrite: bool = False
    resume: bool = False
    stats_only: bool = False
    until: str | None = None
    keep: str | None = None
    keep_columns: str | None = None
    float32: bool = False
    executor: Executor | None = None
    max_failures: int | None = None
    calibration: CalibrationSize | None = None
    progress: Progress | None = None
    announce: Log | None = None
