"""Estimation problem: flights of two bodies that a spring beside their axis separates and turns."""

import tomllib

import numpy as np
import pandas as pd
from small_scenes import SPRUNG

from sepmc.campaign.campaign import Campaign
from sepmc.scene.read import parse_campaign

SPEED, RATE = "separation_speed_m_s", "fore_omega_z_deg_s"
SIGMAS = {SPEED: 0.01, RATE: 0.1}
SAMPLES, END = 60, 0.3
DISPERSED = {
    "spring.push.force_N": {"normal": 2.0},
    "spring.push.point_m.y": {"uniform": [-0.02, 0.02]},
    "body.fore.mass_kg": {"uniform": 0.2},
    "phase.locked.until.time_s": {"triangular": [0.03, 0.05, 0.07]},
    "initial.omega_deg_s.z": {"normal": 1.0},
}
# the load that a model lacks: a jet on the body ahead that turns it, between two times
MISSING = {
    "name": "jet",
    "body": "fore",
    "force_N": [0.0, 0.4, 0.0],
    "point_m": [0.0, 0.0, 0.0],
    "start_s": 0.15,
    "end_s": 0.2,
}


def tree(**more):
    """Tree of the campaign."""
    own = tomllib.loads(SPRUNG)
    own["solver"] = {"accuracy": 1e-8}
    own["spring"][0]["axis"] = [-1.0, 0.0, 0.0]
    return own | {"dispersion": DISPERSED} | more


def campaign(folder, delay_sigma_s=0.0, **more):
    """Campaign with measurements in ``flight.csv`` of a folder."""
    measurements = [
        {"column": name, "file": "flight.csv", "sigma": sigma, "delay_sigma_s": delay_sigma_s}
        for name, sigma in SIGMAS.items()
    ]
    own = tree(measurement=measurements, **more)
    return Campaign(parse_campaign(own, "flight.toml", folder=folder))


def fly(folder, case, noise_seed, delay_s=0.0, noise=1.0, **more):
    """Write ``flight.csv``: a case of the prior with noise, times ``noise`` of sigma; return the
    true inputs. ``more`` are tables that the model lacks."""
    flown = Campaign(parse_campaign(tree(**more), "flight.toml"))
    history = flown.simulate(case, 0.002).drop_duplicates("time_s")
    times = np.linspace(0.002, END - 0.01, SAMPLES)
    random = np.random.default_rng(noise_seed)
    table = {"time_s": times + delay_s}
    for name, sigma in SIGMAS.items():
        values = np.interp(times, history["time_s"], history[name])
        table[name] = values + noise * sigma * random.standard_normal(SAMPLES)
    pd.DataFrame(table).to_csv(folder / "flight.csv", index=False)
    return flown.sample(case, 1)[0]
