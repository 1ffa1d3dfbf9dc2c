"""Floating-point operations of a case, counted, not timed.

An evaluation of the rates of a phase is one function of a scene's own kernel, straight-line code
over the lanes. Its operations are counted in the optimised LLVM code: an addition, subtraction,
multiplication, division or square root is one on each lane, so that a fused multiply-add is two,
and comparisons, signs and roundings are none. How many evaluations a case takes is counted by
flying it with the JIT off. The sums of the stages follow from the method's tableau: for each number
that a phase integrates two for every coefficient that is not zero, and one to scale by the step.
Not counted are the set-up, corrections, foretelling of events, and outcomes.

Numba shows the code of what it has compiled itself, not of what was linked, so a process compiles
the function again; the count is kept beside the kernel.
"""

import collections
import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc.bench import subprocess_calls
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.integration import Integration, by_name
from sepmc.campaign.execution.step_selection import kernel_text
from sepmc.engine import interpreted, kernel_cache
from sepmc.engine.dispatch import integrate_cases
from sepmc.jit import BARE
from sepmc.kernel.emit.compile_units import ENTRY, split
from sepmc.kernel.emit.context import Context
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import NO_HISTORY
from sepmc.scene.read import parse_campaign

_FUNCTION = re.compile(r"^define[^\n]*?@\"?(\S+?)\"?\(.*?^\}", re.MULTILINE | re.DOTALL)
_ARITHMETIC = re.compile(
    r"= (?:f(?:add|sub|mul|div)|(?:tail )?call[^\n@]*?(?=[^\n]*@llvm\.sqrt)) ?[^\n]*?(?:<(\d+) x "
    r"double>|double)"
)


@dataclass(frozen=True)
class Flops:
    """Counts of one case: ``evaluations`` and flops of one, by phase; of all evaluations; of the
    sums of stages."""

    evaluations: dict[str, int]
    each: dict[str, float]
    rates: float
    sums: float

    @property
    def total(self) -> float:
        """Flops of a case: all evaluations and the sums of stages."""
        return self.rates + self.sums

    @property
    def evaluation(self) -> float:
        """Flops of an evaluation, the mean over those of a case."""
        return self.rates / max(1, sum(self.evaluations.values()))


def count(campaign: Campaign, flight: Integration) -> Flops | None:
    """Operations of a case of a campaign flown as ``flight`` has it; None if the compiled code does
    not show them."""
    shape = make_kernel_spec(campaign.plan, campaign.dispersed)
    called = shape.names.of["phase"]
    solver = flight.one_method
    context = Context(shape, solver or campaign.scene.solver.method, NO_HISTORY)
    flown = {s.phase: context.alias_of(s) or s.name for s in shape.segments if not s.late}
    found = _each(kernel_text(campaign, solver), flown)
    if set(found) != set(called.values()):
        return None
    names, each = list(called), {name: found[written] for name, written in called.items()}
    asked = [campaign.file.tree, campaign.name, flight.steps.tolist(), flight.durations.tolist()]
    asked += [solver, flight.method_names]
    taken = subprocess_calls.call("flops:evaluations_here", asked, {"NUMBA_DISABLE_JIT": "1"})
    rates = sum(taken[name] * each[name] for name in names)
    sums = 0.0
    for segment, name in zip(shape.segments, flight.method_names, strict=True):
        if not segment.late:
            rk = method(name)
            rows = (*rk.a[1 : rk.stages, : rk.stages], rk.b)
            of_a_step = sum(2 * int(np.count_nonzero(row)) + 1 for row in rows)
            steps_made = taken[shape.names.back[segment.phase]] / rk.stages
            sums += steps_made * of_a_step * shape.active_size(segment)
    return Flops({name: taken[name] for name in names}, each, rates, float(sums))


def _each(text: str, flown: dict[str, str]) -> dict[str, float]:
    """Flops of an evaluation by phase, where the code shows them; ``flown`` names the stage whose
    function it is. From the count kept beside its piece of the kernel if there is one."""
    texts = {piece.name: piece.text for piece in split(text)}
    found: dict[str, float | None] = {}
    for phase, stage in flown.items():
        piece = texts[f"rates_{stage}"]
        kept = kernel_cache.CACHE_FOLDER / f"{kernel_cache.write_modules([piece])[0]}.flops.json"
        if kept.is_file():
            found[phase] = json.loads(kept.read_text(encoding="utf-8"))
            continue
        found[phase] = subprocess_calls.call("flops:flops_here", [piece], {BARE: "1"})
        if found[phase] is not None:
            kept.write_text(json.dumps(found[phase]), encoding="utf-8")
    return {phase: flops for phase, flops in found.items() if flops is not None}


def flops_here(piece: str) -> float | None:
    """Flops of an evaluation by a piece of a kernel, which is compiled here."""
    module = kernel_cache.load_module(kernel_cache.write_modules([piece])[0])
    return in_code(getattr(module, ENTRY)._library.get_llvm_str(), ENTRY)


def in_code(code: str, name: str) -> float | None:
    """Flops for one lane of a function, in LLVM code; None if it is not there."""
    found = [  # as Numba mangles it: its length, itself, its version
        _of_a_lane(match[0])
        for match in _FUNCTION.finditer(code)
        if f"{len(name)}{name}B" in match[1]
    ]
    return max(found, default=None)  # what calls it from outside has none


def _of_a_lane(body: str) -> float:
    widths = [int(width or 1) for width in _ARITHMETIC.findall(body)]
    # then an operation serves its own lanes in a turn, and all turns serve all
    looped = " phi " in body
    return float(len(widths)) if looped else sum(widths) / LANES


def evaluations_here(
    tree: dict[str, Any],
    name: str,
    steps: list[int],
    usual: list[float],
    solver: str | None,
    methods: list[str],
) -> dict[str, int]:
    """Evaluations that a case takes, by phase. With the JIT off, where the kernel's functions are
    plain Python."""
    campaign = Campaign(parse_campaign(tree, name))
    kernel = interpreted.load(kernel_text(campaign, solver))
    module = kernel.plain
    seen: collections.Counter[str] = collections.Counter()

    def counted(phase: str, function: Any) -> Any:
        def rates(*arguments: Any) -> Any:
            seen[phase] += 1
            return function(*arguments)

        return rates

    called = make_kernel_spec(campaign.plan, campaign.dispersed).names.of["phase"]
    for phase, written in called.items():
        setattr(module, f"rates_{written}", counted(phase, getattr(module, f"rates_{written}")))
    drawn = campaign.sample(0, 1) * campaign.factors
    integrate_cases(
        kernel,
        campaign.plan,
        np.array(steps, dtype=np.int64),
        np.array(usual),
        campaign.slots,
        drawn,
        methods=by_name(kernel, methods),
    )
    return {phase: seen[phase] for phase in called}
