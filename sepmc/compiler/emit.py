"""Writes the kernel of one scene: a readable Python module that calls the physics this scene needs, in order, and nothing else.

The module flies LANES cases side by side. Sizes and places are constants in it, masses and coefficients are data: scenes of the same
shape share it. `sepmc check --code` prints it.
"""

from collections.abc import Callable

from sepmc.compiler.emit_loads import emit_load_parameters, emit_loads
from sepmc.compiler.emit_prepare import emit_start, raw
from sepmc.compiler.emit_rows import Geometry, emit_event, emit_rows, emit_separation
from sepmc.compiler.shape import Shape, Stage
from sepmc.compiler.text import Slabs, Text
from sepmc.kernels import layout as at
from sepmc.kernels.methods import Method, method
from sepmc.scene.model import GROUND

_HEADER = '''"""{title}

Written by sepmc for scenes of this shape; not edited by hand. {about}
"""

import math

import numpy as np

from sepmc.kernels import joints, quat, springs, vec3
from sepmc.kernels._jit import keep_apart, stage
from sepmc.kernels.blocks import block, entry, indices, record, table, vector
from sepmc.kernels.aerodynamics import aero_force, aero_moment, flow_angles
from sepmc.kernels.atmosphere import density_in_layer, geopotential, layer
from sepmc.kernels.gravity import inverse_square
from sepmc.kernels.lanes import LANES, get3, get4, get6, larger, nearest_turn, put3, put4, put6, time_left
from sepmc.kernels.layout import Model
from sepmc.kernels.methods import method
from sepmc.kernels.observe import SINE_SINGULAR
from sepmc.kernels.prepare import arm, flight_direction, inertia_tensor
from sepmc.kernels.propulsion import building_up, tail_off, thrust_arm, thrust_direction
from sepmc.kernels.stretches import next_break, set_stretch
from sepmc.kernels.wind import wind
'''


def emit(shape: Shape, method_name: str, history: bool = False) -> str:
    """Text of the module that flies scenes of a shape with a Runge-Kutta method; with ``history``, it also writes separations over time."""
    return _Writer(shape, method(method_name), history and bool(shape.scene.joint)).module()


