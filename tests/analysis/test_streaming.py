"""Statistics of cases that pass by once are those of the whole table, whatever the chunks, in
constant memory."""

import pickle
import tracemalloc
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from sepmc.analysis import row_statistics
from sepmc.analysis.quantile_sketch import EXACT_VALUES, QuantileSketch
from sepmc.analysis.row_statistics import TableStatistics
from sepmc.analysis.statistics import PERCENTILES
from sepmc.analysis.streaming import ACCUMULATION_BLOCK, MAX_NAMED, StreamingStatistics
from sepmc.scene.model import Requirement
from sepmc.schema import Status

PERCENTS = list(PERCENTILES.values())
COLUMNS = (["speed_m_s", "release_s"], ["gap", "smallest_pivot"], {"gap": 1.0})
LABELS = np.array([status.label for status in Status], dtype=object)


def table(codes, data):
    return {
        "case": np.arange(len(codes)),
        "status": LABELS[codes],
        **dict(zip(COLUMNS[0] + COLUMNS[1], data, strict=True)),
    }


def streamed(codes, data, sizes):
    """A stream that was given the cases in chunks of these sizes, over and over."""
    stream, first, turn = StreamingStatistics(*COLUMNS), 0, 0
    while first < len(codes):
        end = min(first + sizes[turn % len(sizes)], len(codes))
        stream.add(
            np.arange(first, end), codes[first:end], np.ascontiguousarray(data[:, first:end])
        )
        first, turn = end, turn + 1
    return stream


NUMBER = st.one_of(st.floats(-1e3, 1e3, allow_subnormal=False), st.just(np.nan), st.just(7.0))
CASE = st.tuples(st.sampled_from([0, 0, 0, 1, 5]), *[NUMBER] * 4)


@given(
    cases=st.lists(CASE, min_size=1, max_size=60),
    sizes=st.lists(st.integers(1, 20), min_size=1, max_size=4),
)
@settings(deadline=None, max_examples=150)
def test_streaming_equals_table(cases, sizes):
    """Everything a table of rows gives, from any data with NaN and failed cases."""
    codes, data = np.array([case[0] for case in cases]), np.array([case[1:] for case in cases]).T
    stream, whole = streamed(codes, data, sizes), TableStatistics(table(codes, data), *COLUMNS)
    reference = {"speed_m_s": {"mean": 1.0, "sigma": 2.0}}
    result, expected = stream.statistics(reference), whole.statistics(reference)
    pd.testing.assert_frame_equal(
        result, expected, rtol=1e-9, atol=1e-9 * max(1.0, np.nanmax(np.abs(data), initial=0.0))
    )
    exact = ["n", "min", "max", "case_min", "case_max", *PERCENTILES]
    exact += [f"{name}_{end}" for name in PERCENTILES for end in ("low", "high")]
    pd.testing.assert_frame_equal(result[exact], expected[exact], check_exact=True)
    pd.testing.assert_frame_equal(stream.audit(), whole.audit(), check_exact=True)
    assert stream.counts == whole.counts
    assert stream.failed == whole.failed
    for name in COLUMNS[0]:
        one, other = stream.histogram(name), whole.histogram(name)
        assert (one is None) == (other is None)
        if one and other:
            assert_array_equal(one.counts, other.counts)
            assert_array_equal(one.edges, other.edges)


LAWS = {
    "normal": lambda rng, n: rng.normal(1e3, 2.0, n),
    "uniform": lambda rng, n: rng.uniform(-1.0, 1.0, n),
    "skew": lambda rng, n: rng.gamma(0.5, 1.0, n),
    "heavy": lambda rng, n: np.exp(2.0 * rng.normal(size=n)),
    "student": lambda rng, n: rng.standard_t(3, n),
    "atom": lambda rng, n: np.where(rng.random(n) < 0.6, 0.0, rng.normal(size=n)),
    "two": lambda rng, n: np.where(rng.random(n) < 1e-3, 1e3, 0.0) + rng.normal(size=n),
    # beyond the grid that was laid out
    "late": lambda rng, n: np.concatenate(
        [rng.normal(size=EXACT_VALUES), rng.normal(50.0, 5.0, n - EXACT_VALUES)]
    ),
}


