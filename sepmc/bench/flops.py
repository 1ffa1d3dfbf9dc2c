"""Floating-point operations of a case, counted rather than timed.

An evaluation of the rates of a phase is one function of the kernel, straight-line code over the
lanes. Its operations are counted in the optimised LLVM code: an addition, subtraction,
multiplication, division or square root counts one per lane, so that a fused multiply-add is two;
comparisons, signs and roundings count none. The evaluations of a case are counted by running it
in plain Python. The stage sums follow from the tableau of the method: two operations for each
nonzero coefficient of each integrated number, and one to scale by the step. Set-up, corrections,
event prediction and outcomes are not counted.
"""

import collections
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepmc.bench import subprocess_calls
from sepmc.campaign.campaign import Campaign
from sepmc.campaign.execution.integration import Integration, by_name
from sepmc.campaign.execution.step_selection import kernel_text
from sepmc.engine import interpreted
from sepmc.engine.dispatch import integrate_cases
from sepmc.jit import PLAIN
from sepmc.kernel.emit.compile_units import split
from sepmc.kernel.emit.context import Context
from sepmc.kernel.spec.methods import method
from sepmc.kernel.spec.structure import make_kernel_spec
from sepmc.routines.lanes import LANES
from sepmc.routines.layout import NO_HISTORY
from sepmc.scene.read import parse_campaign
from sepmc.translator.compiler import ENTRY, assembly, optimised

_FUNCTION = re.compile(r"^define[^\n]*?@\"?(\S+?)\"?\(.*?^\}", re.MULTILINE | re.DOTALL)
_ARITHMETIC = re.compile(
    r"= (?:f(?:add|sub|mul|div)|(?:tail )?call[^\n@]*?(?=[^\n]*@llvm\.sqrt)) ?[^\n]*?(?:<(\d+) x "
    r"double>|double)"
)


@dataclass(frozen=True)
class Flops:
    """Floating-point operations (flops) of one case.

    Attributes
    ----------
    evaluations : dict of str to int
        Number of evaluations of the rates of the state in each phase, by its name.
    each : dict of str to float
        Flops of one of these evaluations, by name of the phase.
    rates, sums : float
        Flops of all evaluations, and of all sums of stages of the Runge-Kutta method.
    """

    evaluations: dict[str, int]
    each: dict[str, float]
    rates: float
    sums: float

    @property
    def total(self) -> float:
        """Flops of the case: evaluations and stage sums."""
        return self.rates + self.sums

    @property
    def evaluation(self) -> float:
        """Mean flops of an evaluation, over all evaluations of the case; 0 if it has none."""
        return self.rates / max(1, sum(self.evaluations.values()))


def count(campaign: Campaign, integration: Integration) -> Flops | None:
    """Count the operations of the first case of a campaign in the steps and methods of
    ``integration``: those of the rates of the state, and of the sums of the Runge-Kutta stages.
    The times in which delayed releases are pending do not count. Return None if the compiled code
    does not show those of every phase."""
    shape = make_kernel_spec(campaign.layout, campaign.dispersed)
    phase_names = shape.names.of["phase"]
    solver = integration.one_method
    context = Context(shape, solver or campaign.scene.solver.method, NO_HISTORY)
    segment_of_phase = {
        s.phase: context.alias_of(s) or s.name for s in shape.segments if not s.late
    }
    flops = _flops_by_phase(kernel_text(campaign, solver), segment_of_phase)
    if set(flops) != set(phase_names.values()):
        return None
    names, each = list(phase_names), {name: flops[written] for name, written in phase_names.items()}
    arguments = [
        campaign.file.tree,
        campaign.name,
        integration.steps.tolist(),
        integration.durations.tolist(),
    ]
    arguments += [solver, integration.method_names]
    evaluations = subprocess_calls.call("flops:count_evaluations", arguments, {PLAIN: "1"})
    rates = sum(evaluations[name] * each[name] for name in names)
    sums = 0.0
    for segment, name in zip(shape.segments, integration.method_names, strict=True):
        if not segment.late:
            rk = method(name)
            rows = (*rk.a[1 : rk.stages, : rk.stages], rk.b)
            flops_per_step = sum(2 * int(np.count_nonzero(row)) + 1 for row in rows)
            steps = evaluations[shape.names.back[segment.phase]] / rk.stages
            sums += steps * flops_per_step * shape.active_size(segment)
    return Flops({name: evaluations[name] for name in names}, each, rates, float(sums))


def _flops_by_phase(text: str, segment_of_phase: dict[str, str]) -> dict[str, float]:
    """Return the flops of an evaluation by generated name of the phase, without phases whose code
    does not show them. ``text`` is the source of the kernel; ``segment_of_phase`` names the segment
    with the code of each phase."""
    texts = {unit.name: unit.text for unit in split(text)}
    by_phase = {
        phase: flops_of_unit(texts[f"rates_{segment}"])
        for phase, segment in segment_of_phase.items()
    }
    return {phase: flops for phase, flops in by_phase.items() if flops is not None}


def flops_of_unit(text: str) -> float | None:
    """Compile the source text of a compile unit and return the flops per lane (case) of one call;
    None if its function is not in the compiled code."""
    return flops_in_llvm(str(optimised(assembly(text, ENTRY))), ENTRY)


def flops_in_llvm(code: str, name: str) -> float | None:
    """Return the flops per lane (case) of the function ``name`` in LLVM code; None if it is
    absent."""
    bodies = (match[0] for match in _FUNCTION.finditer(code) if match[1] == name)
    return next(map(_flops_per_lane, bodies), None)


def _flops_per_lane(body: str) -> float:
    """Return the flops per lane (case) of one call of a function, whose LLVM code is ``body``.
    Additions, subtractions, multiplications, divisions and square roots count; other calls count
    nothing. In code with a loop each instruction counts once, else by its vector width."""
    widths = [int(width or 1) for width in _ARITHMETIC.findall(body)]
    # an iteration handles its own lanes, all iterations all of them
    is_loop = " phi " in body
    return float(len(widths)) if is_loop else sum(widths) / LANES


def count_evaluations(
    tree: dict[str, Any],
    name: str,
    steps: list[int],
    durations: list[float],
    solver: str | None,
    methods: list[str],
) -> dict[str, int]:
    """Integrate the first case of a campaign as plain Python; return the number of evaluations of
    the rates by name of the phase.

    It must be called in a process in which formulas run as plain Python (environment variable
    `PLAIN`). ``tree`` and ``name`` are the content and name of the file. ``steps`` and
    ``durations`` are those of an `Integration`, ``solver`` is its `one_method`, ``methods`` its
    `method_names`.
    """
    campaign = Campaign(parse_campaign(tree, name))
    kernel = interpreted.load(kernel_text(campaign, solver))
    module = kernel.plain
    calls: collections.Counter[str] = collections.Counter()

    def counted(phase: str, function: Any) -> Any:
        """Return ``function``, changed to count its calls under ``phase``."""

        def rates(*arguments: Any) -> Any:
            calls[phase] += 1
            return function(*arguments)

        return rates

    phase_names = make_kernel_spec(campaign.layout, campaign.dispersed).names.of["phase"]
    for phase, written in phase_names.items():
        setattr(module, f"rates_{written}", counted(phase, getattr(module, f"rates_{written}")))
    inputs = campaign.sample(0, 1) * campaign.factors
    integrate_cases(
        kernel,
        campaign.layout,
        np.array(steps, dtype=np.int64),
        np.array(durations),
        campaign.slots,
        inputs,
        methods=by_name(kernel, methods),
    )
    return {phase: calls[phase] for phase in phase_names}
