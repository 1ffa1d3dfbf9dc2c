"""Data model of a campaign file: immutable structs whose numbers are in SI and radians. Fields have
no unit in their names; the TOML keys that set them do (``mass_kg`` sets ``mass``)."""

import math
from typing import Annotated, Any, Literal, NamedTuple

from msgspec import Meta, Struct, field

from sepmc.scene.limits import CASES, NAME, SEED


class Derived:
    """Marks a field of a struct that no TOML key of its name sets: the reader of a campaign file
    fills it from other keys."""


class Quantity(NamedTuple):
    """Kind of quantity of a field, a key of `sepmc.scene.units.UNITS` such as "length" ("" for no
    unit), and the names of the components of a vector (none for a number or a list)."""

    kind: str
    components: tuple[str, ...] = ()


XYZ = ("x", "y", "z")
_ENDS = ("0", "1")  # of a frustum
Positive = Meta(gt=0)
NotNegative = Meta(ge=0)
_FRACTION = Meta(gt=0, lt=1)
Vector = tuple[float, float, float]
Length = Annotated[float, Quantity("length")]
Time = Annotated[float, NotNegative, Quantity("time")]
Angle = Annotated[float, Quantity("angle")]
Speed = Annotated[float, NotNegative, Quantity("speed")]
Point = Annotated[Vector, Quantity("length", XYZ)]
Direction = Annotated[Vector, Quantity("", XYZ)]
Radius = Annotated[float, NotNegative]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]*\Z", max_length=NAME)]
Names = tuple[str, ...]
# "const", "alpha", "alpha2", "alpha_beta", ... or a signal -> coefficient, angles in radians
Polynomial = dict[str, float]
Series = tuple[float, ...]
Grid = list[Any]  # nested lists of numbers, one level per axis of the table
Axis = Literal["x", "y", "z"]
# of a table between its rows: a spline, straight lines, or cubics without overshoot
Interpolation = Literal["cubic", "linear", "monotone"]
GROUND = "ground"  # the body at rest, which joints and springs may name


class _Table(Struct, frozen=True):
    pass


class WindProfile(_Table, frozen=True, kw_only=True):
    """Table of wind over height, added to the steady wind. Each row has an altitude (m), a speed
    (m/s) and a direction (rad, as in `Wind`); wind is constant beyond the first and the last row.
    ``interpolation`` applies between rows, to the components along ground x and z.
    ``factor`` multiplies all speeds of the table, ``turn`` (rad) is added to all its directions."""

    altitude: Annotated[Series, Quantity("length")]
    speed: Annotated[Series, Quantity("speed")]
    direction: Annotated[Series, Quantity("angle")]
    factor: float = 1.0
    turn: Angle = 0.0
    interpolation: Interpolation = "cubic"


class Wind(_Table, frozen=True, kw_only=True):
    """Horizontal wind: a steady one of a speed (m/s) and a direction to which it blows (rad from
    ground x toward ground z), plus, if given, a profile over height."""

    speed: Speed = 0.0
    direction: Angle = 0.0
    profile: WindProfile | None = None


class AirProfile(_Table, frozen=True, kw_only=True):
    """Table of air over height, for ``atmosphere = "table"``. Each row has an altitude (m), a
    density (kg/m3; its logarithm is interpolated) and a speed of sound (m/s; the column is empty if
    no Mach number is needed). A case that leaves the table ends with the status
    outside-atmosphere."""

    altitude: Annotated[Series, Quantity("length")]
    density: Annotated[Series, Quantity("density")]
    speed_of_sound: Annotated[Series, Quantity("speed")] = ()
    interpolation: Interpolation = "cubic"