def test_a_histogram_keeps_values_of_many_cases_together():
    """Such as times of release, of few values: as counted by their rows, in whole cases."""
    rng = np.random.default_rng(2019)
    x = rng.choice([0.035, 0.04, 0.045, 0.05, 0.055], 100_000)
    x[::3] += rng.normal(0.0, 0.01, len(x[::3]))
    sketch = QuantileSketch()
    sketch.add(x)
    edges = np.histogram_bin_edges(x, 60)
    counts = sketch.histogram(edges)
    assert_array_equal(counts, np.rint(counts))
    assert np.abs(counts - np.histogram(x, edges)[0]).max() <= 0.001 * x.size


@pytest.mark.parametrize("law", LAWS)
def test_percentiles_of_many(law):
    """Within 0.5 % of sigma of the exact ones, in the tails too."""
    x = LAWS[law](np.random.default_rng(2019), 100_000)
    sketch = QuantileSketch()
    sketch.add(x)
    error = np.abs(sketch.percentiles(PERCENTS) - np.percentile(x, PERCENTS)) / x.std()
    assert error.max() <= (0.02 if law == "late" else 0.005)
    edges = np.histogram_bin_edges(x, 40)
    counts = sketch.histogram(edges)
    assert counts.sum() == pytest.approx(x.size)
    assert (
        np.abs(counts - np.histogram(x, edges)[0]).max()
        <= (0.01 if law == "late" else 0.001) * x.size
    )


@pytest.mark.parametrize(
    "values", [(0.0, 1.0), (-3.0,), (5.0, 6.0, 7.0), (1e300, -1e300), (1e-300, 0.0)]
)
def test_a_few_values_are_answered_as_they_are(values):
    """Flags and counts are no continuum."""
    x = np.random.default_rng(1).choice(values, 2 * EXACT_VALUES)
    sketch = QuantileSketch()
    sketch.add(x)
    assert set(sketch.percentiles(PERCENTS)) <= set(values)


def test_infinities_of_many():
    x = np.random.default_rng(1).normal(size=3 * EXACT_VALUES)
    x[::100], x[1::300] = np.inf, -np.inf
    sketch = QuantileSketch()
    sketch.add(x)
    result = sketch.percentiles([0.1, 1.0, 50.0, 98.0, 99.9])
    assert (result[0], result[-1]) == (-np.inf, np.inf)
    assert_allclose(result[1:-1], np.percentile(x, [1.0, 50.0, 98.0]), atol=1e-3)
    stream = streamed(np.zeros(x.size, dtype=int), np.tile(np.abs(x), (4, 1)), [ACCUMULATION_BLOCK])
    row = stream.statistics().loc["speed_m_s"]
    assert row["mean"] == row["max"] == np.inf
    assert np.isnan(row["sigma"])
    assert stream.histogram("speed_m_s") is None


def test_same_bits_for_any_chunks():
    """Past the layout of the grid, with failed cases and values that are none."""
    rng = np.random.default_rng(3)
    n = EXACT_VALUES + 3 * ACCUMULATION_BLOCK + 17
    codes, data = (rng.random(n) < 0.01).astype(int) * 5, rng.normal(1e6, 1.0, (4, n))
    data[1, ::7] = np.nan
    first = streamed(codes, data, [n])
    for sizes in (
        [ACCUMULATION_BLOCK],
        [1000],
        [ACCUMULATION_BLOCK - 1, 3, 5000],
        [3 * ACCUMULATION_BLOCK + 1],
    ):
        other = streamed(codes, data, sizes)
        pd.testing.assert_frame_equal(other.statistics(), first.statistics(), check_exact=True)
        pd.testing.assert_frame_equal(other.audit(), first.audit(), check_exact=True)
        assert_array_equal(other.histogram("speed_m_s").counts, first.histogram("speed_m_s").counts)
        assert other.failed == first.failed
    assert len(first.failed["not-finite"]) == MAX_NAMED
    whole = TableStatistics(table(codes, data), *COLUMNS)
    assert first.counts == whole.counts
    result, expected = first.statistics().loc["release_s"], whole.statistics().loc["release_s"]
    # a mean of a million sigmas costs no digits
    for name in ("mean", "sigma", "mean_se", "sigma_se"):
        assert result[name] == pytest.approx(expected[name], rel=1e-10)
    assert (result["n"], result["case_min"], result["case_max"]) == (
        expected["n"],
        expected["case_min"],
        expected["case_max"],
    )


