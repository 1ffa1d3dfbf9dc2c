#!/usr/bin/env bash
# SALib 1.6.0: `SALib.analyze.sobol.analyze` of outcomes of which one is NaN gives first-order and
# total indices of exactly 0.0 for every input, without a warning. SALib 1.5.2 gives NaN.
# Seen with Python 3.11, numpy 2.4: y = a + 0.1 b, 256 base samples, indices [0.99, 0.01] without
# the NaN; [0, 0] (1.6.0) and [nan, nan] (1.5.2) with it. A 0 reads as "this input has no effect".
# Remedy: remove whole groups of d + 2 rows in which an outcome is not finite, before the analysis.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/run.py" <<'PY'
import sys
import warnings

import numpy as np
from SALib.analyze import sobol as analysis
from SALib.sample import sobol as sampling

expected = float(sys.argv[1])
problem = {"num_vars": 2, "names": ["a", "b"], "bounds": [[0.0, 1.0], [0.0, 1.0]]}
x = sampling.sample(problem, 256, calc_second_order=False, seed=1)
y = x[:, 0] + 0.1 * x[:, 1]
whole = analysis.analyze(problem, y, calc_second_order=False, seed=1)
y[7] = np.nan
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    lost = analysis.analyze(problem, y, calc_second_order=False, seed=1)
print("all finite:", whole["S1"], " one NaN:", lost["S1"], lost["ST"], " warnings:", len(said))
assert np.allclose(whole["S1"], [0.99, 0.01], atol=0.01)
assert np.array_equal(lost["S1"], [expected] * 2, equal_nan=True)
assert np.array_equal(lost["ST"], [expected] * 2, equal_nan=True)
assert not said
PY
for pair in 1.6.0:0 1.5.2:nan; do
    python3 -m venv "$work/${pair%:*}"
    "$work/${pair%:*}/bin/pip" install --quiet "SALib==${pair%:*}"
    echo "SALib ${pair%:*}"
    "$work/${pair%:*}/bin/python" "$work/run.py" "${pair#*:}"
done