class Environment(_Table, frozen=True, kw_only=True):
    """Environment of the flight: atmosphere, gravity and wind.

    ``air`` is the table of the atmosphere "table", None for any other; ``density_factor``
    multiplies the density of any atmosphere. ``gravity`` is the model of how gravity depends on
    height, ``surface_gravity`` its value at height 0 (m/s2).
    """

    atmosphere: Literal["us1976", "table", "none"] = "us1976"
    air: AirProfile | None = None
    density_factor: Annotated[float, NotNegative] = 1.0
    gravity: Literal["inverse-square", "constant", "none"] = "inverse-square"
    surface_gravity: Annotated[float, Positive, Quantity("acceleration")] = 9.80665
    wind: Wind = field(default_factory=Wind)


class AeroTable(_Table, frozen=True, kw_only=True):
    """Aerodynamic coefficients on a grid over the axes that are not empty, in the order ``mach``,
    ``alpha``, ``beta`` (rad); they are added to those of the polynomials.

    Over an axis of one point they are constant; a case that leaves any other axis ends with the
    status outside-table. ``axial`` to ``pitch`` are the grids of C_A, C_N, C_Y, C_l, C_n and C_m
    of CONVENTIONS.md, the others those of derivatives: ``pitch_q`` is that of ``pitch`` by the
    reduced pitch rate q (`RATES`). An empty grid counts as 0.
    """

    mach: Series = ()
    alpha: Annotated[Series, Quantity("angle")] = ()
    beta: Annotated[Series, Quantity("angle")] = ()
    axial: Grid = field(default_factory=list)
    normal: Grid = field(default_factory=list)
    side: Grid = field(default_factory=list)
    roll: Grid = field(default_factory=list)
    yaw: Grid = field(default_factory=list)
    pitch: Grid = field(default_factory=list)
    axial_q: Grid = field(default_factory=list)
    normal_q: Grid = field(default_factory=list)
    pitch_q: Grid = field(default_factory=list)
    side_p: Grid = field(default_factory=list)
    side_r: Grid = field(default_factory=list)
    roll_p: Grid = field(default_factory=list)
    roll_r: Grid = field(default_factory=list)
    yaw_p: Grid = field(default_factory=list)
    yaw_r: Grid = field(default_factory=list)
    interpolation: Interpolation = "cubic"


# grids of a table, and of these the derivatives by a rate: coefficient and rate
COEFFICIENTS = ("axial", "normal", "side", "roll", "yaw", "pitch")
DERIVATIVES = (
    "axial_q", "normal_q", "pitch_q", "side_p", "side_r", "roll_p", "roll_r", "yaw_p", "yaw_r",
)  # fmt: skip
RATES = ("p", "q", "r")  # roll to the right, pitch up, yaw to the right


class Aerodynamics(_Table, frozen=True, kw_only=True):
    """Aerodynamic coefficients of a body: polynomials in alpha, beta (rad), the reduced rates and
    signals, to which those of a ``table`` are added.

    ``axial`` to ``pitch`` are the polynomials of C_A, C_N, C_Y, C_l, C_n and C_m of CONVENTIONS.md,
    by term; an empty one is 0. Coefficients are referred to ``reference_area`` (m2),
    ``reference_length`` (m) and the layout point ``moment_point`` (m; None: the mass centre).
    ``force_factor`` multiplies all forces, also where they act on the moment about the mass centre;
    ``moment_factor`` multiplies the moments about the moment point.
    """

    reference_area: Annotated[float, Positive, Quantity("area")]
    reference_length: Annotated[float, Positive, Quantity("length")]
    axial: Polynomial = field(default_factory=dict)
    normal: Polynomial = field(default_factory=dict)
    side: Polynomial = field(default_factory=dict)
    roll: Polynomial = field(default_factory=dict)
    yaw: Polynomial = field(default_factory=dict)
    pitch: Polynomial = field(default_factory=dict)
    force_factor: float = 1.0
    moment_factor: float = 1.0
    moment_point: Point | None = None
    table: AeroTable | None = None


