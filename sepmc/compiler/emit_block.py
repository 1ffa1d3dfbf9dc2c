"""Lines of a specialised kernel that fly a block of cases: phase after phase, hand-over between them, results; and its entry."""

from sepmc.compiler.emit_context import Context, raw
from sepmc.compiler.emit_geometry import ZERO
from sepmc.compiler.emit_outcomes import emit_results
from sepmc.compiler.shape import Stage
from sepmc.compiler.text import Text
from sepmc.kernels import layout as at
from sepmc.scene.model import GROUND

_ARGUMENTS = (
    ("nominal, slots, draws, steps, usual", "vector(a, 0), indices(a, 1), table(a, 2), indices(a, 3), vector(a, 4)"),
    ("outcomes, ends, status", "table(a, 6), table(a, 7), indices(a, 9)"),
    ("scene, integers, numbers", "record(a, 10), indices(a, 11), vector(a, 12)"),
)


def emit_block(out: Text, c: Context) -> None:
    """The function that flies a block, with its arrays in the order of `sepmc.kernels.blocks.fly`."""
    says = "Fly the cases of a block, LANES from number ``first`` on; ``a`` holds the arrays that come in and go out."
    text = out.function("fly_block(w, first: int, a: Arrays)", says)
    for names, arrays in _ARGUMENTS:
        text(f"{names} = {arrays}")
    text.block("for k in range(SIZE_SHARED):")("w[SHARED + k] = numbers[k]")
    text.block("for k in range(nominal.shape[0]):").lanes()("w[P + k * LANES + l] = nominal[k]")
    text.block("for l in range(LANES):  # the last block is filled up with its last case")("w[UNSOUND + l] = 0.0")
    inner = text.block("for k in range(slots.shape[0]):").lanes()
    inner("value = draws[k, min(first + l, draws.shape[1] - 1)]", "w[P + slots[k] * LANES + l] = value")
    inner("w[UNSOUND + l] += value - value  # not 0 if it is not finite")
    text("prepare(w)")
    if c.slabs.has("AIR"):
        text("centre(w, 0.0)")
    if c.shape.switches:
        text("m = Model(scene, integers, numbers)")
        text(f"p = np.zeros((LANES, {int(c.model.rows_w)}))  # as `sepmc.kernels.stretches` reads it")
        text.lanes().block("for k in range(nominal.shape[0]):")("p[l, k] = w[P + k * LANES + l]")
    for number, stage in enumerate(c.shape.stages):
        _phase(text, c, number, stage)
    emit_results(text, c)


def _phase(text: Text, c: Context, number: int, stage: Stage) -> None:
    """Flight through a phase, in as many stretches as it may have."""
    text(f"# {stage.name}")
    if number == 0 and stage.rows:
        text(f"correct_{stage.name}(w)")
        inner = text.block("for l in range(LANES):  # a start that the joints do not allow")
        inner.block("for k in range(0, 4 * LANES, LANES):")("w[LOST + l] = w[LOST + l] if w[RESIDUAL_NOW + k + l] <= 1e-9 else 1.0")
    if number == 0 and any(GROUND in group and len(group) > 1 for group in stage.groups):
        _stand_still(text, c)
    if number and stage.end_time:
        _begin_timed(text, c, stage)
    if stage.stops > 1:
        text.lanes()("w[DONE + l] = 0.0")
        _stretch(text.block(f"for _ in range({stage.stops}):"), c, number, stage)
    else:
        _stretch(text, c, number, stage)
    if stage.rows:
        text(f"correct_{stage.name}(w)")
        text.block("for e in range(4 * LANES):")("w[RESIDUAL + e] = larger(w[RESIDUAL + e], w[RESIDUAL_NOW + e])")
    c.slabs.add(f"ENDED_{stage.name}", 1)
    inner = text.lanes()
    if number:
        inner(f"w[LOST + l] = w[LOST + l] if w[T + l] >= w[ENDED_{c.shape.stages[number - 1].name} + l] - 1e-12 else 1.0")
    inner(f"w[ENDED_{stage.name} + l] = w[T + l]")
    if number + 1 < len(c.shape.stages):
        _hand_over(text, c, stage, c.shape.stages[number + 1])


def _begin_timed(text: Text, c: Context, stage: Stage) -> None:
    """A time that is past as its phase begins ends it at once; a joint that lets go late is late from then on."""
    late = "" if stage.delay is None else f" + {raw(stage.delay)}"
    told = " + ".join(raw(place) for place in stage.end_time)
    text = text.lanes()
    if stage.after_late is not None:  # its end came while a late joint held on
        text(f"w[LOST + l] = w[LOST + l] if {told} >= w[T + l] - 1e-12 else 1.0")
    text(f"w[UNTIL_{stage.name} + l] = larger({told}, w[T + l]){late}")