class _Writer:
    def __init__(self, shape: Shape, rk: Method, history: bool):
        self.shape, self.rk, self.history = shape, rk, history
        self.slabs = Slabs()
        self.parameters, self.shared = Text(2), Text(1)  # of the function that sets up the lanes: of each, and before the loop over them
        self.size = 13 * len(shape.bodies)
        self.seeks = any(stage.events for stage in shape.stages)

    def module(self) -> str:
        """The whole text: the head comes last, when all slabs are known."""
        for name in ("Y", "S", "D", "STEP"):  # state; state of a stage, its derivative; length of the step, for every number of a state
            self.slabs.add(name, self.size)
        for i in range(1, (len(self.rk.dense) if self.history else len(self.rk.b)) + 1):  # in this order and without a gap
            self.slabs.add(f"K{i}", self.size)
        for name in ("T", "CLOCK", "END", "RUN_END", "DONE", "DRIFT", "TURNED_FAR", "LOST", "EVENT_ERROR", "STEPS"):
            self.slabs.add(name, 1)
        self.slabs.add("RESIDUAL", 4), self.slabs.add("RESIDUAL_NOW", 4)
        body = Text()
        for stage in self.shape.stages:
            self._rates(body, stage)
        self._by_phase(body, "rates", "Derivative D of the state S at the times CLOCK.", lambda stage: f"rates_{stage.name}(w)")
        for stage in self.shape.stages:
            if stage.rows:
                self._correct(body, stage)
            if stage.events:
                self._aim(body, stage)
        self._lengths(body)
        self._settle(body)
        if self.history:
            self._extension(body)
        self._step(body, self.rk, "advance")
        if self.seeks:
            self._step(body, method("rk4"), "approach")
        self._finish(body)
        self._lanes(body)
        self._door(body)
        head = Text()
        head.lines += _HEADER.format(title=self._title(), about=self._about()).rstrip().split("\n")
        head("", f"# The method: {self.rk.name}, order {self.rk.order}. Row i of the stage matrix, weights, nodes.")
        head.lines += _coefficients(self.rk)
        if self.history:
            head("# Of its continuous extension: the stage matrix, nodes, and coefficients by powers of the share of a step.")
            head(f"_METHOD = method({self.rk.name!r})", "A, C, DENSE = _METHOD.a, _METHOD.c, np.ascontiguousarray(_METHOD.dense.T)")
        head("", "# Slabs of the workspace of a block of cases, and the places of bodies in a state.")
        head.lines += self.slabs.lines()
        head.lines += self._places()
        return "\n".join(head.lines + body.lines) + "\n"

    def _title(self) -> str:
        bodies, phases = ", ".join(self.shape.bodies), ", ".join(stage.name for stage in self.shape.stages)
        return f"Flight of {bodies} through the phases {phases}."

    def _about(self) -> str:
        return "Not in it, because these scenes do not need it:\n" + ", ".join(features(self.shape)[1]) + "."

    def _places(self) -> list[str]:
        lines = []
        for i, body in enumerate(self.shape.bodies):
            lines += [f"X_{body}, V_{body} = {6 * i} * LANES, {6 * i + 3} * LANES"]
        start = 6 * len(self.shape.bodies)
        for i, body in enumerate(self.shape.turning):
            lines += [f"Q_{body}, OMEGA_{body} = {start + 7 * i} * LANES, {start + 7 * i + 4} * LANES"]
        return lines

    def _function(self, out: Text, signature: str, says: str) -> Text:
        """Head of a function; returns where its lines go."""
        out("", "", "@stage", f"def {signature}:")
        if len(says) > 120:
            cut = says.rindex(" ", 0, 118)
            out(f'    """{says[:cut]}', f"    {says[cut + 1 :]}", '    """', "    keep_apart()")
        else:
            out(f'    """{says}"""', "    keep_apart()")
        return out.indented(1)

    def _by_phase(self, out: Text, name: str, says: str, call: Callable[[Stage], str]) -> None:
        """A function that does what the phase needs."""
        text = self._function(out, f"{name}(w, phase)", says)
        for number, stage in enumerate(self.shape.stages):
            text(f"{'elif' if number else 'if'} phase == {number}:", f"    {call(stage)}")

    # -- the right-hand side ------------------------------------------------------------------------------------------------------

    def _motion(self, text: Text, stage: Stage, state: str) -> Geometry:
        """Attitudes, rates, places and speeds of bodies at a state, as local names."""
        g = Geometry(self.shape, stage, self.slabs, self.parameters, self.shared)
        for leader in stage.leaders:
            text(f"q_{leader}, omega_{leader} = get4(w, {state} + Q_{leader} + l), get3(w, {state} + OMEGA_{leader} + l)")
            text(f"r_{leader} = quat.matrix(q_{leader})")
        for body in self.shape.bodies:
            text(f"x_{body}, v_{body} = get3(w, {state} + X_{body} + l), get3(w, {state} + V_{body} + l)")
        g.ground(text, "CLOCK" if state == "S" else "T")
        return g

    def _rates(self, out: Text, stage: Stage) -> None:
        shape = self.shape
        what = [" and ".join(group) + " turn as one" for group in stage.groups if len(group) > 1]
        what.append(f"{len(stage.rows)} constraint rows" if stage.rows else "nothing is constrained")
        text = self._function(out, f"rates_{stage.name}(w)", f"Phase {stage.name}: {', '.join(what)}.")
        text("for l in range(LANES):")
        text = text.indented(1)
        text("t = w[CLOCK + l]")
        g = self._motion(text, stage, "S")
        emit_loads(text, shape, stage, g, self.slabs, self.parameters)
        text("# motion without the joints")
        self._need_masses()
        for body in shape.bodies:
            text(f"a_{body} = vec3.scale(w[INVERSE_MASS_{body} + l], force_{body})")
        for group in stage.groups:
            if GROUND in group:
                continue
            leader, name = group[0], "_".join(group)
            self._need_inertia(group)
            text(f"inertia_{leader}, inverse_{leader} = get6(w, INERTIA_{name} + l), get6(w, INVERSE_{name} + l)")
            moments = f"moment_{leader}"
            for body in group[1:]:
                moments = f"vec3.add({moments}, moment_{body})"
            text(f"turning = vec3.cross(omega_{leader}, vec3.rotate(inertia_{leader}, omega_{leader}))")
            text(f"spin_rate_{leader} = vec3.rotate(inverse_{leader}, vec3.sub({moments}, turning))")
        if stage.rows:
            emit_rows(text, g, stage, "motion")
        text("# derivative")
        for body in shape.bodies:
            text(f"put3(w, D + X_{body} + l, v_{body})", f"put3(w, D + V_{body} + l, a_{body})")
        for leader in stage.leaders:
            text(f"put4(w, D + Q_{leader} + l, quat.rate(q_{leader}, omega_{leader}))")
            text(f"put3(w, D + OMEGA_{leader} + l, spin_rate_{leader})")

    def _need_masses(self) -> None:
        for body in self.shape.bodies:
            if self.slabs.add(f"INVERSE_MASS_{body}", 1):
                self.parameters(f"w[INVERSE_MASS_{body} + l] = 1.0 / mass_{body}")

    def _need_inertia(self, group: tuple[str, ...]) -> None:
        name = "_".join(group)
        if self.slabs.add(f"INERTIA_{name}", 6):
            self.slabs.add(f"INVERSE_{name}", 6)
            text = f"tensor_{group[0]}"
            for body in group[1:]:
                text = f"vec3.add_matrices({text}, tensor_{body})"
            self.parameters(f"tensor = {text}", f"put6(w, INERTIA_{name} + l, tensor)")
            self.parameters(f"put6(w, INVERSE_{name} + l, vec3.symmetric_inverse(tensor))")

    # -- drift --------------------------------------------------------------------------------------------------------------------

    def _correct(self, out: Text, stage: Stage) -> None:
        corrects = self.shape.scene.solver.drift == "projection"
        says = "Note how far the state Y is off the constraints"
        says += ", and bring it back onto them by the least correction, weighted by mass." if corrects else "."
        text = self._function(out, f"correct_{stage.name}(w)", says)
        text("for l in range(LANES):")
        text = text.indented(1)
        for k in range(4):
            text(f"w[RESIDUAL_NOW + {k} * LANES + l] = 0.0")
        g = self._motion(text, stage, "Y")
        for group in stage.groups:
            if GROUND not in group:
                self._need_inertia(group)
                text(f"inverse_{group[0]} = get6(w, INVERSE_{'_'.join(group)} + l)")
        emit_rows(text, g, stage, "drift" if corrects else "residual")
        if not corrects:
            return
        for body in self.shape.bodies:
            text(f"put3(w, Y + X_{body} + l, vec3.add(x_{body}, shift_{body}))")
            text(f"put3(w, Y + V_{body} + l, vec3.add(v_{body}, kick_{body}))")
        for leader in stage.leaders:
            text(f"d0, d1, d2, d3 = quat.rate(q_{leader}, turn_{leader})", f"q0, q1, q2, q3 = q_{leader}")
            text(f"put4(w, Y + Q_{leader} + l, (q0 + d0, q1 + d1, q2 + d2, q3 + d3))")
            text(f"put3(w, Y + OMEGA_{leader} + l, vec3.add(omega_{leader}, swing_{leader}))")

    # -- steps --------------------------------------------------------------------------------------------------------------------

    def _aim(self, out: Text, stage: Stage) -> None:
        says = (
            "Time to the next event, into STEP, foretold from values, rates and accelerations (in K1) of the conditions and from how fast"
        )
        text = self._function(out, f"aim_{stage.name}(w, usual)", says + " these change; at most to END.")
        text("for l in range(LANES):")
        text = text.indented(1)
        g = self._motion(text, stage, "Y")
        for body in self.shape.bodies:
            text(f"a_{body} = get3(w, K1 + V_{body} + l)")
        for leader in stage.leaders:
            text(f"spin_rate_{leader} = get3(w, K1 + OMEGA_{leader} + l)")
        text("t = w[T + l]", "ahead = w[END + l] - t")
        for event in stage.events:
            name = f"{stage.name}_{event.which}"
            self.slabs.add(f"VALUE_{name}", 1), self.slabs.add(f"LAST_{name}", 2)
            emit_event(text, g, event)
            text(f"earlier, before = w[LAST_{name} + l], w[LAST_{name} + LANES + l]")
            text("jerk = (acceleration - before) / (t - earlier) if t > earlier else 0.0")
            text(f"w[VALUE_{name} + l], w[LAST_{name} + l], w[LAST_{name} + LANES + l] = value, t, acceleration")
            text("wait = time_left(value, rate, acceleration, jerk)")
            if event.ends_phase:
                text("wait = usual if earlier == math.inf and wait > usual else wait")
            if not event.ends_phase:
                text(f"wait = math.inf if w[SPENT_{event.which} + l] > 0.0 else wait")
            text("ahead = wait if wait < ahead else ahead")
        text("w[STEP + l] = ahead")

    def _lengths(self, out: Text) -> None:
        """Step lengths of all lanes."""
        text = self._function(
            out,
            "set_step(w, phase, left, usual)",
            "Length of the first of ``left`` steps to END or to the next event, into all of STEP; an event is never foretold later than ``usual`` at first.",
        )
        text("for l in range(LANES):", "    w[STEP + l] = w[END + l] - w[T + l]")
        for number, stage in enumerate(self.shape.stages):
            if stage.events:
                text(f"if phase == {number}:", f"    aim_{stage.name}(w, usual)")
        text("for l in range(LANES):", "    w[STEP + l] /= left")
        self._spread(text, "STEP")

    def _spread(self, text: Text, slab: str) -> None:
        """Lines that copy the first numbers of a slab, one a lane, to the places of all numbers of a state, by doubling."""
        filled = 1
        while filled < self.size:
            more = min(filled, self.size - filled)
            text(f"for e in range({more} * LANES):", f"    w[{slab} + {filled} * LANES + e] = w[{slab} + e]")
            filled += more

    def _step(self, out: Text, rk: Method, name: str) -> None:
        """One step by a method, from its first stage to what follows its end."""
        shape, stages, own = self.shape, len(rk.b), rk.name == self.rk.name
        says = f"One of ``left`` steps of a phase by {rk.name}; ``size`` numbers of the state take part."
        if not own:
            says = f"The rest of the way to an event: a short step by {rk.name}, and a last correction along the derivative."
        text = self._function(out, f"{name}(w, phase, size{', left, usual' if own else ''})", says)
        text("for e in range(size):", "    w[S + e] = w[Y + e]")
        if own and self.history:
            text("    w[BEGIN + e] = w[Y + e]")
        text("for l in range(LANES):", "    w[CLOCK + l] = w[T + l]")
        if own and self.history:
            text("    w[BEGIN_T + l] = w[T + l]")
        text(
            "rates(w, phase)",
            "for e in range(size):",
            "    w[K1 + e] = w[D + e]",
            f"set_step(w, phase, {'left, usual' if own else '1, math.inf'})",
        )

        def coefficient(i: int, j: int) -> str:
            if own:
                return f"A{i + 1}_{j + 1}" if i < stages else f"B{j + 1}"
            return repr(float(rk.a[i, j] if i < stages else rk.b[j]))

        weights = [*rk.a[:stages, :stages], rk.b]
        if own and self.history:
            weights += [*rk.a[stages:, :stages], *rk.dense[:stages].T]
        for i in range(1, stages + 1):
            used = [j for j in range(i) if weights[i][j] != 0.0]
            text("for e in range(size):")
            inner = text.indented(1)
            if i > 1 and (i - 1 in used or any(row[i - 1] != 0.0 for row in weights[i + 1 :])):
                inner(f"k{i} = w[D + e]")
                if any(weights[m][i - 1] != 0.0 for m in range(i + 1, len(weights))):
                    inner(f"w[K{i} + e] = k{i}")
            terms = [f"{coefficient(i, j)} * {f'k{i}' if j == i - 1 and i > 1 else f'w[K{j + 1} + e]'}" for j in used]
            inner.wrapped(f"w[{'S' if i < stages else 'Y'} + e] = w[Y + e] + w[STEP + e] * (", terms, ")")
            if i < stages:
                node = f"C{i + 1}" if own else repr(float(rk.c[i]))
                text("for l in range(LANES):", f"    w[CLOCK + l] = w[T + l] + {node} * w[STEP + l]", "rates(w, phase)")
        text("for l in range(LANES):", "    w[T + l] += w[STEP + l]")
        if own and self.history:
            text("extend(w, phase)")
        text("settle(w, phase)")
        if own:
            return
        text("set_step(w, phase, 1, math.inf)", "for e in range(size):", "    w[Y + e] += w[STEP + e] * w[D + e]")
        text("for l in range(LANES):", "    h = w[STEP + l]", "    w[T + l] += h")
        text("    w[EVENT_ERROR + l] = larger(w[EVENT_ERROR + l], h * h)", "    w[LOST + l] = w[LOST + l] if abs(h) < 1e-6 else 1.0")
        for number, stage in enumerate(shape.stages):
            if not stage.events:
                continue
            text(f"if phase == {number}:", f"    aim_{stage.name}(w, math.inf)", "    for l in range(LANES):")
            inner = text.indented(2)
            for event in stage.events:
                inner(f"met = w[VALUE_{stage.name}_{event.which} + l] >= -1e-12")
                flag = "DONE" if event.ends_phase else f"SPENT_{event.which}"
                if not event.ends_phase and self.slabs.add(flag, 1):
                    self.parameters(f"w[{flag} + l] = 0.0")
                inner(f"w[{flag} + l] = 1.0 if met else w[{flag} + l]")

    def _extension(self, out: Text) -> None:
        """The continuous extension of a step, and what is recorded of it."""
        rk, stages = self.rk, len(self.rk.b)
        self.slabs.add("BEGIN", self.size), self.slabs.add("BEGIN_T", 1), self.slabs.add("THETA", self.size)
        text = self._function(
            out, "add(w, target, i, coefficients)", "Add the stages K1, K2, ..., each times its coefficient in row i, to a slab."
        )
        text(
            "for j in range(coefficients.shape[1]):",
            "    weight = coefficients[i, j]",
            "    if weight != 0.0:",
            "        for e in range(SIZE_Y):",
        )
        text("            w[target + e] += weight * w[K1 + j * SIZE_Y + e]")
        text = self._function(
            out, "extend(w, phase)", "Coefficients P1, P2, ... of the state over the step just made, by powers of its share gone by."
        )
        total, order = rk.dense.shape[0], rk.dense.shape[1] - 1
        self.slabs.add("POWERS", (order + 1) * self.size)
        if total > stages:
            text(f"for i in range({stages}, {total}):", "    for e in range(SIZE_Y):", "        w[S + e] = 0.0")
            text("    add(w, S, i, A)", "    for e in range(SIZE_Y):", "        w[S + e] = w[BEGIN + e] + w[STEP + e] * w[S + e]")
            text("    for l in range(LANES):", "        w[CLOCK + l] = w[BEGIN_T + l] + C[i] * w[STEP + l]", "    rates(w, phase)")
            text("    for e in range(SIZE_Y):", "        w[K1 + i * SIZE_Y + e] = w[D + e]")
        text(f"for e in range({order + 1} * SIZE_Y):", "    w[POWERS + e] = 0.0", f"for q in range(1, {order + 1}):")
        text(
            "    add(w, POWERS + q * SIZE_Y, q, DENSE)", "    for e in range(SIZE_Y):", "        w[POWERS + q * SIZE_Y + e] *= w[STEP + e]"
        )
        powers = list(range(1, order + 1))
        for stage in self.shape.stages:
            text = self._function(
                out, f"separation_{stage.name}(w)", f"Speed and distance of every joint at the state S of phase {stage.name}, into APART."
            )
            self.slabs.add("APART", 2 * len(self.shape.scene.joint))
            text("for l in range(LANES):")
            text = text.indented(1)
            g = self._motion(text, stage, "S")
            for j, joint in enumerate(self.shape.scene.joint):
                emit_separation(text, g, joint)
                text(f"w[APART + {2 * j} * LANES + l], w[APART + {2 * j + 1} * LANES + l] = rate, distance")
        text = self._function(
            out, "keep(w, phase, beyond, every, history, first)",
            "Separations at the instants within the step just made, and ``beyond`` it as a share of its length, every so many seconds.",
        )  # fmt: skip
        text(
            "low, high = math.inf, 0.0",
            "for l in range(LANES):",
            "    low = min(low, w[BEGIN_T + l])",
            "    high = max(high, w[T + l] + beyond * w[STEP + l])",
        )
        text("if not high < math.inf:", "    return")
        text("for row in range(math.ceil(low / every - 1e-9), min(math.floor(high / every + 1e-9), history.shape[1] - 1) + 1):")
        text = text.indented(1)
        text("for l in range(LANES):", "    theta = (row * every - w[BEGIN_T + l]) / w[STEP + l] if w[STEP + l] > 0.0 else 0.0")
        text("    w[THETA + l] = theta")
        self._spread(text, "THETA")
        text("for e in range(SIZE_Y):", f"    total = w[POWERS + {powers[-1]} * SIZE_Y + e]")
        for q in reversed(powers[:-1]):
            text(f"    total = w[POWERS + {q} * SIZE_Y + e] + w[THETA + e] * total")
        text("    w[S + e] = w[BEGIN + e] + w[THETA + e] * total")
        for number, stage in enumerate(self.shape.stages):
            text(f"{'elif' if number else 'if'} phase == {number}:", f"    separation_{stage.name}(w)")
        text("for l in range(min(LANES, history.shape[0] - first)):", "    t, past = row * every, beyond * w[STEP + l]")
        text("    if w[BEGIN_T + l] - 1e-12 <= t <= w[T + l] + past + 1e-12 and w[STEP + l] > 0.0:")
        text(
            f"        for k in range({2 * len(self.shape.scene.joint)}):",
            "            history[first + l, row, k] = w[APART + k * LANES + l]",
        )

    def _settle(self, out: Text) -> None:
        """What is done at the end of a step."""
        shape, slabs = self.shape, self.slabs
        says = "After a step: attitudes of unit length, pitch and roll followed through turns, constraints, and what disqualifies a case."
        text = self._function(out, "settle(w, phase)", says)
        for body in shape.turning:
            first = next((n for n, stage in enumerate(shape.stages) if body in stage.leaders), None)
            if first is None:
                continue
            inner = text
            if first > 0:
                text(f"if phase >= {first}:")
                inner = text.indented(1)
            slabs.add(f"ANGLES_{body}", 2)
            inner("for l in range(LANES):")
            inner = inner.indented(1)
            inner(f"q0, q1, q2, q3 = get4(w, Y + Q_{body} + l)")
            inner("length = math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)", "inverse = 1.0 / length")
            inner("w[DRIFT + l] = larger(w[DRIFT + l], abs(length - 1.0))")
            inner("q = (q0 * inverse, q1 * inverse, q2 * inverse, q3 * inverse)", f"put4(w, Y + Q_{body} + l, q)")
            inner("r = quat.matrix(q)", f"last_pitch, last_roll = w[ANGLES_{body} + l], w[ANGLES_{body} + LANES + l]")
            inner("pitch, roll = nearest_turn(quat.pitch(r), last_pitch), nearest_turn(quat.roll(r), last_roll)")
            inner(f"omega = get3(w, Y + OMEGA_{body} + l)", "turned = math.sqrt(vec3.dot(omega, omega)) * abs(w[STEP + l])")
            inner("change = larger(larger(abs(pitch - last_pitch), abs(roll - last_roll)), turned)")
            inner("unclear = abs(r[6]) > SINE_SINGULAR or change > 0.5 * math.pi")
            inner("w[TURNED_FAR + l] = 1.0 if unclear else w[TURNED_FAR + l]", "w[LOST + l] = 1.0 if turned > 2.0 else w[LOST + l]")
            inner(f"w[ANGLES_{body} + l], w[ANGLES_{body} + LANES + l] = pitch, roll")
        text("for l in range(LANES):")
        inner = text.indented(1)
        if slabs.has("AIR"):
            for body in shape.bodies:
                if shape.scene.body[body].aerodynamics:
                    inner(f"level = geopotential(w[Y + X_{body} + LANES + l] + w[ORIGIN_HEIGHT + l] + w[ORIGIN_CLIMB + l] * w[T + l])")
                    inner("w[LOST + l] = w[LOST + l] if level >= w[AIR + l] and level <= w[AIR_TOP + l] else 1.0")
        inner("w[STEPS + l] += 1.0")
        for number, stage in enumerate(shape.stages):
            if stage.rows:
                text(f"if phase == {number}:", f"    correct_{stage.name}(w)")

    # -- a block of cases ---------------------------------------------------------------------------------------------------------

    def _finish(self, out: Text) -> None:
        """Outcomes of all lanes into slabs."""
        shape, stage = self.shape, self.shape.stages[-1]
        text = self._function(out, "report(w)", "Outcomes of the final state, in the order of the columns, into OUT.")
        self.slabs.add("OUT", len(shape.bodies) * at.BODY_OUTCOMES + len(shape.scene.joint) * at.JOINT_OUTCOMES)
        self.slabs.add("PATH_REFERENCE", 1), self.slabs.add("STREAM", 3)
        self.parameters(f"w[PATH_REFERENCE + l] = {raw(at.PATH_REFERENCE)}")
        text("for l in range(LANES):")
        text = text.indented(1)
        g = self._motion(text, stage, "Y")
        o = 0
        for body in shape.bodies:
            leader = stage.leader(body)
            spin = "(0.0, 0.0, 0.0)" if leader == GROUND else f"omega_{leader}"
            text(f"alpha, beta = flow_angles(vec3.unrotate({g.attitude(body)}, vec3.add(v_{body}, get3(w, STREAM + l))))")
            text(f"pitch, yaw, roll = w[ANGLES_{leader} + l], quat.yaw({g.attitude(body)}), w[ANGLES_{leader} + LANES + l]")
            text(
                f"put3(w, OUT + {o} * LANES + l, (alpha, beta, pitch - w[PATH_REFERENCE + l]))",
                f"put3(w, OUT + {o + 3} * LANES + l, {spin})",
            )
            text(f"put3(w, OUT + {o + 6} * LANES + l, (roll, yaw, pitch))")
            o += at.BODY_OUTCOMES
        for joint in shape.scene.joint:
            emit_separation(text, g, joint)
            self.slabs.add(f"RELEASE_{joint}", 1)
            self.parameters(f"w[RELEASE_{joint} + l] = math.nan")
            text(f"put3(w, OUT + {o} * LANES + l, (rate, distance, w[RELEASE_{joint} + l]))")
            o += at.JOINT_OUTCOMES
        if any(GROUND in group for group in stage.groups):
            self.slabs.add(f"ANGLES_{GROUND}", 2)
            self.parameters(f"w[ANGLES_{GROUND} + l], w[ANGLES_{GROUND} + LANES + l] = {raw(at.PITCH)}, {raw(at.ROLL)}")

    def _lanes(self, out: Text) -> None:
        shape = self.shape
        says = "Draws into lanes, and what a flight needs of the parameters P; the last block is filled up with its last case."
        text = self._function(out, "prepare(w, first, nominal, slots, draws, numbers)", says)
        self.slabs.add("P", int(shape.plan.model.scene[0].work))
        text("for k in range(nominal.shape[0]):", "    for l in range(LANES):", "        w[P + k * LANES + l] = nominal[k]")
        text("for l in range(LANES):", "    w[UNSOUND + l] = 0.0", "for k in range(slots.shape[0]):", "    for l in range(LANES):")
        self.slabs.add("UNSOUND", 1)
        text("        value = draws[k, min(first + l, draws.shape[1] - 1)]", "        w[P + slots[k] * LANES + l] = value")
        text("        w[UNSOUND + l] += value - value  # not 0 if it is not finite")
        if self.slabs.has("AIR"):
            text("for l in range(LANES):", f"    air, w[AIR_TOP + l] = layer({raw(at.ALTITUDE)})", "    put4(w, AIR + l, air)")
        text("for k in range(D, D + SIZE_Y):  # what a phase does not integrate stays", "    w[k] = 0.0")
        zeros = (
            "DRIFT",
            "TURNED_FAR",
            "EVENT_ERROR",
            "STEPS",
            "RESIDUAL",
            "RESIDUAL + LANES",
            "RESIDUAL + 2 * LANES",
            "RESIDUAL + 3 * LANES",
        )
        loop = Text(2)
        emit_start(loop, shape, self.slabs)
        loop(*(f"w[{name} + l] = 0.0" for name in zeros))
        loop("w[LOST + l] = w[LOST + l] if w[UNSOUND + l] == 0.0 else 1.0")
        emit_load_parameters(self.slabs, self.parameters)
        for stage in shape.stages:
            if stage.end_time is not None:
                self.slabs.add(f"UNTIL_{stage.name}", 1)
                late = "" if stage.delay is None else f" + {raw(stage.delay)}"
                self.parameters(f"w[UNTIL_{stage.name} + l] = {raw(stage.end_time)}{late}")
        for joint in shape.failing:
            self.parameters(f"w[LOST + l] = w[LOST + l] if {raw(shape.plan.slots[f'joint.{joint}.fails'])} < 0.5 else 1.0")
        out.lines += self.shared.lines
        text("for l in range(LANES):")
        out.lines += loop.lines + self.parameters.lines

    def _phase(self, text: Text, number: int, stage: Stage) -> None:
        """Flight through a phase."""
        text(f"# {stage.name}")
        if number == 0 and stage.rows:
            text(f"correct_{stage.name}(w)", "for l in range(LANES):  # a start that the joints do not allow")
            text(
                "    for k in range(0, 4 * LANES, LANES):", "        w[LOST + l] = w[LOST + l] if w[RESIDUAL_NOW + k + l] <= 1e-9 else 1.0"
            )
        end = f"larger(w[UNTIL_{stage.name} + l], w[T + l])" if stage.end_time is not None else "w[RUN_END + l]"
        inner = text
        if stage.stops > 1:
            text("for l in range(LANES):", "    w[DONE + l] = 0.0", f"for _ in range({stage.stops}):")
            inner = text.indented(1)
        inner("for l in range(LANES):")
        if stage.stops > 1:
            inner(f"    end = w[T + l] if w[DONE + l] > 0.0 else {end}")
        else:
            inner("    w[DONE + l] = 0.0", f"    end = {end}")
        inner("    w[END + l] = end if end < w[RUN_END + l] else w[RUN_END + l]")
        for event in stage.events:
            inner(f"    w[LAST_{stage.name}_{event.which} + l] = math.inf")
        if self.shape.switches:
            self._switches(inner)
        inner(
            f"for left in range(steps[{number}], 0, -1):",
            f"    advance(w, {number}, {self.shape.active(stage)} * LANES, left, usual[{number}])",
        )
        if self.history:
            beyond = "0.1 if left == 1 else 0.0" if stage.events else "0.0"
            inner(f"    keep(w, {number}, {beyond}, every, history, first)")
        if stage.events:
            inner(f"approach(w, {number}, {self.shape.active(stage)} * LANES)")
        else:
            inner("for l in range(LANES):", "    w[T + l] = w[END + l]")
        if stage.rows:
            text(f"correct_{stage.name}(w)", "for e in range(4 * LANES):")
            text("    w[RESIDUAL + e] = larger(w[RESIDUAL + e], w[RESIDUAL_NOW + e])")
        self.slabs.add(f"ENDED_{stage.name}", 1)
        text("for l in range(LANES):", f"    w[ENDED_{stage.name} + l] = w[T + l]")
        if number + 1 < len(self.shape.stages):
            self._hand_over(text, stage, self.shape.stages[number + 1])

    def _switches(self, text: Text) -> None:
        """Stop at the next switch of a load, and note what acts until then."""
        text("for l in range(LANES):", "    t = w[T + l]", "    end = min(w[END + l], next_break(t, m, p[l]))", "    w[END + l] = end")
        text("    set_stretch(0.5 * (t + end), m, p[l])")
        scene = self.shape.plan.model.scene[0]
        for i, motor in enumerate(self.shape.scene.motor):
            work = int(scene.motors_w) + at.MOTOR_WORK * i
            self.slabs.add(f"BURNING_{motor.name}", 3)
            text(f"    put3(w, BURNING_{motor.name} + l, vec3.get(p[l], {work + at.BURNING}))")
        for i, load in enumerate(self.shape.scene.load):
            self.slabs.add(f"ACTS_{load.name}", 1)
            text(f"    w[ACTS_{load.name} + l] = p[l, {int(scene.loads_w) + at.LOAD_WORK * i + at.ACTS}]")

    def _hand_over(self, text: Text, stage: Stage, after: Stage) -> None:
        """From a phase to the next: who failed to get there, attitudes of bodies that part, what is noted of a release."""
        reached = "w[DONE + l] > 0.0" if stage.ends_by_state else f"w[T + l] >= w[UNTIL_{stage.name} + l]"
        text("for l in range(LANES):", f"    w[LOST + l] = w[LOST + l] if {reached} else 1.0")
        for leader in after.leaders:
            old = stage.leader(leader)
            if leader not in stage.leaders and old != GROUND:
                text(f"    put4(w, Y + Q_{leader} + l, get4(w, Y + Q_{old} + l))")
                text(f"    put3(w, Y + OMEGA_{leader} + l, get3(w, Y + OMEGA_{old} + l))")
                text(f"    w[ANGLES_{leader} + l] = w[ANGLES_{old} + l]")
                text(f"    w[ANGLES_{leader} + LANES + l] = w[ANGLES_{old} + LANES + l]")
        for joint in after.released:
            text(f"    w[RELEASE_{joint} + l] = w[T + l]")
            if joint in self.shape.scene.output.tip_off:
                for body in self.shape.scene.joint[joint].bodies:
                    if body != GROUND:
                        self.slabs.add(f"TIP_OFF_{joint}_{body}", 3)
                        text(f"    put3(w, TIP_OFF_{joint}_{body} + l, get3(w, Y + OMEGA_{stage.leader(body)} + l))")

    def _door(self, out: Text) -> None:
        shape, n = self.shape, len(self.shape.bodies)
        model = shape.plan.model.scene[0]
        says = "Fly the cases of a block, LANES from number ``first`` on."
        text = self._function(
            out,
            "fly_block(first, nominal, slots, draws, steps, usual, every, outcomes, ends, history, status, scene, integers, numbers)",
            says,
        )
        text("w = np.empty(SIZE_W)", "prepare(w, first, nominal, slots, draws, numbers)")
        if shape.switches:
            text("m = Model(scene, integers, numbers)")
            text(f"p = np.zeros((LANES, {int(model.rows_w)}))  # as `sepmc.kernels.stretches` reads it")
            text("for l in range(LANES):", "    for k in range(nominal.shape[0]):", "        p[l, k] = w[P + k * LANES + l]")
        for number, stage in enumerate(shape.stages):
            self._phase(text, number, stage)
        text("# outcomes", "report(w)", "for l in range(min(LANES, draws.shape[1] - first)):", "    i = first + l")
        text = text.indented(1)
        o = n * at.BODY_OUTCOMES + len(shape.scene.joint) * at.JOINT_OUTCOMES
        text("sound = w[LOST + l] == 0.0 and w[DRIFT + l] <= 1e-6", f"for k in range({o}):", "    outcomes[k, i] = w[OUT + k * LANES + l]")
        text(f"    sound = sound and (k >= {n * at.BODY_OUTCOMES} or math.isfinite(outcomes[k, i]))")
        for joint in shape.scene.output.tip_off:
            for body in shape.scene.joint[joint].bodies:
                if body != GROUND:
                    if self.slabs.has(f"TIP_OFF_{joint}_{body}"):
                        text(f"outcomes[{o}, i], outcomes[{o + 1}, i], outcomes[{o + 2}, i] = get3(w, TIP_OFF_{joint}_{body} + l)")
                    o += 3
        text("for k in range(4):", f"    outcomes[{o} + k, i] = w[RESIDUAL + k * LANES + l]")
        for k, name in enumerate(("DRIFT", "EVENT_ERROR", "TURNED_FAR", "STEPS")):
            text(f"outcomes[{o + 4 + k}, i] = w[{name} + l]")
        for number, stage in enumerate(shape.stages):
            text(f"ends[{number}, i] = w[ENDED_{stage.name} + l]")
        text("status[i] = 0 if sound else -1")
        out(
            "",
            "",
            "@entry",
            "def enter(first, a):",
            '    """Fly a block; the arrays are unpacked in the order of `sepmc.kernels.blocks.fly`."""',
        )
        out(
            "    fly_block(",
            "        first, vector(a, 0), indices(a, 1), table(a, 2), indices(a, 3), vector(a, 4), vector(a, 5)[0], table(a, 6),",
        )
        out("        table(a, 7), block(a, 8), indices(a, 9), record(a, 10), indices(a, 11), vector(a, 12),", "    )")


