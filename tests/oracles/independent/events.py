"""What happens at an instant: conditions met, phases ended, joints let go, springs spent."""

import math
from collections.abc import Callable, Iterator

from oracles.independent.case import Table
from oracles.independent.conditions import Event, Leaf, make_event, spring_event
from oracles.independent.joints import Joint, Row, rows_of
from oracles.independent.loads import GRAIN, Loads

Held = dict[str, frozenset[Row]]
Value = Callable[[Leaf], float]  # how far a leaf is beyond its threshold now


class Sequence:
    """Phases, releases and springs of a case as they go on. An event tells joints what to hold;
    each is late by its delay."""

    def __init__(self, scene: Table, joints: dict[str, Joint], loads: Loads):
        ends = {motor.table["name"]: motor.end for motor in loads.motors}
        strokes = {spring.name: spring.table["stroke"] for spring in loads.springs}
        known = ends.__getitem__, strokes.__getitem__
        self.joints, self.names = joints, [phase["name"] for phase in scene["phase"]]
        self.kinds: list[Held] = [
            {
                name: rows_of(phase["joints"].get(name, "free"), joint.own)
                for name, joint in joints.items()
            }
            for phase in scene["phase"]
        ]
        self.phases = [
            make_event(f"phase {phase['name']} ended", phase["until"], *known)
            for phase in scene["phase"]
        ]
        self.releases = [
            make_event(f"release {table['name']}", table["when"], *known)
            for table in scene["release"]
        ]
        self.told = {
            table["name"]: make_event(f"event {table['name']}", table["when"], *known)
            for table in scene["event"]
        }
        self.tells = [
            {table["joint"]: rows_of(table["to"], joints[table["joint"]].own)}
            for table in scene["release"]
        ]
        self.optional = [table["optional"] for table in scene["release"]]
        self.loads = loads
        self.springs = [
            spring_event(s.name, s.table["stroke"])
            for s in loads.springs
            if math.isfinite(s.table["stroke"])
        ]
        self.apart = [*self.releases, *self.told.values(), *self.springs]
        self.phase, self.held = 0, dict(self.kinds[0])
        self.log: list[tuple[float, str]] = []

    def armed(self) -> list[Leaf]:
        """Leaves that are waited for: of the phase that is on, and of releases, told instants and
        springs that have not gone."""
        waiting = [event for event in self.apart if math.isinf(event.time)]
        if self.phase < len(self.phases) - 1:
            waiting.append(self.phases[self.phase])
        return [leaf for event in waiting for leaf in event.leaves if not leaf.met]

    def settle(self, t: float, value: Value) -> None:
        """Everything that happens at time t, until nothing more does; what joints carry is judged
        when all else has happened."""
        loads = False
        for _ in range(1000):
            again = self._meet(t, value, loads)
            if self.phase < len(self.phases) - 1 and self.phases[self.phase].satisfied():
                self._happened(self.phases[self.phase], t)
                self.phase += 1
                again = True
            for event in self.apart:
                if math.isinf(event.time) and event.satisfied():
                    self._happened(event, t)
                    again = True
            for spring in self.loads.springs:
                spring.spent = any(
                    e.leaves[0].which == spring.name and math.isfinite(e.time) for e in self.springs
                )
            again = self._let_go(t) or again
            again = self._light(t) or again
            if loads and not again:
                return
            loads = not again
        raise RuntimeError("events followed each other without time passing")

    def _happened(self, event: Event, t: float) -> None:
        event.time = t
        self.log.append((t, event.name))

    def _meet(self, t: float, value: Value, loads: bool) -> bool:
        found = False
        for leaf in self.armed():
            if leaf.on_load and not loads:
                continue
            if leaf.on_time:
                leaf.met = t >= leaf.threshold - GRAIN
            else:
                leaf.judge(value(leaf))
            found = found or leaf.met
        return found

    def _told(self) -> Iterator[tuple[Event, str, frozenset[Row]]]:
        """What every event that has come tells joints to hold, where that is less than they
        hold."""
        following = [*self.kinds[1:], {}]
        for event, tells in [
            *zip(self.phases, following, strict=True),
            *zip(self.releases, self.tells, strict=True),
        ]:
            if math.isfinite(event.time):
                for name, rows in tells.items():
                    if is_less(rows, self.held[name]):
                        yield event, name, rows

    def _let_go(self, t: float) -> bool:
        changed = False
        for event, name, rows in list(self._told()):
            joint = self.joints[name]
            if (
                is_less(rows, self.held[name])
                and not joint.fails
                and event.time + joint.delay <= t + GRAIN
            ):
                self.held[name], changed = rows, True
                self.log.append((t, f"joint {name} holds {len(rows)} rows"))
        return changed

    def _light(self, t: float) -> bool:
        """Motors whose event, release or joint they wait for has come; what acts is then told
        anew."""
        lit = [motor for motor in self.loads.motors if motor.waits and math.isinf(motor.start)]
        lit = [motor for motor in lit if self._has_come(motor.waits)]
        for motor in lit:
            motor.light(t)
            for leaf in self._leaves():
                if leaf.what == "burn_out" and leaf.which == motor.table["name"]:
                    leaf.threshold = motor.end
            self.log.append((t, f"motor {motor.table['name']} is told to light"))
        if lit:
            self.loads.set_stretch(t + GRAIN)
        return bool(lit)

    def _has_come(self, waits: Table) -> bool:
        if waits["joint"] is not None:
            return bool(self.kinds[0][waits["joint"]]) and not self.held[waits["joint"]]
        if waits["event"] is not None:
            return math.isfinite(self.told[waits["event"]].time)
        name = f"release {waits['release']}"
        return any(math.isfinite(one.time) for one in self.releases if one.name == name)

    def _leaves(self) -> Iterator[Leaf]:
        """Leaves of all conditions, waited for or not."""
        for event in (*self.phases, *self.apart):
            yield from event.leaves

    def next_time(self, t: float) -> float:
        """Earliest time after t at which something happens by the clock."""
        times = [leaf.threshold for leaf in self.armed() if leaf.on_time]
        times += [
            event.time + self.joints[name].delay
            for event, name, _ in self._told()
            if not self.joints[name].fails
        ]
        return min((time for time in times if time > t), default=math.inf)

    def never_released(self) -> bool:
        """Whether a phase other than the last is on, or a joint holds what it was told to let go,
        or what a release that is not optional would have let go."""
        missing = any(
            is_less(rows, self.held[name])
            for event, tells, optional in zip(self.releases, self.tells, self.optional, strict=True)
            if math.isinf(event.time) and not optional
            for name, rows in tells.items()
        )
        return self.phase < len(self.phases) - 1 or missing or any(True for _ in self._told())


def is_less(rows: frozenset[Row], held: frozenset[Row]) -> bool:
    """Whether rows hold a part of what is held: a joint lets go, and never takes hold."""
    turns = frozenset(row for row in held if row[0] == "turn")
    implied = all(row in held or (len(turns) == 3 and row[0] == "turn") for row in rows)
    return implied and len(rows) < len(held)