class Part(_Table, frozen=True, kw_only=True):
    """A part of a body's outline: a cone frustum (two stations and radii, m; a cylinder if the
    radii are equal), whose axis is parallel to the layout's at ``offset`` (y, z, m), or layout
    points (m). Of a frustum ``points`` is empty; of points ``stations`` and ``radii`` are None.

    A hollow frustum is the inner surface of a shell: clearance is measured from inside it. With a
    ``sector`` only the lateral surface from its first to its second angle (rad, about body x) is
    left, a thin wall with two sides. A clearance can be limited to parts that have a ``name``.
    """

    name: Name | None = None
    stations: Annotated[tuple[float, float], Quantity("length", _ENDS)] | None = None
    radii: Annotated[tuple[Radius, Radius], Quantity("length", _ENDS)] | None = None
    # of the axis of revolution from the layout axis
    offset: Annotated[tuple[float, float], Quantity("length", ("y", "z"))] = (0.0, 0.0)
    points: Annotated[tuple[Vector, ...], Quantity("length")] = ()
    hollow: bool = False
    # from, to, about body x: 0 toward z, 90 deg toward -y
    sector: Annotated[tuple[float, float], Quantity("angle", _ENDS)] | None = None

    @property
    def is_wall(self) -> bool:
        """True if the part is a thin surface (hollow, or a sector), not a solid or points; no
        clearance is measured between two thin surfaces."""
        return self.hollow or self.sector is not None


class Body(_Table, frozen=True, kw_only=True):
    """A rigid body: mass (kg), moments and products (positive integrals) of inertia about the mass
    centre (kg m2), layout point ``cg`` of the mass centre (m), aerodynamics (None: no aerodynamic
    loads) and the parts of its outline. ``inertia_factor`` multiplies the moments and the products
    of inertia."""

    mass: Annotated[float, Positive, Quantity("mass")]
    inertia: Annotated[Vector, Quantity("inertia", ("xx", "yy", "zz"))]
    inertia_products: Annotated[Vector, Quantity("inertia", ("xy", "xz", "yz"))] = (0.0, 0.0, 0.0)
    inertia_factor: Annotated[float, Positive] = 1.0
    cg: Point
    aerodynamics: Aerodynamics | None = None
    outline: tuple[Part, ...] = ()


class Profile(_Table, frozen=True, kw_only=True):
    """Table of thrust over time since ignition (s), as a fraction of the motor's ``thrust``: linear
    between rows, zero before the first and after the last."""

    time: Annotated[Series, Quantity("time")]
    fraction: Series


class Ignition(_Table, frozen=True, kw_only=True):
    """Trigger of a motor's ignition, one of three, by name: an event or a release (when its
    condition is met), or a joint (when it becomes free). The motor ignites ``delay`` (s) later."""

    event: str | None = None
    release: str | None = None
    joint: str | None = None
    delay: Time = 0.0


