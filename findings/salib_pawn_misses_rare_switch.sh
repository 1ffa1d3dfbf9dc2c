#!/usr/bin/env bash
# SALib 1.6.0: PAWN ranks an input that decides the outcome in 5 % of the cases with inputs that
# have no effect. Input a is 1 in 5 % of 4,000 cases and 0 otherwise (a failure that happens or
# not); y = 10 a + noise of sigma 1, so a explains 84 % of the variance; b, c and d do nothing.
# Seen with S = 10: medians of a, b, c, d 0.055, 0.038, 0.045, 0.040; maxima 0.055, 0.049, 0.069,
# 0.063: by the maximum c and d stand before a. The slices are cut at quantiles of the input: a,
# which is tied, has one slice that holds anything, that of 0, and the 5 % that matter are in none.
# Remedy: do not use PAWN where an input is discrete; compare outcomes by the input's values.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/env"
"$work/env/bin/pip" install --quiet SALib==1.6.0 numpy==2.4.6
"$work/env/bin/python" - <<'PY'
import numpy as np
from SALib.analyze import pawn

rng = np.random.default_rng(1)
x = rng.random((4000, 4))
x[:, 0] = rng.random(4000) < 0.05
y = 10.0 * x[:, 0] + rng.normal(size=4000)
problem = {"num_vars": 4, "names": list("abcd"), "bounds": [[0.0, 1.0]] * 4}
indices = pawn.analyze(problem, x, y, S=10)
explained = np.corrcoef(x[:, 0], y)[0, 1] ** 2
print("a explains", round(explained, 3), "of the variance")
print("median:", indices["median"], " maximum:", indices["maximum"])
assert explained > 0.8
assert indices["median"][0] < 1.5 * indices["median"][1:].max()
assert indices["maximum"][0] < indices["maximum"][1:].max()
PY