def _stand_still(text: Text, c: Context) -> None:
    """A start that turns is lost where a joint holds the vehicle's attitude to the ground: rows that would tell are left out."""
    place = next(f"OMEGA_{body}" for body in c.shape.bodies)
    inner = text.block("for l in range(LANES):  # a vehicle held to the ground that turns")
    inner(f"omega = get3(w, Y + {place} + l)")
    inner("w[LOST + l] = w[LOST + l] if vec3.dot(omega, omega) <= 1e-18 else 1.0")


def _stretch(text: Text, c: Context, number: int, stage: Stage) -> None:
    """Flight to the end of a phase, or to the next event or switch of a load within it."""
    end = f"larger(w[UNTIL_{stage.name} + l], w[T + l])" if stage.end_time else "w[RUN_END + l]"
    inner = text.lanes()
    if stage.stops > 1:
        inner(f"end = w[T + l] if w[DONE + l] > 0.0 else {end}")
    else:
        inner("w[DONE + l] = 0.0", f"end = {end}")
    inner("w[END + l] = end if end < w[RUN_END + l] else w[RUN_END + l]", "w[LONGEST + l] = math.inf")
    for event in stage.events:
        inner(f"w[LAST_{stage.name}_{event.which} + l] = math.inf")
    if c.shape.switches:
        _switches(text, c)
    size = f"{c.shape.active(stage)} * LANES"
    inner = text.block(f"for left in range(steps[{number}], 0, -1):")
    inner(f"advance(w, {number}, {size}, left, usual[{number}])")
    if c.history:
        beyond = "0.1 if left == 1 else 0.0" if stage.events else "0.0"  # the way to an event is not a step of the method
        inner(f"keep(w, {number}, {beyond}, first, a)")
    if stage.events:
        text(f"approach(w, {number}, {size})")
    else:
        text.lanes()("w[T + l] = w[END + l]")


def _switches(text: Text, c: Context) -> None:
    """Stop at the next switch of a load, and note what acts until then."""
    text = text.lanes()
    text("t = w[T + l]", "end = min(w[END + l], next_break(t, m, p[l]))", "w[END + l] = end")
    text("set_stretch(0.5 * (t + end), m, p[l])")
    for i, motor in enumerate(c.shape.scene.motor):
        c.slabs.add(f"BURNING_{motor.name}", 3)
        work = int(c.model.motors_w) + at.MOTOR_WORK * i
        text(f"put3(w, BURNING_{motor.name} + l, vec3.get(p[l], {work + at.BURNING}))")
    for i, load in enumerate(c.shape.scene.load):
        c.slabs.add(f"ACTS_{load.name}", 1)
        text(f"w[ACTS_{load.name} + l] = p[l, {int(c.model.loads_w) + at.LOAD_WORK * i + at.ACTS}]")


def _hand_over(text: Text, c: Context, stage: Stage, after: Stage) -> None:
    """From a phase to the next: who failed to get there, attitudes of bodies that part, what is noted of a release."""
    reached = "w[DONE + l] > 0.0" if stage.ends_by_state else f"w[T + l] >= w[UNTIL_{stage.name} + l]"
    text = text.lanes()
    text(f"w[LOST + l] = w[LOST + l] if {reached} else 1.0")
    for leader in after.leaders:
        old = stage.leader(leader)
        if leader not in stage.leaders and old != GROUND:
            text(f"put4(w, Y + Q_{leader} + l, get4(w, Y + Q_{old} + l))")
            text(f"put3(w, Y + OMEGA_{leader} + l, get3(w, Y + OMEGA_{old} + l))")
            text(f"w[ANGLES_{leader} + l] = w[ANGLES_{old} + l]")
            text(f"w[ANGLES_{leader} + LANES + l] = w[ANGLES_{old} + LANES + l]")
    for joint in after.released:
        text(f"w[RELEASE_{joint} + l] = w[T + l]")
        if joint in c.shape.scene.output.tip_off:
            for body in c.shape.scene.joint[joint].bodies:
                if body != GROUND:
                    c.slabs.add(f"TIP_OFF_{joint}_{body}", 3)
                    leader = stage.leader(body)
                    spin = ZERO if leader == GROUND else f"get3(w, Y + OMEGA_{leader} + l)"
                    text(f"put3(w, TIP_OFF_{joint}_{body} + l, {spin})")