class Motor(_Table, frozen=True, kw_only=True):
    """A motor or engine on a body. It ignites ``delay`` (s) after ``ignition``, a time or the
    instant that a trigger gives, and burns for ``burn`` (s; infinite: to the last row of the
    profile or, without a profile, to the end of the flight).

    CONVENTIONS.md defines how ``build_up`` and ``tail_off`` (time constants, s) and ``profile``
    change the ``thrust`` (N) over time. The nozzle is at ``station``, and at ``radius`` and the
    angle ``clock`` from the layout axis, moved by ``offset`` (y, z) (m). ``cant`` is the direction
    of the force without misalignment (0 forward, pi aft); ``deflection`` is the angle of the thrust
    from that direction and ``deflection_clock`` the angle around it (rad).
    """

    name: Name
    body: str
    thrust: Annotated[float, Quantity("force")]
    build_up: Time = 0.0
    # s from the start of the flight, or a trigger
    ignition: Time | Ignition = 0.0
    delay: Time = 0.0
    burn: Annotated[float, Positive, Quantity("time")] = math.inf
    tail_off: Time = 0.0
    profile: Profile | None = None
    station: Length
    radius: Annotated[float, NotNegative, Quantity("length")] = 0.0
    cant: Angle = math.pi
    clock: Angle = 0.0
    offset: Annotated[tuple[float, float], Quantity("length", ("y", "z"))] = (0.0, 0.0)
    deflection: Angle = 0.0
    deflection_clock: Angle = 0.0

    @property
    def trigger(self) -> Ignition | None:
        """Trigger of the ignition; None if the motor ignites at a given time."""
        return self.ignition if isinstance(self.ignition, Ignition) else None

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector of the force on the body without deflection, in body axes: x_f of
        CONVENTIONS.md."""
        sine = math.sin(self.cant)
        return math.cos(self.cant), -math.sin(self.clock) * sine, math.cos(self.clock) * sine


class ForceTable(_Table, frozen=True, kw_only=True):
    """Table of a spring's force (N) over its extension (m), constant before the first row and after
    the last. While the extension shrinks this force is multiplied by ``return_factor``."""

    extension: Annotated[Series, Quantity("length")]
    force: Annotated[Series, Quantity("force")]
    return_factor: Annotated[float, Meta(ge=0, le=1)] = 1.0
    interpolation: Interpolation = "cubic"


class Spring(_Table, frozen=True, kw_only=True):
    """A spring, pusher or piston between two points: force on the second body, and its opposite on
    the first.

    With ``axis`` (fixed in the first body) it acts along that axis, otherwise along the line
    between its points. The force is ``factor (force - stiffness x - damping x' + table(x))`` at
    extension x, which is 0 at the start; ``factor`` is 0 for a failed spring. With ``push_only`` a
    negative force becomes zero. Once the extension reaches ``stroke`` (without one: the last row of
    the table, if there is a table) the force is zero for the rest of the flight.

    ``bodies`` names the first and the second body. ``point`` is the end on the first, and
    ``second_point`` (None: the same point) that on the second, both layout points (m).
    """

    name: Name
    bodies: tuple[str, str]
    point: Point
    second_point: Point | None = None
    axis: Direction | None = None
    force: Annotated[float, Quantity("force")] = 0.0
    stiffness: Annotated[float, NotNegative, Quantity("stiffness")] = 0.0
    damping: Annotated[float, NotNegative, Quantity("damping")] = 0.0
    stroke: Annotated[float, Positive, Quantity("length")] = math.inf
    factor: Annotated[float, NotNegative] = 1.0
    push_only: bool = False
    table: ForceTable | None = None


class Servo(_Table, frozen=True, kw_only=True):
    """Second-order response of a signal to the value of its formula: natural frequency, Hz (not
    rad/s), and damping ratio."""

    natural: Annotated[float, Positive, Quantity("frequency")]
    damping: Annotated[float, NotNegative]


class Signal(_Table, frozen=True, kw_only=True):
    """A number computed during the flight by a formula of flight quantities, other signals and the
    signal's ``constants``: the keys of its TOML table that are no field of this class.

    With ``sample`` the formula is evaluated every ``sample`` seconds from the start on; each value
    takes effect ``delay`` seconds later and stays until the next one does. The signal y equals the
    value u of the formula, or follows it with a ``lag`` (y' = (u - y) / lag, where abs(y') is at
    most ``rate_limit``) or as a ``servo``, or is its ``integral`` over time; these three begin at
    ``initial``. With a ``delay``, ``initial`` is also the value of the formula until the first one
    takes effect.
    """

    name: Name
    formula: str
    sample: Annotated[float, Positive, Quantity("time")] | None = None
    delay: Time = 0.0
    lag: Annotated[float, Positive, Quantity("time")] | None = None
    rate_limit: Annotated[float, Positive] | None = None
    servo: Servo | None = None
    integral: bool = False
    initial: float = 0.0
    constants: Annotated[dict[str, float], Derived()] = field(default_factory=dict)

    @property
    def states(self) -> int:
        """Number of variables of the signal that are integrated with the motion: 2 for a servo, 1
        for a lag or an integral, else 0."""
        return 2 if self.servo is not None else int(self.integral or self.lag is not None)

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Names of the fields that would have no effect, given or not: ``delay`` without
        ``sample``, and ``initial`` if the signal has neither `states` nor a delay."""
        delay = () if self.sample is not None else ("delay",)
        return delay if self.states or self.delay else (*delay, "initial")


