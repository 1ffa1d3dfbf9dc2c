"""The kernels are plain Python too: with the JIT off they give the compiled answer, so coverage and
debuggers see them."""

import json
import os
import subprocess
import sys

import numpy as np

import sepmc

PROGRAM = """
import json, sepmc
from sepmc.campaign.execution import step_selection
step_selection.SAMPLE = 8
campaign = sepmc.load("table2.toml", {"run.history_step_s": 0.1, "solver.step_s": 0.25})
result = campaign.run(cases=2, seed=7)
print(json.dumps(result.to_pandas().drop(columns="status").to_dict("list")))
"""


def test_python_and_compiled_agree():
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment, check=True
    )
    python = json.loads(done.stdout)
    compiled = (
        sepmc.load("table2.toml", {"run.history_step_s": 0.1, "solver.step_s": 0.25})
        .run(cases=2, seed=7)
        .to_pandas()
    )
    assert 0.0 < max(python.pop("error")) < 1e-3  # of other trial cases
    for name, values in python.items():
        # round-off itself
        if not name.endswith("_residual_m") and not name.endswith("_residual_rad"):
            np.testing.assert_allclose(compiled[name], values, rtol=1e-9, atol=1e-10, err_msg=name)
