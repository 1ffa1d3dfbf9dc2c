"""Two asymmetric bodies that turn while they are pushed, run interpreted and compared with
independent simulations."""

import math

import numpy as np
from numpy.testing import assert_allclose
from oracles import independent

BOTH = ["fore", "aft"]
PUSH = {
    "name": "push",
    "body": "aft",
    "force_N": [-6.0, 1.0, -0.5],
    "moment_N_m": [0.2, 0.3, -0.4],
    "point_m": [3.2, 0.1, 0.0],
}
LOPSIDED = {
    "body.fore.cg_m": [1.0, 0.05, -0.02],
    "body.aft.cg_m": [3.0, -0.04, 0.03],
    "body.aft.inertia_products_kg_m2": [0.2, -0.1, 0.15],
}
TURNING = LOPSIDED | {
    "initial.omega_rad_s": [0.3, 0.2, -0.4],
    "load": [PUSH],
    "run.end_time_s": 0.4,
    "solver.step_s": 0.01,
}
MID = {"body.mid": {"mass_kg": 2.0, "inertia_kg_m2": [1.0, 1.5, 1.2], "cg_m": [2.0, 0.1, 0.0]}}


def alone(campaign):
    """Status of the nominal case, and its outcomes by name."""
    attributes = campaign.simulate(step_s=0.25 * campaign.scene.run.end_time).attrs
    return attributes["status"], attributes["outcomes"]


def by_independent_flights(campaign, count):
    """Statuses (n,) and outcomes (n, o), SI, of the first cases of a campaign by independent
    simulations."""
    flown, columns = (
        [independent.simulate(campaign.case(i).to_dict()) for i in range(count)],
        campaign.outcome_columns,
    )
    return [one.status for one in flown], np.array(
        [[one.outcomes.get(c.name, np.nan) / c.scale for c in columns] for one in flown]
    )


def agrees(campaign, unclear=("force_time_s", "moment_time_s")):
    """Check all outcomes of the nominal case against the independent simulation, but for those in
    ``unclear``, such as the time of a peak, which is as uncertain as the peak is flat. Returns the
    outcomes by name."""
    (status, outcomes), other = alone(campaign), independent.simulate(campaign.nominal().to_dict())
    assert status == other.status == "ok"
    compared = 0
    for column in campaign.outcome_columns:
        if column.name in other.outcomes and not column.name.endswith(unclear):
            expected = other.outcomes[column.name]
            assert_allclose(
                outcomes[column.name], expected, rtol=2e-8, atol=1e-8, err_msg=column.name
            )
            compared += not math.isnan(expected)
    assert compared > 20
    return outcomes


def without_steps(settings):
    """Settings without a given step."""
    return {key: value for key, value in settings.items() if key != "solver.step_s"}