class Driven(NamedTuple):
    """Source of a number of the scene that changes during the flight: name of the signal that gives
    it, and the factor from the unit of the number's TOML key to SI."""

    signal: str
    factor: float


class Load(_Table, frozen=True, kw_only=True):
    """A force (N) at a layout point of a body (m; None: its mass centre) and a moment (N m) on that
    body, in the axes that ``frame`` names, from ``start`` to ``end`` (s from the start of the
    flight). `Scene.driven` names the signal of a component that changes during the flight."""

    name: Name
    body: str
    force: Annotated[Vector, Quantity("force", XYZ)] = (0.0, 0.0, 0.0)
    moment: Annotated[Vector, Quantity("moment", XYZ)] = (0.0, 0.0, 0.0)
    frame: Literal["body", "ground"] = "body"
    point: Point | None = None  # None: the centre of mass
    start: Time = 0.0
    end: Annotated[float, Positive, Quantity("time")] = math.inf


class RelativeAxes(_Table, frozen=True, kw_only=True):
    """Axes of a grid over the position of the second body of a joint relative to the first:
    displacement x, y, z of the second body's joint point (m) along the joint axes, and attitude
    angles (rad) relative to them. A grid has no axis where the series of points is empty."""

    x: Annotated[Series, Quantity("length")] = ()
    y: Annotated[Series, Quantity("length")] = ()
    z: Annotated[Series, Quantity("length")] = ()
    pitch: Annotated[Series, Quantity("angle")] = ()
    yaw: Annotated[Series, Quantity("angle")] = ()
    roll: Annotated[Series, Quantity("angle")] = ()

    @property
    def points(self) -> dict[str, Series]:
        """Grid points of the axes that are given, by axis name, in the order of the fields."""
        names = self.__struct_fields__
        return {name: points for name in names if (points := getattr(self, name))}


class Proximity(_Table, frozen=True, kw_only=True):
    """Increments to the aerodynamic coefficients of ``body``, as tables over the separation
    ``distance`` (m) of ``joint`` or, if ``axes`` is not None, over one to three axes of the
    relative position of its bodies; constant beyond the ends of the tables. ``axial`` to ``pitch``
    are the tables, named as in `AeroTable`; an empty one is 0. ``factor`` multiplies all
    increments."""

    name: Name
    body: str
    joint: str
    distance: Annotated[Series, Quantity("length")] = ()
    axes: RelativeAxes | None = None
    axial: Grid = field(default_factory=list)
    normal: Grid = field(default_factory=list)
    side: Grid = field(default_factory=list)
    roll: Grid = field(default_factory=list)
    yaw: Grid = field(default_factory=list)
    pitch: Grid = field(default_factory=list)
    factor: float = 1.0
    interpolation: Interpolation = "cubic"

    @property
    def points(self) -> dict[str, Series]:
        """Grid points by axis name: ``distance`` alone, or those of ``axes`` that are given."""
        return {"distance": self.distance} if self.axes is None else self.axes.points


class Guide(_Table, frozen=True, kw_only=True):
    """Guide pins of a joint that slides along x: number, radius of their ``circle`` (m), ``clock``
    angle of the first one from y toward z (rad), length ``engaged`` at the start (m), and Coulomb
    friction, whose coefficient at sliding speed v (m/s) is ``friction`` v / sqrt(v^2 +
    slip_speed^2)."""

    pins: Annotated[int, Meta(ge=1, le=24)]
    circle: Annotated[float, NotNegative, Quantity("length")] = 0.0
    clock: Angle = 0.0
    engaged: Annotated[float, Positive, Quantity("length")]
    friction: Annotated[float, NotNegative] = 0.0
    slip_speed: Annotated[float, Positive, Quantity("speed")] = 0.01


class Custom(_Table, frozen=True, kw_only=True):
    """A user-defined joint kind: the joint axes along which it constrains translation, and those
    about which it constrains rotation."""

    translations: tuple[Axis, ...] = ()
    rotations: tuple[Axis, ...] = ()


