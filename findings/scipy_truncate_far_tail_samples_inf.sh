#!/usr/bin/env bash
# scipy 1.17.1: `scipy.stats.truncate(scipy.stats.Normal(), 9, 10)` samples only infinity, and its
# `icdf` gives infinity, without a warning; its mean (9.108) and `ccdf` are right. `truncate` inverts
# the cdf, which is 1.0 in double precision from 8.3 sigma on. The same cut on the other side,
# `truncate(Normal(), -10, -9)`, and the older `truncnorm(9, 10)` sample finite numbers.
# Seen with Python 3.11, numpy 2.4.6: 1,000 of 1,000 samples are inf.
# Remedy: reflect the cut to the lower tail, or use `scipy.stats.truncnorm`.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/env"
"$work/env/bin/pip" install --quiet scipy==1.17.1 numpy==2.4.6
"$work/env/bin/python" -W error::RuntimeWarning - <<'PY'
import numpy as np
from scipy.stats import Normal, truncate, truncnorm

rng = np.random.default_rng(1)
upper = truncate(Normal(), 9, 10)
samples = upper.sample(shape=1000, rng=rng)
lower = truncate(Normal(), -10, -9).sample(shape=1000, rng=rng)
old = truncnorm(9, 10).rvs(1000, random_state=rng)
print("upper tail, infinite:", np.isinf(samples).sum(), " icdf(0.5):", upper.icdf(0.5))
print("mean:", upper.mean(), " mean of the mirrored samples:", -lower.mean(), " truncnorm:", old.mean())
assert np.isinf(samples).all() and np.isinf(upper.icdf(0.5))
assert abs(upper.mean() - 9.1085) < 1e-3
assert abs(lower.mean() + 9.1085) < 0.02 and abs(old.mean() - 9.1085) < 0.02
PY
