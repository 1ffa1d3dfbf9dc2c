"""Names of a kernel: every name of a scene is replaced by one made here, so that none of a file can
meet another or one of ours."""

from collections.abc import Iterable
from dataclasses import replace

from msgspec.structs import replace as change

from sepmc.kernel.spec.parameter_layout import Plan
from sepmc.scene.model import GROUND, Condition, Ignition, Phase, Scene

# Tables whose items have a name of the user's, and the word their items are numbered by.
_WORDS = {
    "body": "body",
    "joint": "joint",
    "motor": "motor",
    "spring": "spring",
    "load": "load",
    "phase": "phase",
    "release": "release",
    "event": "event",
}


class Names:
    """What the items of a scene are called in its kernel: ``body1``, ``joint2``, in the order of
    the file."""

    def __init__(self, scene: Scene):
        tables: dict[str, Iterable[str]] = {
            "body": scene.body,
            "joint": scene.joint,
            **{
                key: [item.name for item in getattr(scene, key)]
                for key in _WORDS
                if key not in ("body", "joint")
            },
        }
        self.of = {
            key: {name: f"{_WORDS[key]}{i}" for i, name in enumerate(names, 1)}
            for key, names in tables.items()
        }

    @property
    def back(self) -> dict[str, str]:
        """The scene's own name of everything that has one here."""
        return {new: old for table in self.of.values() for old, new in table.items()}

    @property
    def legend(self) -> list[str]:
        """A line for each table: what stands for what."""
        tables = (
            ", ".join(f"{new} {old}" for old, new in table.items()) for table in self.of.values()
        )
        return [line for line in tables if line]

    def path(self, path: str) -> str:
        """The path of a parameter, its item renamed."""
        head, _, rest = path.partition(".")
        name, dot, tail = rest.partition(".")
        return f"{head}.{self.of[head].get(name, name)}{dot}{tail}" if head in self.of else path

    def scene(self, scene: Scene) -> Scene:
        """A scene with all these names in place of its own. What no kernel is written for keeps its
        names."""
        return change(
            scene,
            body={self._body(name): body for name, body in scene.body.items()},
            joint={
                self.of["joint"][name]: change(j, bodies=self._pair(j.bodies))
                for name, j in scene.joint.items()
            },
            motor=tuple(
                change(
                    m,
                    name=self.of["motor"][m.name],
                    body=self._body(m.body),
                    ignition=self._ignition(m.ignition),
                )
                for m in scene.motor
            ),
            spring=tuple(
                change(s, name=self.of["spring"][s.name], bodies=self._pair(s.bodies))
                for s in scene.spring
            ),
            load=tuple(
                change(x, name=self.of["load"][x.name], body=self._body(x.body)) for x in scene.load
            ),
            phase=tuple(self._phase(phase) for phase in scene.phase),
            release=tuple(
                change(
                    r,
                    name=self.of["release"][r.name],
                    joint=self.of["joint"][r.joint],
                    when=self._until(r.when),
                )
                for r in scene.release
            ),
            event=tuple(
                change(e, name=self.of["event"][e.name], when=self._until(e.when))
                for e in scene.event
            ),
            proximity=tuple(
                change(x, body=self._body(x.body), joint=self.of["joint"][x.joint])
                for x in scene.proximity
            ),
            clearance=tuple(
                change(x, bodies=self._pair(x.bodies), after=x.after and self.of["joint"][x.after])
                for x in scene.clearance
            ),
            output=change(
                scene.output,
                **{
                    key: self._joints(getattr(scene.output, key))
                    for key in ("loads", "tip_off", "guide")
                },
                transverse=tuple(map(self._body, scene.output.transverse)),
            ),
        )

    def plan(self, plan: Plan) -> Plan:
        """A plan of the renamed scene; every number stays at its place."""
        return replace(
            plan,
            scene=self.scene(plan.scene),
            extremes=tuple(map(self.scene, plan.extremes)),
            slots={self.path(path): place for path, place in plan.slots.items()},
            outlines={self.of["body"][name]: place for name, place in plan.outlines.items()},
            bodies=[self._body(name) for name in plan.bodies],
            joints={
                self.of["joint"][name]: self._pair(bodies) for name, bodies in plan.joints.items()
            },
            phases=[self.of["phase"][name] for name in plan.phases],
        )

    def _joints(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(self.of["joint"][name] for name in names)

    def _body(self, name: str) -> str:
        return GROUND if name == GROUND else self.of["body"][name]

    def _pair(self, bodies: tuple[str, str]) -> tuple[str, str]:
        return self._body(bodies[0]), self._body(bodies[1])

    def _phase(self, phase: Phase) -> Phase:
        joints = {self.of["joint"][name]: kind for name, kind in phase.joints.items()}
        return change(
            phase,
            name=self.of["phase"][phase.name],
            joints=joints,
            until=phase.until and self._until(phase.until),
        )

    def _ignition(self, ignition: float | Ignition) -> float | Ignition:
        """A time, or what a motor waits for."""
        if not isinstance(ignition, Ignition):
            return ignition
        waits = {key: getattr(ignition, key) for key in ("event", "release", "joint")}
        return change(ignition, **{key: name and self.of[key][name] for key, name in waits.items()})

    def _until(self, until: Condition) -> Condition:
        """A condition, and its parts."""
        return change(
            until,
            joint=until.joint and self.of["joint"][until.joint],
            burn_out=until.burn_out and self.of["motor"][until.burn_out],
            spring=until.spring and self.of["spring"][until.spring],
            body=until.body and self._body(until.body),
            any=tuple(map(self._until, until.any)),
            all=tuple(map(self._until, until.all)),
        )