@pytest.mark.parametrize("begun", [0, ACCUMULATION_BLOCK, EXACT_VALUES + ACCUMULATION_BLOCK])
def test_the_same_bits_by_many(begun):
    """Ranges counted apart, in any order and after a pickle, and taken in the order of cases;
    before and after the grid of an outcome is known, with NaN, infinities and failed cases."""
    required = [
        Requirement(name="slow", metric="speed_m_s", at_most=3.0),
        Requirement(name="between", metric="release_s", at_least=-2.0, at_most=2.0),
        Requirement(name="released", metric="never-released"),
    ]
    random, count = np.random.default_rng(5), EXACT_VALUES + 5 * ACCUMULATION_BLOCK + 77
    codes = np.where(random.random(count) < 0.01, int(Status.NEVER_RELEASED), 0)
    data = random.normal(size=(4, count))
    data[1, random.random(count) < 0.5] = np.nan  # its grid comes later
    data[0, -5:], numbers = [np.inf, 1e9, -1e9, 2.0, 2.0], np.arange(count)
    alone, many = StreamingStatistics(*COLUMNS, required), StreamingStatistics(*COLUMNS, required)
    alone.add(numbers, codes, data)
    many.add(numbers[:begun], codes[:begun], data[:, :begun])
    fences = [*range(begun, count, 2 * ACCUMULATION_BLOCK), count]
    kept = {}
    for first, end in reversed(list(pairwise(fences))):
        separate = many.new_partial()
        separate.add(numbers[first:end], codes[first:end], data[:, first:end])
        kept[first] = pickle.dumps(separate)
    for first in sorted(kept):
        many.merge(pickle.loads(kept[first]))
    pd.testing.assert_frame_equal(many.statistics(), alone.statistics(), check_exact=True)
    pd.testing.assert_frame_equal(many.audit(), alone.audit(), check_exact=True)
    assert many.counts == alone.counts
    assert many.failed == alone.failed
    for name in COLUMNS[0]:
        pd.testing.assert_frame_equal(
            pd.DataFrame(many.histogram(name)), pd.DataFrame(alone.histogram(name))
        )
    given = {name: (1e-9, 1.0) for name in COLUMNS[0]}, alone.audit()
    assert many.verdicts(*given) == alone.verdicts(*given)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_neither_underflow_nor_overflow(size):
    data = np.tile(np.array([30.0, 10.0, 50.0, 20.0, 40.0]) * size, (4, 1))
    row = streamed(np.zeros(5, dtype=int), data, [2]).statistics().loc["speed_m_s"]
    assert row["sigma_se"] / size == pytest.approx(np.sqrt(7350.0) / (2 * np.sqrt(250.0)))


def test_memory_does_not_grow():
    def peak(turns):
        rng, codes = np.random.default_rng(1), np.zeros(ACCUMULATION_BLOCK, dtype=int)
        tracemalloc.start()
        stream = StreamingStatistics(*COLUMNS)
        for turn in range(turns):
            stream.add(
                np.arange(turn * ACCUMULATION_BLOCK, (turn + 1) * ACCUMULATION_BLOCK),
                codes,
                rng.standard_t(3, (4, ACCUMULATION_BLOCK)),
            )
        stream.statistics()
        result = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return result

    assert peak(60) <= 1.05 * peak(6)


def test_a_table_too_long_to_be_sorted_is_streamed(monkeypatch):
    """The same figures, a part at a time."""
    rng = np.random.default_rng(5)
    codes, data = rng.choice([0, 0, 0, 2], 500), rng.normal(size=(4, 500))

    class Stored(dict):
        rows = 500

        def batches(self, names):
            assert names == [*COLUMNS[0], *COLUMNS[1]]
            for first in range(0, 500, 120):
                part = slice(first, first + 120)
                yield (
                    self["case"][part],
                    pd.Categorical(self["status"][part]),
                    np.array([self[name][part] for name in names]),
                )

    stored = Stored(table(codes, data))
    whole = row_statistics.summarise(stored, *COLUMNS)
    monkeypatch.setattr(row_statistics, "MAX_EXACT_CASES", 499)
    other = row_statistics.summarise(stored, *COLUMNS)
    assert isinstance(whole, TableStatistics)
    assert isinstance(other, StreamingStatistics)
    pd.testing.assert_frame_equal(other.statistics(), whole.statistics(), rtol=1e-12)
    assert other.counts == whole.counts
