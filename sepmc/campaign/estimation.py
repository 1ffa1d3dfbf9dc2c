"""Parameter estimation from telemetry: the distributions of a campaign are the prior, its
measurements give the likelihood, and a sample of the posterior is a table of inputs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from sepmc.analysis.model_check import ModelCheck, check_model
from sepmc.analysis.surrogate_moves import Coordinates
from sepmc.analysis.tempered_sampler import (
    FarPosteriorError,
    NoLikelihoodError,
    PosteriorSample,
    sample_posterior,
)
from sepmc.campaign import cases as sampling
from sepmc.campaign.execution.batch_histories import BatchHistories
from sepmc.campaign.measured_channels import (
    MeasuredChannel,
    at_samples,
    history_times,
    read_measurements,
)
from sepmc.engine.dispatch import check_int, check_threads
from sepmc.scene.messages import InputError, Log

if TYPE_CHECKING:
    from sepmc.campaign.campaign import Campaign

CASES = 1000  # of a posterior sample
INTERVAL = 0.9  # probability of credible intervals
CORRELATED = 0.7  # posterior correlation that is reported
UNINFORMED = 0.9  # ratio of standard deviations above which the flight says little
_MIXED = 0.25  # effective cases, of all, below which standard errors more than double
_MIN_PER_PARAMETER, _MIN_CASES, _MOST_CASES = 10, 100, 100_000
_PRIOR = 20_000  # samples of the statistics of the prior
_BANDS = 500  # cases of the band of the prior
_NUMERICAL = 0.1  # change of the standardised residuals together by the numerical error


@dataclass(frozen=True, repr=False)
class Estimation:
    """Result of a parameter estimation: the posterior of a campaign, given its measurements.

    Attributes
    ----------
    table : DataFrame
        A row for each dispersed parameter and estimated delay: ``parameter`` (key), ``unit``;
        ``prior_mean``, ``prior_std``, ``prior_low``, ``prior_high``, and ``mean``, ``std``,
        ``low``, ``high`` of the posterior, where low and high are the ends of the 90 % interval;
        ``std_ratio``, posterior over prior (NaN of a constant); ``effective_cases``, number of
        independent cases whose mean would be as certain.
    correlations : list of (str, str, float)
        Pairs of parameters or delays with strongly correlated posterior, the strongest first: two
        names, and the correlation of their normal scores, at least `CORRELATED` in absolute value.
    inputs : DataFrame
        Sample of the posterior, a row per case: inputs by column, in the units of the file.
    sample : PosteriorSample
        The same sample as normal scores, with the diagnostics of the sampler.
    check : ModelCheck
        Tests whether the model explains the measurements.
    channels : list of MeasuredChannel
        Measured samples that were used.
    curves : DataFrame
        Long form, a row per measured sample: ``measurement`` (number), ``column``, ``time_s``,
        ``measured``, ``sigma``; 5, 50 and 95 % of the cases of prior and posterior (``prior_low``,
        ``prior_median``, ...); and ``residual``, measured minus posterior mean.
    log_evidence : float
        Natural logarithm of the density of the measurements under the campaign.
    impossible : float
        Fraction of the cases of the prior that have no value at some sample of some channel.
    understood : list of str
        Sentences on how each channel was interpreted.
    notes : list of str
        Notes for the user on possible errors of the estimate.
    seed : int
    model : Model
        Model of the measurements.
    """

    table: pd.DataFrame
    correlations: list[tuple[str, str, float]]
    inputs: pd.DataFrame
    sample: PosteriorSample
    check: ModelCheck
    channels: list[MeasuredChannel]
    curves: pd.DataFrame
    log_evidence: float
    impossible: float
    understood: list[str]
    notes: list[str]
    seed: int
    model: "Model"

    def __repr__(self) -> str:
        state = "model shortfall" if self.check.is_short else "explained by the model"
        known = int((self.table["std_ratio"] <= UNINFORMED).sum())
        return (
            f"<Estimation of {self.model.campaign.name}, seed {self.seed}: measurements {state}, "
            f"{known} of {len(self.table)} parameters known better>"
        )

    def _repr_html_(self) -> str:
        """HTML for notebooks: the line of `__repr__`, the notes, and the table of the parameters,
        the smallest ``std_ratio`` first."""
        table = self.table.set_index("parameter").sort_values("std_ratio", kind="stable")
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f"<p>{escape(repr(self))}</p>{notes}{table.to_html(float_format='{:.6g}'.format)}"

    def density_at(self, scores: np.ndarray) -> float:
        """Return the logarithm of the posterior density of normal scores (d,) of parameters and
        delays, except for an unknown constant; NaN if the case has no value at a sample."""
        residuals = self.model.residuals(scores[None])[0]
        return float(-0.5 * (residuals**2).sum() - 0.5 * (scores**2).sum())


def estimate(
    campaign: "Campaign",
    cases: int = CASES,
    seed: int | None = None,
    threads: int | None = None,
    announce: Log | None = None,
    report: Callable[[float, int], None] | None = None,
) -> Estimation:
    """Estimate the dispersed parameters of a campaign from its measurements.

    Parameters
    ----------
    campaign : Campaign
    cases : int
        Number of cases of the sample of the posterior.
    seed : int, optional
        That of the file if None.
    threads : int, optional
        As for `Campaign.run`.
    announce : callable (text), optional
        Called with messages.
    report : callable (temperature, sweeps), optional
        Called with the progress of the sampler: the power of the likelihood, 0 (prior) to 1
        (posterior), and the number of sweeps so far; each proposes one move of every case.

    Returns
    -------
    Estimation

    Raises
    ------
    InputError
        If there are no measurements or distributions, the number of cases is out of range, or no
        case comes near the measurements.
    """
    check_threads(threads)
    cases = check_int("cases", cases, _MIN_CASES, _MOST_CASES)
    model = Model(campaign, threads, announce)
    check_int("cases", cases, _MIN_PER_PARAMETER * model.dimensions)
    seed = campaign.checked_seed(seed)
    random = sampling.generator(seed, "estimation")
    try:
        sample = sample_posterior(
            model.residuals, model.dimensions, cases, random, model.coordinates, report
        )
    except NoLikelihoodError:
        raise InputError(
            f"{campaign.name}: none of {cases} cases of the distributions reaches the end of the "
            "measurements; look at their statuses (sepmc campaign), and at delay_s"
        ) from None
    except FarPosteriorError:
        raise InputError(
            f"{campaign.name}: the measurements are too far from all cases of the distributions; "
            "look at the units, the sign and the clock of each channel, or widen the distributions"
        ) from None
    predictions = model.predictions(sample.scores)
    channels = model.channels
    check = check_model(
        [channel.time for channel in channels],
        [channel.values / channel.sigma for channel in channels],
        predictions,
        sample.scores,
    )
    prior = model.predictions(random.standard_normal((_BANDS, model.dimensions)))
    names = [column.name for column in campaign.input_columns]
    table = model.table(sample.scores, random)
    table["effective_cases"] = sample.effective
    return Estimation(
        table,
        model.correlations(sample.scores),
        pd.DataFrame(model.inputs(sample.scores), columns=names),
        sample,
        check,
        channels,
        _curves(channels, prior, predictions),
        sample.log_evidence + model.log_scale,
        float(np.mean(np.any([np.isnan(values).any(axis=1) for values in prior], axis=0))),
        model.understood,
        [*model.notes, *_sigma_notes(campaign, channels, check), *_mixing_notes(table, cases)],
        seed,
        model,
    )


class Model:
    """Model of the measurements of a campaign: predicts them at standard-normal scores.

    Scores have shape (n, dimensions): a row per case, with a score for each dispersed parameter,
    then one for each clock, a telemetry file whose delay is estimated.

    Parameters
    ----------
    campaign : Campaign
    threads : int, optional
        Number of threads; all cores if None.
    announce : callable (text), optional
        Called with messages, such as on the compilation of a kernel.

    Attributes
    ----------
    channels : list of MeasuredChannel
        Measured samples, without those at which no trial case has a value.
    clocks : list of str
        Telemetry files whose delay is estimated.
    dimensions : int
        Number of scores of a case: dispersed parameters, then clocks.
    columns : list of str
        History columns that are measured, each once.
    times : ndarray, shape (t,)
        Times of the predicted histories, s.
    histories : BatchHistories
        Integrates cases to histories of ``columns`` at ``times``.
    notes, understood : list of str
        Notes for the user on possible errors; sentences on how each channel was interpreted.

    Raises
    ------
    InputError
        If the campaign has no measurements or no distributions, takes inputs from a sample table,
        or fewer than two samples of a channel remain.
    """

    def __init__(
        self, campaign: "Campaign", threads: int | None = None, announce: Log | None = None
    ):
        file = campaign.file
        if not file.measurements:
            raise InputError(
                f"{campaign.name}: has no measurement: give [[measurement]] column, file and sigma"
            )
        if not file.dispersions:
            raise InputError(
                f"{campaign.name}: nothing is dispersed; give [dispersion], what is known of the "
                "parameters before the flight"
            )
        if file.input_table is not None:
            raise InputError(
                f"run.samples = {file.input_table.path.name}: a sample table has no density to "
                "estimate with; remove run.samples, and give [dispersion] distributions"
            )
        self.campaign, self.notes = campaign, list[str]()
        self.channels, self.understood = read_measurements(campaign)
        self.clocks = list(dict.fromkeys(c.file for c in self.channels if c.delay_sigma > 0.0))
        self.dimensions = len(file.dispersions) + len(self.clocks)
        self.columns = list(dict.fromkeys(channel.column for channel in self.channels))
        self.times = history_times(self.channels, campaign.scene.run.end_time)
        tolerances = [
            min(_tolerance(c) for c in self.channels if c.column == name) for name in self.columns
        ]
        trials = campaign.sample(0, 64) if not self._is_sized else campaign.sample(0, 1)
        self.histories = BatchHistories(
            campaign, self.columns, self.times, tolerances, trials, threads, announce
        )
        self._drop_undefined(trials)
        if self.histories.error > 1.0:
            self.notes.append(
                "numerical errors of histories are "
                f"{self.histories.error:.2g} times what the measurements allow: parameters may be "
                "biased"
            )

    @property
    def _is_sized(self) -> bool:
        """True if the file's sampler is one (`lhs`, `saltelli`) whose cases depend on their total
        number, so that a longer sample does not begin with a shorter one."""
        return self.campaign.scene.run.sampler in sampling.SIZE_DEPENDENT

    def _drop_undefined(self, trials: np.ndarray) -> None:
        """Remove from the channels, with a note, the samples at which none of n cases has a value,
        such as angles in still air. ``trials`` (n, d) are the inputs of the cases, in the units of
        the file. Raises InputError if fewer than two samples of a channel remain."""
        histories = self.histories(trials)
        for k, channel in enumerate(self.channels):
            values = histories[:, self.columns.index(channel.column)]
            known = np.isfinite(at_samples(values, self.times, channel, None)).any(axis=0)
            if not known.all():
                count = int(np.count_nonzero(~known))
                self.notes.append(
                    f"{channel.column}: {count} samples of {channel.file} are left out: no case "
                    "has a value at their times"
                )
                if np.count_nonzero(known) < 2:
                    raise InputError(
                        f"measurement.{k}.column = {channel.column}: fewer than two of its samples "
                        "have times at which a case has a value; check delay_s, or leave it out"
                    )
                self.channels[k] = channel.only(known)

    def inputs(self, scores: np.ndarray) -> np.ndarray:
        """Return the d inputs (n, d), in the units of the file, at standard-normal scores
        (n, dimensions); the columns after the first d, of clock delays, do not count."""
        file = self.campaign.file
        own = scores[:, : len(file.dispersions)]
        return sampling.inputs_at_scores(file.dispersions, own, file.copulas)

    @property
    def coordinates(self) -> Coordinates:
        """Each input as a function of its score: coordinates for the sampler, in which histories
        are nearly quadratic. Correlated inputs and delays keep their scores."""
        knots = Coordinates.knots()
        values = np.tile(knots[:, None], self.dimensions)
        values[:, : len(self.campaign.file.dispersions)] = self.inputs(values)
        for copula in self.campaign.file.copulas:  # functions of several scores
            values[:, list(copula.places)] = knots[:, None]
        return Coordinates(values)

    def _delay_of(self, channel: MeasuredChannel, scores: np.ndarray) -> np.ndarray | None:
        """Return the deviations (n,) of the delay of a channel from its nominal value, s, at scores
        (n, dimensions); None if the delay is not estimated."""
        if channel.delay_sigma == 0.0:
            return None
        clock = len(self.campaign.file.dispersions) + self.clocks.index(channel.file)
        return np.asarray(channel.delay_sigma * scores[:, clock])

    def predictions(self, scores: np.ndarray) -> list[np.ndarray]:
        """Return the predictions at scores (n, dimensions): for each channel an array (n, m) with
        its m samples, in units of sigma, NaN where a case has no value."""
        histories = self.histories(self.inputs(scores))
        return [
            at_samples(
                histories[:, self.columns.index(channel.column)],
                self.times,
                channel,
                self._delay_of(channel, scores),
            )
            / channel.sigma
            for channel in self.channels
        ]

    def residuals(self, scores: np.ndarray) -> np.ndarray:
        """Return the residuals at scores (n, dimensions), measured minus predicted, in units of
        sigma: shape (n, m), m samples of all channels; NaN where a case has no value."""
        predictions = zip(self.channels, self.predictions(scores), strict=True)
        return np.concatenate([c.values / c.sigma - values for c, values in predictions], axis=1)

    @property
    def log_scale(self) -> float:
        """Natural logarithm of the likelihood that the measurements would have with all residuals
        0. Errors are independent and normal, so it is minus the sum of log(sigma sqrt(2 pi)) over
        all samples of all channels."""
        sigmas = np.concatenate([channel.sigma for channel in self.channels])
        return -float(np.log(sigmas * math.sqrt(2.0 * math.pi)).sum())

    def table(self, scores: np.ndarray, random: np.random.Generator) -> pd.DataFrame:
        """Return `Estimation.table`, without ``effective_cases``, of a posterior sample ``scores``
        (n, dimensions). ``random`` samples the prior."""
        before = random.standard_normal((_PRIOR, self.dimensions))
        prior, posterior = (np.hstack([self.inputs(s), self._delays(s)]) for s in (before, scores))
        units = [column.unit for column in self.campaign.input_columns]
        rows: dict[str, object] = {
            "parameter": self._names,
            "unit": units + ["s"] * len(self.clocks),
        }
        ends = (0.5 - 0.5 * INTERVAL, 0.5 + 0.5 * INTERVAL)
        for stem, values in (("prior_", prior), ("", posterior)):
            low, high = np.quantile(values, ends, axis=0)
            spread = values.std(axis=0)
            # of a constant, round-off
            spread[np.ptp(values, axis=0) == 0.0] = 0.0
            own = {"mean": values.mean(axis=0), "std": spread, "low": low, "high": high}
            rows |= {stem + name: column for name, column in own.items()}
        table = pd.DataFrame(rows)
        table["std_ratio"] = table["std"] / table["prior_std"].where(table["prior_std"] > 0.0)
        return table

    @property
    def _names(self) -> list[str]:
        """Names of the dimensions: keys of the dispersed parameters, then ``delay of FILE`` for
        each file whose delay is estimated, without its folder unless two would then be equal."""
        keys = [one.parameter.key for one in self.campaign.file.dispersions]
        short = [Path(name).name for name in self.clocks]
        clocks = short if len(set(short)) == len(short) else self.clocks
        return keys + [f"delay of {name}" for name in clocks]

    def _delays(self, scores: np.ndarray) -> np.ndarray:
        """Return the delays (n, clocks), s, at scores (n, dimensions). A clock is a file with
        estimated delay; if its measurements have several nominal delays, the first one counts."""
        delays = np.empty((len(scores), len(self.clocks)))
        for k, name in enumerate(self.clocks):
            channel = next(one for one in self.channels if one.file == name)
            deviation = self._delay_of(channel, scores)
            delays[:, k] = channel.delay + (0.0 if deviation is None else deviation)
        return delays

    def correlations(self, scores: np.ndarray) -> list[tuple[str, str, float]]:
        """Return the correlations of a posterior sample ``scores`` (n, dimensions) of at least
        `CORRELATED` in absolute value, the strongest first: names of two parameters or delays, and
        the correlation of their scores."""
        spread = scores.std(axis=0) > 0.0
        with np.errstate(invalid="ignore", divide="ignore"):
            matrix = np.corrcoef(scores, rowvar=False).reshape(2 * (self.dimensions,))
        names = self._names
        pairs = [
            (names[i], names[k], float(matrix[i, k]))
            for i in range(self.dimensions)
            for k in range(i)
            if spread[i] and spread[k] and abs(matrix[i, k]) >= CORRELATED
        ]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))


def _tolerance(channel: MeasuredChannel) -> float:
    """Return the numerical error, root mean square in the unit of the column, that hardly changes
    the likelihood of a channel: `_NUMERICAL` times its smallest sigma over the square root of the
    number of its samples."""
    return float(_NUMERICAL * channel.sigma.min() / math.sqrt(len(channel.time)))


def _sigma_notes(
    campaign: "Campaign", channels: Sequence[MeasuredChannel], check: ModelCheck
) -> list[str]:
    """Return a note for each channel whose residuals are much smaller than its stated sigma, which
    the file of ``campaign`` gives. ``check`` has the test of each of the ``channels``, in their
    order, which is also that of the measurements in the file."""
    return [
        f"{channel.column}: residuals are {test.ratio:.2g} of sigma = {one.sigma:g}, which is far "
        f"too large: give a sigma of {test.ratio * one.sigma:.2g} {channel.unit} or less, and "
        "parameters are better known; of a filtered channel, whose errors are not independent, "
        "give fewer samples instead"
        for one, channel, test in zip(
            campaign.file.measurements, channels, check.channels, strict=True
        )
        if test.is_too_small
    ]


def _mixing_notes(table: pd.DataFrame, cases: int) -> list[str]:
    """Return a note if the ``cases`` of the posterior sample depend on each other so much that they
    are worth few independent ones of some parameter; else an empty list. ``table`` is
    `Estimation.table`."""
    effective = table.set_index("parameter")["effective_cases"]
    if effective.min() >= _MIXED * cases:
        return []
    return [
        f"the sampler mixes badly: {cases} cases are worth only {effective.min():.0f} independent "
        f"ones for {effective.idxmin()}; compare the estimates of two seeds, give more cases, or "
        "disperse fewer parameters that the flight cannot tell from each other"
    ]


def _curves(
    channels: Sequence[MeasuredChannel], prior: list[np.ndarray], posterior: list[np.ndarray]
) -> pd.DataFrame:
    """Return `Estimation.curves`, from the predictions of ``prior`` and ``posterior`` cases, for
    each channel an array (cases, samples) in units of sigma."""
    frames = []
    percent = (50.0 - 50.0 * INTERVAL, 50.0, 50.0 + 50.0 * INTERVAL)
    for k, channel in enumerate(channels):
        table: dict[str, object] = {
            "measurement": k,
            "column": channel.column,
            "time_s": channel.time,
            "measured": channel.values,
            "sigma": channel.sigma,
        }
        for stem, values in (("prior", prior[k]), ("posterior", posterior[k])):
            bands = np.nanpercentile(values * channel.sigma, percent, axis=0)
            for name, band in zip(("low", "median", "high"), bands, strict=True):
                table[f"{stem}_{name}"] = band
        table["residual"] = channel.values - posterior[k].mean(axis=0) * channel.sigma
        frames.append(pd.DataFrame(table))
    return pd.concat(frames, ignore_index=True)


__all__ = ["Estimation", "estimate"]
