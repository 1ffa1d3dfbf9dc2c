"""Event logic: conditions met, phases ended, joints released, springs spent, motors ignited."""

import math
from collections.abc import Callable, Iterator

from oracles.independent.case import Table
from oracles.independent.conditions import Event, Leaf, make_event, spring_event
from oracles.independent.joints import Joint, Row, rows_of
from oracles.independent.loads import GRAIN, Loads

ActiveRows = dict[str, frozenset[Row]]
Value = Callable[[Leaf], float]  # excess of a quantity over its threshold


class Sequence:
    """Present phase, releases, observed events and springs of a case. An event gives joints their
    next active rows; each joint follows after its delay."""

    def __init__(self, scene: Table, joints: dict[str, Joint], loads: Loads):
        ends = {motor.table["name"]: motor.end for motor in loads.motors}
        strokes = {spring.name: spring.table["stroke"] for spring in loads.springs}
        known = ends.__getitem__, strokes.__getitem__
        self.joints, self.names = joints, [phase["name"] for phase in scene["phase"]]
        self.kinds: list[ActiveRows] = [
            {
                name: rows_of(phase["joints"].get(name, "free"), joint.custom_kinds)
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
        self.observed = {
            table["name"]: make_event(f"event {table['name']}", table["when"], *known)
            for table in scene["event"]
        }
        self.remaining = [
            {table["joint"]: rows_of(table["to"], joints[table["joint"]].custom_kinds)}
            for table in scene["release"]
        ]
        self.partial = {
            (table["joint"], table["to"]): rows_of(table["to"], joints[table["joint"]].custom_kinds)
            for table in scene["release"]
            if table["to"] != "free"
        }
        self.optional = [table["optional"] for table in scene["release"]]
        self.loads = loads
        self.springs = [
            spring_event(s.name, s.table["stroke"])
            for s in loads.springs
            if math.isfinite(s.table["stroke"])
        ]
        self.others = [*self.releases, *self.observed.values(), *self.springs]
        self.phase, self.active = 0, dict(self.kinds[0])
        self.log: list[tuple[float, str]] = []

    def armed(self) -> list[Leaf]:
        """Comparisons that are monitored: of the present phase, and of releases, observed events
        and springs that have not occurred."""
        waiting = [event for event in self.others if math.isinf(event.time)]
        if self.phase < len(self.phases) - 1:
            waiting.append(self.phases[self.phase])
        return [leaf for event in waiting for leaf in event.leaves if not leaf.met]

    def process(self, t: float, value: Value) -> None:
        """Process all events at time t until none is left. Joint loads are compared only when no
        other event occurs."""
        loads = False
        for _ in range(1000):
            changed_now = self._update(t, value, loads)
            if self.phase < len(self.phases) - 1 and self.phases[self.phase].satisfied():
                self._record(self.phases[self.phase], t)
                self.phase += 1
                changed_now = True
            for event in self.others:
                if math.isinf(event.time) and event.satisfied():
                    self._record(event, t)
                    changed_now = True
            for spring in self.loads.springs:
                spring.spent = any(
                    e.leaves[0].name == spring.name and math.isfinite(e.time) for e in self.springs
                )
            changed_now = self._release(t) or changed_now
            changed_now = self._ignite(t) or changed_now
            if loads and not changed_now:
                return
            loads = not changed_now
        raise RuntimeError("events did not end at one instant")

    def _record(self, event: Event, t: float) -> None:
        """Set the time of an event and log it."""
        event.time = t
        self.log.append((t, event.name))

    def _update(self, t: float, value: Value, loads: bool) -> bool:
        """Update the armed comparisons; True if any is met."""
        any_met = False
        for leaf in self.armed():
            if leaf.on_load and not loads:
                continue
            if leaf.on_time:
                leaf.met = t >= leaf.threshold - GRAIN
            else:
                leaf.judge(value(leaf))
            any_met = any_met or leaf.met
        return any_met

    def _pending(self) -> Iterator[tuple[Event, str, frozenset[Row]]]:
        """Pending releases: events that have occurred, their joints and the rows that remain."""
        following = [*self.kinds[1:], {}]
        for event, remaining in [
            *zip(self.phases, following, strict=True),
            *zip(self.releases, self.remaining, strict=True),
        ]:
            if math.isfinite(event.time):
                for name, rows in remaining.items():
                    if constrains_less(rows, self.active[name]):
                        yield event, name, rows

    def _release(self, t: float) -> bool:
        """Release joints whose delay has passed; True if any is."""
        changed = False
        for event, name, rows in list(self._pending()):
            joint = self.joints[name]
            if (
                constrains_less(rows, self.active[name])
                and not joint.fails
                and event.time + joint.delay <= t + GRAIN
            ):
                self.active[name], changed = rows, True
                self.log.append((t, f"joint {name}: {len(rows)} active rows"))
        return changed

    def _ignite(self, t: float) -> bool:
        """Start motors whose event, release or joint has occurred, and update the loads; True if
        any is."""
        ignited = [motor for motor in self.loads.motors if motor.waits and math.isinf(motor.start)]
        ignited = [motor for motor in ignited if self._has_occurred(motor.waits)]
        for motor in ignited:
            motor.ignite(t)
            for leaf in self._leaves():
                if leaf.quantity == "burn_out" and leaf.name == motor.table["name"]:
                    leaf.threshold = motor.end
            self.log.append((t, f"motor {motor.table['name']} ignites"))
        if ignited:
            self.loads.set_interval(t + GRAIN)
        return bool(ignited)

    def _has_occurred(self, waits: Table) -> bool:
        """True if the event, release or joint that a motor waits for has occurred."""
        if waits["joint"] is not None:
            return bool(self.kinds[0][waits["joint"]]) and not self.active[waits["joint"]]
        if waits["event"] is not None:
            return math.isfinite(self.observed[waits["event"]].time)
        name = f"release {waits['release']}"
        return any(math.isfinite(one.time) for one in self.releases if one.name == name)

    def loosened(self) -> Iterator[tuple[str, str]]:
        """Joint and kind of the partial releases that would leave no less than the joint
        constrains."""
        for pair, rows in self.partial.items():
            if not constrains_less(rows, self.active[pair[0]]):
                yield pair

    def _leaves(self) -> Iterator[Leaf]:
        """Comparisons of all conditions, armed or not."""
        for event in (*self.phases, *self.others):
            yield from event.leaves

    def next_time(self, t: float) -> float:
        """Earliest scheduled time, s, after t: a time condition, a burn-out or a delayed
        release."""
        times = [leaf.threshold for leaf in self.armed() if leaf.on_time]
        times += [
            event.time + self.joints[name].delay
            for event, name, _ in self._pending()
            if not self.joints[name].fails
        ]
        return min((time for time in times if time > t), default=math.inf)

    def never_released(self) -> bool:
        """True if a phase other than the last is active, a release is pending, or a release that is
        not optional has not occurred."""
        missing = any(
            constrains_less(rows, self.active[name])
            for event, remaining, optional in zip(
                self.releases, self.remaining, self.optional, strict=True
            )
            if math.isinf(event.time) and not optional
            for name, rows in remaining.items()
        )
        return self.phase < len(self.phases) - 1 or missing or any(True for _ in self._pending())


def constrains_less(rows: frozenset[Row], active: frozenset[Row]) -> bool:
    """True if ``rows`` constrain less than ``active``: joints only release, they never engage."""
    turns = frozenset(row for row in active if row[0] == "turn")
    implied = all(row in active or (len(turns) == 3 and row[0] == "turn") for row in rows)
    return implied and len(rows) < len(active)
