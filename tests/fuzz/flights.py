"""Compiled kernels with extreme numbers: a row is ok with numbers, or has another status and none;
ok rows agree with the independent simulation."""

import math
import pickle
import tomllib
from functools import partial

import numpy as np
from oracles.random_scenes import compare

from fuzz import mutate
from fuzz.watch import Wrong, turns
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution import step_selection
from sepmc.campaign.execution.integration import integrate
from sepmc.scene.messages import SceneError, no_log
from sepmc.scene.read import parse_campaign
from sepmc.schema import Status

# campaigns whose kernels are compiled once
SCENES = ("campaigns/table2.toml", "campaigns/spring-pushers.toml", "tests/scenes/gust.toml")
_KEPT = ("run", "solver", "name", "title", "requirement", "reference", "output", "event")
_ODD = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-300, 1e-30, 1e10, 1e30, 1e60, 1e200, -1e60)
_CASES, _COMPARED, _JUDGED = 12, 2, 0.3
_SLOW_S = 60.0


def _trees():
    texts = mutate.bases()
    return {name: tomllib.loads(texts[name]) for name in SCENES}


def _campaign(tree):
    return Campaign(parse_campaign(pickle.loads(pickle.dumps(tree)), "fuzz"))


def rows(rng, count, until, tried):
    """Rows of inputs in blocks of 64, some of them far outside of the distributions."""
    flights = []
    for tree in _trees().values():
        campaign = _campaign(tree)
        flights.append((campaign, step_selection.select_steps(campaign, announce=no_log)))
    for _ in turns(count, until, tried):
        campaign, flight = rng.choice(flights)
        draws = campaign.in_si(campaign.sample(rng.randrange(10**6), 64))
        odd = np.zeros(draws.shape, dtype=bool)
        for _ in range(rng.choice((1, 2, 8))):
            at = rng.randrange(len(draws)), rng.randrange(draws.shape[1])
            factor = rng.choice((-1.0, 0.0, 0.1, 10.0, 1e3, 1e-3))
            draws[at] = rng.choice(_ODD) if rng.random() < 0.5 else float(draws[at]) * factor
            odd[at] = True
        said, act = (campaign.name, draws[odd].tolist()), partial(_rows, campaign, flight, draws)
        if tried.look(said, act, 60.0, works=True):
            tried.counts["rows"] += len(draws)


def _rows(campaign, flight, draws):
    bad = ~np.isfinite(draws).all(axis=1)
    block = integrate(campaign, flight, draws)
    columns = campaign.outcome_columns
    told = {c.name: x for c, x in zip(columns, block.outcomes.T, strict=False)}
    honest(campaign, [Status(int(s)).label for s in block.status], told, bad)
    return True


def numbers(rng, count, until, tried):
    """Campaigns with other numbers, by the compiled kernels."""
    trees = _trees()
    for tree in trees.values():
        step_selection.select_steps(_campaign(tree), announce=no_log)
    for _ in turns(count, until, tried):
        name = rng.choice(list(trees))
        tree = pickle.loads(pickle.dumps(trees[name]))
        places = [
            (node, key)
            for kept in tree
            if kept not in _KEPT
            for node, key in [(tree, kept), *mutate.slots({kept: tree[kept]})]
            if isinstance(node[key], float)
        ]
        for _ in range(rng.choice((1, 1, 2, 4))):
            node, key = rng.choice(places)
            if node[key] != 0.0:
                odd = rng.random() < 0.2
                node[key] = rng.choice(mutate.NUMBERS) if odd else mutate.scaled(node[key], rng)
        try:
            campaign = _campaign(tree)
            text = step_selection.kernel_text(campaign, history=campaign.has_histories)
        except SceneError:
            tried.counts["refused"] += 1
            continue
        if step_selection.units_to_compile(text)[0]:
            tried.counts["another kernel"] += 1
            continue
        tried.look(tree, lambda c=campaign: _flown(c, tried), _SLOW_S, works=True)
        if rng.random() < _JUDGED:
            tried.counts["compared"] += 1
            tried.look(tree, lambda t=tree: _compared(t, tried), _SLOW_S, works=True)


def _flown(campaign, tried):
    result = campaign.run(_CASES, announce=no_log)
    table = result.table
    tried.counts["rows"] += len(table["case"])
    if sum(result.status_counts.values()) != _CASES:
        raise Wrong("cases are missing in the counts")
    for name in set(table["status"]):
        tried.counts[f"status {name}"] += int(np.count_nonzero(table["status"] == name))
    told = {c.name: table[c.name] for c in campaign.outcome_columns}
    honest(campaign, list(table["status"]), told, np.zeros(_CASES, dtype=bool))
    stats = result.statistics()
    ok = table["status"] == "ok"
    for name, n in stats["n"].items():
        if n != np.count_nonzero(np.isfinite(table[name][ok])):
            raise Wrong(f"{name}: statistics of {n} values")


def honest(campaign, statuses, told, bad):
    """Check that ok rows have numbers (but for columns that may be NaN), that other rows have none,
    and that rows without inputs are not ok."""
    status = np.array(statuses)
    meaning = {c.name: c.meaning for c in campaign.outcome_columns}
    events = tuple(f"{event.name}_" for event in campaign.scene.event)
    if (bad & (status == "ok")).any():
        raise Wrong("a row of inputs that are no numbers is ok")
    ended, lost = status == "ok", ~np.isin(status, ("ok", "never-released"))
    for name, values in told.items():
        if np.isfinite(values[lost]).any():
            raise Wrong(f"{name} is a number where the status is {status[lost][0]}")
        if np.isinf(values).any():
            raise Wrong(f"{name} is infinite")
        may = "NaN" in meaning[name] or name.startswith(events or ("\0",))
        if not may and np.isnan(values[ended]).any():
            raise Wrong(f"{name} is NaN where the status is ok")


def _compared(tree, tried):
    verdict = compare.judge(tree, "fuzz", cases=_COMPARED)
    for kind, count in verdict.rows.items():
        tried.counts[f"verdict {kind}"] += count
    if verdict.not_flown:
        tried.counts["not compared"] += 1
    if verdict.fails:
        raise Wrong(f"{verdict.rows} {verdict.said[:2]} {verdict.crash}")