class Joint(_Table, frozen=True, kw_only=True):
    """A joint between two bodies, with axes fixed in the first. Its kind (fixed, slider, free, ...)
    depends on the phase; ``kind`` defines further kinds by name.

    ``point`` is its layout point (m), of a rod the first body's end; ``second_point`` is the second
    body's end of a rod. ``apart`` is the sign of r_B - r_A along ``x_axis`` that is positive
    separation (None: that of the second body's nominal mass centre seen from the first's).
    ``omega`` (rad/s, body axes) is the initial rate, about ``point``, of the second body and those
    connected to it relative to the first. The joint is released ``delay`` (s) after the condition
    if ``fails`` is 0, and never if it is 1 (no other value is valid).
    ``guide`` describes its pins (None: it has none).
    """

    bodies: tuple[str, str]
    point: Point
    second_point: Point | None = None
    x_axis: Direction = (1.0, 0.0, 0.0)
    y_axis: Direction = (0.0, 1.0, 0.0)
    apart: Literal[1, -1] | None = None
    kind: dict[Name, Custom] = field(default_factory=dict)
    omega: Annotated[Vector, Quantity("angular rate", XYZ)] = (0.0, 0.0, 0.0)
    delay: Time = 0.0
    fails: Annotated[float, Meta(ge=0, le=1)] = 0.0
    guide: Guide | None = None


class Condition(_Table, frozen=True, kw_only=True):
    """A condition on time, motion or loads. Of several thresholds the first that is reached meets
    it; a condition that was met stays met. ``any`` and ``all`` combine further conditions.

    Thresholds, None if not used, are: a ``time`` (s from the start of the flight); the end of
    burning of the motor ``burn_out``; the end of the stroke of a ``spring``; of a ``joint``, its
    separation distance ``stroke`` (m), the ``distance`` between its two points (m), the ``angle``
    between its bodies (rad), and its ``force`` (N) and ``moment`` (N m) on the second body; of a
    ``body``, the ``altitude`` (m) and ``vertical_speed`` (m/s, positive upward) of its mass centre.

    With a ``direction`` the quantity must cross its threshold in that direction. Without one an
    altitude or a vertical speed must cross it in either direction; any other quantity meets it at
    or beyond the threshold.
    """

    time: Annotated[float, NotNegative, Quantity("time")] | None = None
    burn_out: str | None = None
    spring: str | None = None
    joint: str | None = None
    stroke: Annotated[float, NotNegative, Quantity("length")] | None = None
    distance: Annotated[float, Positive, Quantity("length")] | None = None
    angle: Annotated[float, Meta(gt=0, le=math.pi), Quantity("angle")] | None = None
    force: Annotated[float, Positive, Quantity("force")] | None = None
    moment: Annotated[float, Positive, Quantity("moment")] | None = None
    body: str | None = None
    altitude: Annotated[float, Quantity("length")] | None = None
    vertical_speed: Annotated[float, Quantity("speed")] | None = None
    direction: Literal["rising", "falling", "either"] | None = None
    any: tuple["Condition", ...] = ()
    all: tuple["Condition", ...] = ()


class Phase(_Table, frozen=True, kw_only=True):
    """An interval of the flight, which ends when ``until`` is met; the last phase has None and
    lasts to the end of the run. ``joints`` maps the name of a joint to its kind in this phase,
    which a `Release` may change; joints not named are free."""

    name: Name
    joints: dict[str, str] = field(default_factory=dict)
    until: Condition | None = None


class Release(_Table, frozen=True, kw_only=True):
    """Change of one joint to the kind ``to`` when a condition is met, in any phase, or the joint's
    ``delay`` later. A case that ends with the condition not met and the joint constraining more
    than ``to`` does has the status never-released, unless the release is ``optional``."""

    name: Name
    joint: str
    to: str = "free"
    when: Condition
    optional: bool = False


class Event(_Table, frozen=True, kw_only=True):
    """An instant, when its condition is first met, at which rates, attitudes, separations and
    clearances are recorded as outcomes."""

    name: Name
    when: Condition


