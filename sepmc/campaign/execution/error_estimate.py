"""An estimate of the error of every case: guards of its flight tell how hard it was to integrate,
and trial cases, whose errors are known, what errors that goes with."""

from dataclasses import dataclass, replace

import numpy as np

# What is told of a case is so many times what no trial case goes beyond. How true errors of other
# cases compare with that stands in sepmc/validation/README.md.
_MARGIN = 4.0 / 3.0
# of the largest error of a case: what never comes so near is not looked at
_NEAR = 0.5


@dataclass(frozen=True)
class Estimate:
    """Errors of outcomes (o,) as sums over guards (g,): for every guard as large as the largest of
    a trial case, ``size`` (g,), a share of ``weights`` (o, g), which grows with the power 3/2 of
    the guard. The sum is raised until no trial case is beyond, by a ``factor`` (o,) or by a
    ``number`` (o,), whichever is less; if guards tell nothing of some errors the factor is
    infinite. On top come ``floor`` (o,) and shares of the guards themselves, ``left_out`` (o, g).
    The largest error of a case is that of one of the ``leading`` outcomes (k,), of those that
    ``decides`` (o,)."""

    size: np.ndarray
    weights: np.ndarray
    factor: np.ndarray
    number: np.ndarray
    floor: np.ndarray
    left_out: np.ndarray
    leading: np.ndarray
    decides: np.ndarray

    def of_cases(self, guards: np.ndarray) -> np.ndarray:
        """The error (n,) of each case, the largest of its outcomes, given its guards (n, g). Sums
        are made term by term, so that a case has the same bits in any batch."""
        terms, found = _terms(guards, self.size), np.zeros(len(guards))
        for k in self.leading:
            np.maximum(found, self._raised(k, self._sum(k, terms), guards), out=found)
        return found

    def of_leading(self, guards: np.ndarray) -> np.ndarray:
        """The largest error (o,) of each outcome that leads over cases with these guards (n, g); 0
        of the others."""
        found = np.zeros(len(self.floor))
        terms = _terms(guards, self.size)
        for k in self.leading:
            found[k] = self._raised(k, self._sum(k, terms), guards).max(initial=0.0)
        return found

    def largest(self, leading: np.ndarray, most: np.ndarray) -> np.ndarray:
        """What the error (o,) of each outcome is no larger than over some cases, given that of the
        outcomes that lead (o,) and the largest guards (g,), of whichever case: these together say
        it of the others, which takes a tenth of the time. Those that decide (o,) are never further
        off than the leading ones. However cases are grouped, it is the same."""
        if not len(most):
            return leading
        found, most = leading.copy(), most[None, :]
        together = _terms(most, self.size)
        for k in sorted(set(range(len(found))) - set(self.leading.tolist())):
            found[k] = self._raised(k, self._sum(k, together), most)[0]
        limit = leading[self.leading].max(initial=0.0)
        return np.where(self.decides, np.minimum(found, limit), found)

    def of_outcomes(self, guards: np.ndarray) -> np.ndarray:
        """The error (o, n) of each outcome of every case."""
        terms = _terms(guards, self.size)
        return np.array(
            [self._raised(k, self._sum(k, terms), guards) for k in range(len(self.floor))]
        )

    def _sum(self, k: int, terms: np.ndarray) -> np.ndarray:
        """The sum (n,) of the weights of an outcome: most are zero, so a product of matrices would
        take longer, and does where other processes keep the cores busy."""
        error = np.zeros(terms.shape[1])
        for guard in np.flatnonzero(self.weights[k]):
            error += self.weights[k, guard] * terms[guard]
        return error

    def _raised(self, k: int, error: np.ndarray, guards: np.ndarray) -> np.ndarray:
        """The error (n,) of an outcome, given the sum of its weights."""
        raised = error + self.number[k]
        if np.isfinite(self.factor[k]):
            raised = np.minimum(self.factor[k] * error, raised)
        for guard in np.flatnonzero(self.left_out[k]):
            raised += self.left_out[k, guard] * guards[:, guard]
        return np.asarray(raised + self.floor[k])


def _terms(guards: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The power 3/2 of guards (n, g) over a size (g,), by rows (g, n): guards are of order 6 in the
    length of a step, errors of order 9."""
    share = guards.T / size[:, None]
    return np.asarray(share * np.sqrt(share))


def estimate(
    guards: np.ndarray,
    errors: np.ndarray,
    floor: np.ndarray,
    left_out: np.ndarray,
    decides: np.ndarray,
) -> Estimate:
    """The estimate that trial cases lead to, which have ``guards`` (n, g) and ``errors`` (n, o); it
    is never below a ``floor`` (o,) and what guards say by themselves, ``left_out`` (o, g). An
    outcome's weights are least squares without negative terms. What ``decides`` (o,), see
    `sepmc.campaign.execution.accuracy.decisive`, leads if it comes near the largest error of any
    trial case."""
    size = guards.max(axis=0, initial=0.0)
    size = np.where(size > 0.0, size, 1.0)
    outcomes = errors.shape[1]
    weights = np.zeros((outcomes, len(size)))
    factor, number = np.ones(outcomes), np.zeros(outcomes)
    if len(guards):
        terms = np.ascontiguousarray(_terms(guards, size).T)
        for k, column in enumerate(errors.T):
            finite = np.isfinite(column)  # what is infinitely wrong is told of the whole campaign
            if not finite.any():
                continue
            known, of_known = column[finite], terms[finite]
            fitted = _fitted(of_known, known)
            about = of_known @ fitted
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.where(known > 0.0, known / about, 1.0)
            weights[k], factor[k] = _MARGIN * fitted, max(float(ratio.max()), 1.0)
            number[k] = _MARGIN * max(float((known - about).max()), 0.0)
    leading = np.flatnonzero(decides)
    found = Estimate(size, weights, factor, number, floor, left_out, leading, decides)
    if not len(guards):
        return found
    told = found.of_outcomes(guards)[leading]
    near = (told >= _NEAR * told.max(axis=0, initial=0.0)).any(axis=1)
    return replace(found, leading=leading[near])


def _fitted(terms: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Weights (g,), none negative, by which terms (n, g) add up to about what is known (n,)."""
    weights = np.zeros(terms.shape[1])
    most = float(known.max())
    used = np.flatnonzero(terms.any(axis=0) & (most > 0.0))
    while len(used):
        found = np.linalg.lstsq(terms[:, used], known / most, rcond=1e-9)[0]
        if (found >= 0.0).all():
            weights[used] = most * found
            break
        used = used[found > 0.0]
    return weights
