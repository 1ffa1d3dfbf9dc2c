"""The immutable scene and campaign, in SI and radians. Field names carry no unit here; in TOML they do (``mass_kg``)."""

import math
from typing import Annotated, Literal, NamedTuple

from msgspec import Meta, Struct, field


class Quantity(NamedTuple):
    """What a field measures (a kind of `sepmc.scene.units.UNITS`) and the names of its components, if a vector."""

    kind: str
    components: tuple[str, ...] = ()


_XYZ = ("x", "y", "z")
Positive = Meta(gt=0)
NotNegative = Meta(ge=0)
Vector = tuple[float, float, float]
Length = Annotated[float, Quantity("length")]
Time = Annotated[float, NotNegative, Quantity("time")]
Angle = Annotated[float, Quantity("angle")]
Speed = Annotated[float, NotNegative, Quantity("speed")]
Point = Annotated[Vector, Quantity("length", _XYZ)]
Direction = Annotated[Vector, Quantity("", _XYZ)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]*\Z")]
Polynomial = dict[str, float]  # "const", "alpha", "alpha2", "alpha_beta", ... -> coefficient, angles in radians
JointKind = Literal["fixed", "slider", "free"]


class _Table(Struct, frozen=True):
    pass


class Wind(_Table, frozen=True, kw_only=True):
    speed: Speed = 0.0
    direction: Angle = 0.0


class Environment(_Table, frozen=True, kw_only=True):
    atmosphere: Literal["us1976", "none"] = "us1976"
    gravity: Literal["inverse-square", "constant", "none"] = "inverse-square"
    surface_gravity: Annotated[float, Positive, Quantity("acceleration")] = 9.80665
    wind: Wind = field(default_factory=Wind)


class Aerodynamics(_Table, frozen=True, kw_only=True):
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


class Body(_Table, frozen=True, kw_only=True):
    mass: Annotated[float, Positive, Quantity("mass")]
    inertia: Annotated[Vector, Quantity("inertia", ("xx", "yy", "zz"))]
    inertia_products: Annotated[Vector, Quantity("inertia", ("xy", "xz", "yz"))] = (0.0, 0.0, 0.0)
    inertia_factor: Annotated[float, Positive] = 1.0
    cg: Point
    aerodynamics: Aerodynamics | None = None


class Motor(_Table, frozen=True, kw_only=True):
    name: Name
    body: str
    thrust: Annotated[float, Quantity("force")]
    build_up: Time = 0.0
    ignition: Time = 0.0
    burn: Annotated[float, Positive, Quantity("time")] = math.inf
    station: Length
    radius: Annotated[float, NotNegative, Quantity("length")] = 0.0
    cant: Angle = math.pi
    clock: Angle = 0.0
    offset: Annotated[tuple[float, float], Quantity("length", ("y", "z"))] = (0.0, 0.0)
    deflection: Angle = 0.0
    deflection_clock: Angle = 0.0


class Joint(_Table, frozen=True, kw_only=True):
    bodies: tuple[str, str]
    point: Point
    x_axis: Direction = (1.0, 0.0, 0.0)
    y_axis: Direction = (0.0, 1.0, 0.0)
    apart: Literal[1, -1] | None = (
        None  # sign of r_B - r_A along x_axis that counts as apart; None: toward the second nominal centre of mass
    )


class Until(_Table, frozen=True, kw_only=True):
    time: Annotated[float, NotNegative, Quantity("time")] | None = None
    joint: str | None = None
    stroke: Annotated[float, NotNegative, Quantity("length")] | None = None


class Phase(_Table, frozen=True, kw_only=True):
    name: Name
    joints: dict[str, JointKind] = field(default_factory=dict)
    until: Until | None = None


class Initial(_Table, frozen=True, kw_only=True):
    altitude: Length
    speed: Annotated[float, Positive, Quantity("speed")]
    omega: Annotated[Vector, Quantity("angular rate", _XYZ)] = (0.0, 0.0, 0.0)
    alpha: Angle = 0.0
    pitch: Angle = 0.0
    yaw: Angle = 0.0
    roll: Angle = 0.0
    path_yaw: Angle = 0.0
    path_reference: Angle | None = None  # zero of `alpha_ref`; None: nominal pitch - alpha


class Run(_Table, frozen=True, kw_only=True):
    end_time: Annotated[float, Positive, Quantity("time")]
    cases: Annotated[int, Meta(ge=1, le=10**9)] = 1000
    seed: Annotated[int, NotNegative] = 0
    history_step: Time = 0.0  # 0: no histories
    chunk: Annotated[int, Meta(ge=1)] = 2048


class Solver(_Table, frozen=True, kw_only=True):
    formulation: Literal["reduced", "full"] = "reduced"
    method: Literal["dop853", "rk4"] = "dop853"
    step: Annotated[float, Positive, Quantity("time")] = 0.05


class Scene(_Table, frozen=True, kw_only=True):
    """What flies and how it is integrated."""

    environment: Environment = field(default_factory=Environment)
    body: dict[Name, Body]
    motor: tuple[Motor, ...] = ()
    joint: dict[Name, Joint] = field(default_factory=dict)
    phase: tuple[Phase, ...]
    initial: Initial
    run: Run
    solver: Solver = field(default_factory=Solver)


class Law(_Table, frozen=True, kw_only=True):
    """How one parameter varies. Exactly one law; numbers in the unit of the parameter's key."""

    uniform: float | tuple[float, float] | None = None
    normal: float | tuple[float, float] | None = None
    triangular: float | tuple[float, float, float] | None = None
    discrete: tuple[float, ...] | None = None
    constant: float | None = None
    weights: tuple[float, ...] | None = None
    truncate_sigma: Annotated[float, Positive] | None = None
    relative: bool = False


class Expected(_Table, frozen=True, kw_only=True):
    mean: float | None = None
    sigma: Annotated[float, Positive] | None = None
    min: float | None = None
    max: float | None = None


class Reference(_Table, frozen=True, kw_only=True):
    """Statistics printed elsewhere, to stand beside the campaign's own."""

    source: str
    outcome: dict[str, Expected] = field(default_factory=dict)