class Clearance(_Table, frozen=True, kw_only=True):
    """Request for outcomes: the minimum distance between the outlines of two bodies over the
    flight, or from the instant on at which the joint ``after`` becomes free; its time and place;
    and whether the outlines met (recontact). ``outlines`` names the parts that count, of the first
    and of the second body (empty: all)."""

    name: Name
    bodies: tuple[str, str]
    outlines: tuple[Names, Names] = ((), ())
    after: str | None = None


class Output(_Table, frozen=True, kw_only=True):
    """Optional outcomes: names of joints for which to report ``loads``, ``tip_off`` rates at
    release, ``guide`` pin loads or ``hinge`` angles; of bodies for ``transverse`` rates; and pairs
    of bodies for their ``relative`` attitude and distance."""

    loads: tuple[str, ...] = ()
    tip_off: tuple[str, ...] = ()
    guide: tuple[str, ...] = ()
    transverse: tuple[str, ...] = ()
    hinge: tuple[str, ...] = ()
    relative: tuple[tuple[str, str], ...] = ()


class FormulaOutcome(_Table, frozen=True, kw_only=True):
    """Outcome computed by a formula of the outcomes before it, each in the unit of its column.
    ``unit`` is that of the result and ends the name of its column ("1": none)."""

    name: Name
    formula: str
    unit: str = "1"


class Initial(_Table, frozen=True, kw_only=True):
    """Initial altitude (m) and speed (m/s) of the mass centre of the mated vehicle, its attitude
    (rad) and its rates ``omega`` (rad/s, body axes). The velocity has the path angles ``pitch`` -
    ``alpha`` and ``path_yaw`` (rad); CONVENTIONS.md defines all angles. The outcome ``alpha_ref``
    of a body is its pitch minus ``path_reference`` (rad; None: nominal ``pitch`` - ``alpha``)."""

    altitude: Length
    speed: Annotated[float, NotNegative, Quantity("speed")]
    omega: Annotated[Vector, Quantity("angular rate", XYZ)] = (0.0, 0.0, 0.0)
    alpha: Angle = 0.0
    pitch: Angle = 0.0
    yaw: Angle = 0.0
    roll: Angle = 0.0
    path_yaw: Angle = 0.0
    path_reference: Angle | None = None


SALTELLI = "saltelli"
REPLICATES = 8  # independently scrambled sequences of a Saltelli design


class Run(_Table, frozen=True, kw_only=True):
    """Run settings: end of the flight (s), number of cases, sampling of their inputs, histories.

    ``sampler`` and ``seed`` determine the inputs of the cases ("lhs": Latin hypercube; "saltelli":
    a design for total sensitivity indices). ``samples`` is the path of a table with a row for each
    case, whose cases are run instead of the first ``cases``; None for no table. Its columns replace
    the samples of the inputs that they give; the other dispersed inputs are sampled all the same.
    ``history_step`` is the time between rows of histories (s; 0: no histories), ``chunk`` the
    largest number of cases in one kernel call.
    """

    end_time: Annotated[float, Positive, Quantity("time")]
    cases: Annotated[int, Meta(ge=1, le=CASES)] = 1000
    seed: Annotated[int, Meta(ge=0, le=SEED)] = 0
    sampler: Literal["random", "lhs", "sobol", "saltelli"] = "random"
    samples: str | None = None
    history_step: Time = 0.0
    chunk: Annotated[int, Meta(ge=1)] = 16384


class Solver(_Table, frozen=True, kw_only=True):
    """Solver settings: formulation of the equations, integration method, requested accuracy
    (relative to the size or standard deviation of outcomes), and treatment of constraint ``drift``.

    The accuracy determines the steps unless ``step`` is given: steps are then of at most that
    length, s, and the error is only reported. None for ``step``: not given."""

    formulation: Literal["reduced", "full"] = "reduced"
    method: Literal["auto", "sharp9", "dop853", "tp7", "dopri5", "rk4"] = "auto"
    accuracy: Annotated[float, Meta(ge=1e-12, le=0.1)] = 1e-9
    step: Annotated[float, Positive, Quantity("time")] | None = None
    drift: Literal["projection", "baumgarte", "none"] = "projection"