def _coefficients(rk: Method) -> list[str]:
    """The coefficients a step uses, as named constants."""
    lines = []
    stages = len(rk.b)
    for i in range(1, stages):
        for j in range(i):
            if rk.a[i, j] != 0.0:
                lines.append(f"A{i + 1}_{j + 1} = {float(rk.a[i, j])!r}")
    lines += [f"B{j + 1} = {float(rk.b[j])!r}" for j in range(stages) if rk.b[j] != 0.0]
    lines += [f"C{i + 1} = {float(rk.c[i])!r}" for i in range(1, stages)]
    return lines


def features(shape: Shape) -> tuple[list[str], list[str]]:
    """What the kernel of a shape computes, and what it could but does not, because no scene of the shape needs it."""
    scene = shape.scene
    air = scene.environment.atmosphere != "none" and any(body.aerodynamics for body in scene.body.values())
    parts = {
        "air and aerodynamics": air,
        "gravity": scene.environment.gravity != "none",
        "motors": bool(scene.motor),
        "springs": bool(scene.spring),
        "constant loads": bool(scene.load),
        "loads that switch on or off": shape.switches,
        "constraint rows": any(stage.rows for stage in shape.stages),
        "events on the state": any(stage.events for stage in shape.stages),
        "rates at release": bool(scene.output.tip_off),
        "Mach number": False,
        "joint forces": False,
        "clearances": False,
        "work of the loads": False,
    }
    return [name for name, there in parts.items() if there], [name for name, there in parts.items() if not there]
