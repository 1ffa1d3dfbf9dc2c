"""Generated names of the items of a scene (``body1``, ``joint2``, ...): kernels use them in place
of the names of the file, which could collide with each other or with names of the kernel."""

from collections.abc import Iterable
from dataclasses import replace

from msgspec.structs import replace as change

from sepmc.kernel.spec.parameter_layout import ParameterLayout
from sepmc.scene.model import GROUND, Condition, Ignition, Phase, Scene

# tables whose items have names, and the word of the generated names
_WORDS = {
    "body": "body",
    "joint": "joint",
    "motor": "motor",
    "spring": "spring",
    "load": "load",
    "signal": "signal",
    "phase": "phase",
    "release": "release",
    "event": "event",
}


class Names:
    """Generated names of the items of a scene, numbered from 1 in the order of the file, and
    functions that rename with them.

    Attributes
    ----------
    of : dict of str to dict of str to str
        For each table of the file (``body``, ``joint``, ...): the generated name of each item, by
        its name in the file.
    """

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
        """Name in the file, by generated name."""
        return {new: old for table in self.of.values() for old, new in table.items()}

    @property
    def legend(self) -> list[str]:
        """One line for each table of the file that has items: pairs of generated and original name,
        such as ``body1 upper, body2 lower``."""
        tables = (
            ", ".join(f"{new} {old}" for old, new in table.items()) for table in self.of.values()
        )
        return [line for line in tables if line]

    def path(self, path: str) -> str:
        """Parameter path, such as ``body.upper.mass``, with the name of its item replaced by the
        generated one; a path of another table, or of a name that is not in the file, stays as it
        is."""
        head, _, rest = path.partition(".")
        name, dot, tail = rest.partition(".")
        return f"{head}.{self.of[head].get(name, name)}{dot}{tail}" if head in self.of else path

    def scene(self, scene: Scene) -> Scene:
        """Copy of a scene with generated names; keys that no kernel depends on, and the texts of
        formulas, keep the names of the file."""
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
            # formulas keep the names of the file
            signal=tuple(change(x, name=self.of["signal"][x.name]) for x in scene.signal),
            driven={
                self.path(path): drive._replace(signal=self.of["signal"][drive.signal])
                for path, drive in scene.driven.items()
            },
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
                    for key in ("loads", "tip_off", "guide", "hinge")
                },
                transverse=tuple(map(self._body, scene.output.transverse)),
                relative=tuple(map(self._pair, scene.output.relative)),
            ),
        )

    def layout(self, layout: ParameterLayout) -> ParameterLayout:
        """Copy of a parameter layout for the renamed scene: paths and names are replaced by
        generated ones, the index of every parameter stays."""
        return replace(
            layout,
            scene=self.scene(layout.scene),
            extremes=tuple(map(self.scene, layout.extremes)),
            slots={self.path(path): slot for path, slot in layout.slots.items()},
            outlines={self.of["body"][name]: slot for name, slot in layout.outlines.items()},
            bodies=[self._body(name) for name in layout.bodies],
            joints={
                self.of["joint"][name]: self._pair(bodies) for name, bodies in layout.joints.items()
            },
            phases=[self.of["phase"][name] for name in layout.phases],
        )

    def _joints(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Generated names of joints, in the same order."""
        return tuple(self.of["joint"][name] for name in names)

    def _body(self, name: str) -> str:
        """Generated name of a body; the ground keeps its name."""
        return GROUND if name == GROUND else self.of["body"][name]

    def _pair(self, bodies: tuple[str, str]) -> tuple[str, str]:
        """Generated names of two bodies, in the same order."""
        return self._body(bodies[0]), self._body(bodies[1])

    def _phase(self, phase: Phase) -> Phase:
        """Copy of a phase with generated names."""
        joints = {self.of["joint"][name]: kind for name, kind in phase.joints.items()}
        return change(
            phase,
            name=self.of["phase"][phase.name],
            joints=joints,
            until=phase.until and self._until(phase.until),
        )

    def _ignition(self, ignition: float | Ignition) -> float | Ignition:
        """Copy of an ignition: a time as it is, a trigger with generated names."""
        if not isinstance(ignition, Ignition):
            return ignition
        waits = {key: getattr(ignition, key) for key in ("event", "release", "joint")}
        return change(ignition, **{key: name and self.of[key][name] for key, name in waits.items()})

    def _until(self, until: Condition) -> Condition:
        """Copy of a condition, with the conditions nested in it, with generated names."""
        return change(
            until,
            joint=until.joint and self.of["joint"][until.joint],
            burn_out=until.burn_out and self.of["motor"][until.burn_out],
            spring=until.spring and self.of["spring"][until.spring],
            body=until.body and self._body(until.body),
            any=tuple(map(self._until, until.any)),
            all=tuple(map(self._until, until.all)),
        )