class Scene(_Table, frozen=True, kw_only=True):
    """All of a campaign that every case shares: vehicle, environment, sequence of phases, outputs,
    run and solver settings, and the nominal values of dispersed parameters.

    Fields are named as the tables of the file; ``body`` and ``joint`` are dicts by name.
    ``release`` and ``event`` have conditions that are independent of phases; ``clearance``,
    ``outcome`` and ``output`` request outcomes. ``driven`` has, by path of the parameter without
    unit, the numbers that a signal changes during the flight.
    """

    environment: Environment = field(default_factory=Environment)
    body: dict[Name, Body]
    motor: tuple[Motor, ...] = ()
    spring: tuple[Spring, ...] = ()
    load: tuple[Load, ...] = ()
    signal: tuple[Signal, ...] = ()
    proximity: tuple[Proximity, ...] = ()
    joint: dict[Name, Joint] = field(default_factory=dict)
    phase: tuple[Phase, ...]
    release: tuple[Release, ...] = ()
    event: tuple[Event, ...] = ()
    clearance: tuple[Clearance, ...] = ()
    outcome: tuple[FormulaOutcome, ...] = ()
    output: Output = field(default_factory=Output)
    initial: Initial
    run: Run
    solver: Solver = field(default_factory=Solver)
    # numbers that signals give, by the paths of their parameters
    driven: Annotated[dict[str, Driven], Derived()] = field(default_factory=dict)


class Distribution(_Table, frozen=True, kw_only=True):
    """Distribution of one parameter as a file gives it: one of the kinds ``uniform`` to
    ``constant``, or a ``column`` of ``run.samples``. A single number of ``uniform``, ``normal`` or
    ``triangular`` is the half range (``normal``: sigma) about the nominal; several are (low, high),
    (mean, sigma) or (low, mode, high). All numbers are in the unit of the key or, with
    ``relative``, fractions of the nominal. ``weights``, in any scale, belong to the values of
    ``discrete`` (equal if None); ``truncate_sigma`` cuts ``normal`` at that many sigma on both
    sides."""

    uniform: float | tuple[float, float] | None = None
    normal: float | tuple[float, float] | None = None
    triangular: float | tuple[float, float, float] | None = None
    discrete: tuple[float, ...] | None = None
    constant: float | None = None
    column: str | None = None  # of run.samples, in the unit of the key
    weights: tuple[float, ...] | None = None
    truncate_sigma: Annotated[float, Positive] | None = None
    relative: bool = False


class Correlation(_Table, frozen=True, kw_only=True):
    """Correlation of dispersed parameters by a Gaussian copula: one coefficient for the normal
    scores of every pair, or a matrix of coefficients in the order of ``parameters``; the other of
    the two is None."""

    parameters: tuple[str, ...]
    coefficient: Annotated[float, Meta(ge=-1.0, le=1.0)] | None = None
    matrix: tuple[tuple[float, ...], ...] | None = None


VIOLATION = "violation"  # metric of a requirement that no other requirement is violated


class Requirement(_Table, frozen=True, kw_only=True):
    """A condition that at least the fraction ``probability`` of all cases must satisfy.

    ``metric`` is the column of an outcome, with bounds ``at_least`` and ``at_most`` (None: no such
    bound; inclusive; in the unit of the column, not SI); or a status that must not occur; or
    `VIOLATION`, if no other requirement may be violated. A status and `VIOLATION` have no bounds.
    Verdicts use a one-sided bound of that fraction with this ``confidence``.
    """

    name: Name
    metric: str  # an outcome, a status that must not occur, or VIOLATION
    at_least: float | None = None
    at_most: float | None = None
    probability: Annotated[float, _FRACTION] = 0.9973
    confidence: Annotated[float, _FRACTION] = 0.9
