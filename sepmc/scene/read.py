"""Reading of campaign files: TOML to a validated `CampaignFile`, and back to TOML text."""

import copy
import math
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from sepmc.scene.as_brought import convert_tree
from sepmc.scene.campaign_files import find_file
from sepmc.scene.checks import check_dispersion, check_scene, inertia_fault, inertia_tensor
from sepmc.scene.contents import contents
from sepmc.scene.correlation import Copula
from sepmc.scene.correlation import resolve as resolve_correlations
from sepmc.scene.design_tables import MapPlan, SizePlan, read_map, read_size
from sepmc.scene.dispersion import Dispersion, resolve
from sepmc.scene.fields import fields_of
from sepmc.scene.file_paths import FileReader, check_paths, locate
from sepmc.scene.formula_outcomes import check_formula_outcomes
from sepmc.scene.initial_rates import check_initial_rates
from sepmc.scene.input_table import CASE, InputTable, Reader
from sepmc.scene.limits import CAMPAIGN_BYTES, NAME, check_keys, check_tree, read_limited
from sepmc.scene.measurements import Measurement, check_measurements
from sepmc.scene.messages import (
    Problems,
    SceneError,
    SceneWarning,
    TooManyProblems,
    nearest,
    printable,
    warn,
)
from sepmc.scene.model import (
    SALTELLI,
    VIOLATION,
    Correlation,
    Distribution,
    Requirement,
    Scene,
)
from sepmc.scene.parameters import UnknownPath, find, replace, value
from sepmc.scene.published import Reference
from sepmc.scene.scenarios import Scenario, read_scenarios, scenario_tree
from sepmc.scene.setting_checks import check_settings, expand
from sepmc.scene.settings import apply_settings
from sepmc.scene.shape_checks import check_shapes
from sepmc.scene.signals import check_signals, read_signals, take_driven
from sepmc.scene.tables import read_array, read_table
from sepmc.schema import NOT_OK_LABELS, is_yes_or_no, outcome_columns

_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_OWN_TABLES = (
    *("name", "title", "dispersion", "correlation", "requirement", "reference", "scenario"),
    *("map", "size"),
    "measurement",
)


@dataclass(frozen=True)
class CampaignFile:
    """A validated campaign.

    Attributes
    ----------
    name : str
        Name in the file; if it has none, that of the file without its ending.
    title : str
        Text for users; empty if the file has none.
    scene : Scene
        With nominal values, in SI.
    dispersions : tuple of Dispersion
    copulas : tuple of Copula
        Groups of correlated dispersions.
    requirements : tuple of Requirement
    reference : Reference or None
        Published statistics to compare with.
    tree : dict
        The TOML tree after settings, contents of named files and conversions are put in.
    no_effect : tuple of str
        A sentence for each setting that only the nominal case uses, because a distribution gives
        the values of all other cases.
    input_table : InputTable or None
        The table of ``run.samples``.
    folder : Path
        Folder that relative paths start from.
    understood : tuple of str
        Sentences on data that were converted from other conventions or read from other files.
    scenarios : tuple of Scenario
        Named variants of the campaign, such as failure cases.
    map : MapPlan or None
        Table ``[map]``, defaults of ``sepmc map``.
    size : SizePlan or None
        Table ``[size]``, defaults of ``sepmc size``.
    measurements : tuple of Measurement
        Telemetry from which ``sepmc estimate`` learns parameters.
    """

    name: str
    title: str
    scene: Scene
    dispersions: tuple[Dispersion, ...]
    copulas: tuple[Copula, ...]
    requirements: tuple[Requirement, ...]
    reference: Reference | None
    tree: dict[str, Any]
    no_effect: tuple[str, ...] = ()
    input_table: InputTable | None = None
    folder: Path = Path()
    understood: tuple[str, ...] = ()
    scenarios: tuple[Scenario, ...] = ()
    map: MapPlan | None = None
    size: SizePlan | None = None
    measurements: tuple[Measurement, ...] = ()

    @property
    def toml(self) -> str:
        """TOML text of ``name`` and ``tree``."""
        return tomli_w.dumps({"name": self.name, **self.tree})


def read_campaign(
    file: str | Path,
    settings: dict[str, Any] | None = None,
    reader: Reader | None = None,
    file_reader: FileReader | None = None,
) -> CampaignFile:
    """Read a campaign file, apply settings to it and validate it.

    Parameters
    ----------
    file : path, run folder, or name of a shipped campaign
    settings : dict, optional
        Values by TOML path that replace those of the file: ``{"body.upper.mass_kg": 460.0}``.
    reader : callable, optional
        Reads the table that ``run.samples`` names; without it ``run.samples`` is an error.
    file_reader : callable, optional
        Reads the files that other tables name (key ``file``); without it they are not read.

    Returns
    -------
    CampaignFile

    Raises
    ------
    SceneError
        With every problem found, each as ``file: key_path = value: what is allowed``. A stage of
        checks that finds problems is the last.
    """
    path = find_file(file)
    try:
        written = read_limited(path, CAMPAIGN_BYTES)
    except ValueError as error:
        raise SceneError([f"{path}: {error}"]) from None
    except OSError as error:
        raise SceneError([f"{path}: cannot be read: {error.strerror}"]) from None
    tree = read_text(written, str(path))
    check_paths(tree, path)
    if isinstance(settings, dict):
        settings = locate(settings, path.parent)
    return parse_campaign(
        tree, str(path.name), settings, path.stem, path.parent, reader, file_reader
    )


def read_text(written: bytes, source: str) -> dict[str, Any]:
    """Parse the bytes ``written`` of a TOML file to a tree; a byte-order mark is skipped. Raises
    SceneError, whose message begins with ``source``, if they are not TOML, or a dotted key has too
    many parts. Which keys and values there are is not checked."""
    try:
        text = written.decode("utf-8-sig")
        if fault := check_keys(text):
            raise ValueError(fault)
        return tomllib.loads(text)
    # TOMLDecodeError and UnicodeDecodeError are ValueErrors
    except (ValueError, RecursionError) as error:
        raise SceneError([f"{source}: is not TOML: {printable(str(error))}"]) from None


def parse_campaign(
    tree: dict[str, Any],
    source: str,
    settings: dict[str, Any] | None = None,
    default_name: str = "campaign",
    folder: Path = Path(),
    reader: Reader | None = None,
    file_reader: FileReader | None = None,
) -> CampaignFile:
    """Apply settings to the TOML tree of a campaign and validate it; see `read_campaign`.

    Parameters
    ----------
    tree : dict
        It is not changed.
    source : str
        Name of the source in messages.
    settings, reader, file_reader : see `read_campaign`
    default_name : str
        Name of the campaign if the tree has none.
    folder : Path
        Folder that relative paths start from.

    Returns
    -------
    CampaignFile

    Raises
    ------
    SceneError
        With all problems of the first stage of checks (`_parse`) that finds one, each as
        `read_campaign` writes it.
    """
    if settings is not None and not isinstance(settings, dict):
        example = '{"run.cases": 100}'
        raise SceneError(
            [f"{source}: settings = {settings!r}: must be a dict by TOML path, as {example}"]
        )
    problems = Problems()
    try:
        return _parse(
            tree, source, settings or {}, default_name, folder, reader, file_reader, problems
        )
    except TooManyProblems:
        problems.raise_if_any(source)
        raise


def _parse(
    tree: dict[str, Any],
    source: str,
    settings: dict[str, Any],
    default_name: str,
    folder: Path,
    reader: Reader | None,
    file_reader: FileReader | None,
    problems: Problems,
) -> CampaignFile:
    """Validate a TOML tree in stages; see `parse_campaign`. After the first stage that adds
    problems SceneError is raised with all of them."""
    check_tree(tree, problems)
    problems.raise_if_any(source)
    tree = copy.deepcopy(tree)
    settings = expand(settings, tree, problems)
    check_settings(settings, problems)
    problems.raise_if_any(source)
    apply_settings(tree, settings, problems)
    if settings:
        check_tree(tree, problems)
        problems.raise_if_any(source)
    understood = file_reader(tree, folder, problems) if file_reader is not None else []
    problems.raise_if_any(source)
    if understood:
        check_tree(tree, problems)
        problems.raise_if_any(source)
    understood += convert_tree(tree, problems)
    problems.raise_if_any(source)
    name = tree.get("name", default_name)
    if not (isinstance(name, str) and _FILE_NAME.fullmatch(name) and len(name) <= NAME):
        problems.add(
            "name",
            "must be text that can name a folder: letters, digits, . - and _, beginning with a "
            f"letter or digit, at most {NAME} of them",
            name,
        )
    if not isinstance(tree.get("title", ""), str):
        problems.add("title", "must be text", tree["title"])
    known = [*_OWN_TABLES, *(k for field in fields_of(Scene).values() for k in field.keys)]
    for key in tree:
        if key not in known:
            problems.add(key, "unknown key; " + nearest(key, known))
    tables = {k: v for k, v in tree.items() if k not in (*_OWN_TABLES, "signal") and k in known}
    tables, driven = take_driven(tables)
    scene = read_table(Scene, tables, "", problems)
    signals = read_signals(tree.get("signal", []), problems)
    distributions = _read_distributions(tree.get("dispersion", {}), problems)
    reference = (
        read_table(Reference, tree["reference"], "reference", problems)
        if "reference" in tree
        else None
    )
    requirements = read_array(Requirement, tree.get("requirement", []), "requirement", problems)
    correlations = read_array(Correlation, tree.get("correlation", []), "correlation", problems)
    scenarios = read_scenarios(tree.get("scenario", []), problems)
    measurements = read_array(Measurement, tree.get("measurement", []), "measurement", problems)
    problems.raise_if_any(source)
    scene = _with_strokes(scene)
    if signals or driven:
        scene = msgspec.structs.replace(
            scene, signal=signals, driven={path: drive for path, (_, drive) in driven.items()}
        )
        check_signals(scene, driven, problems)
        problems.raise_if_any(source)
    check_scene(scene, problems)
    table = None
    if scene.run.samples is not None:
        if reader is None:
            problems.add("run.samples", "needs a reader of tables: load the campaign by sepmc.load")
        else:
            table = reader(folder / scene.run.samples, problems)
        problems.raise_if_any(source)
    dispersions = resolve(scene, distributions, problems, table)
    if table is not None:
        if not problems:  # an unreadable column gives no dispersion
            _check_input_table(table, dispersions, problems)
        run = msgspec.structs.replace(scene.run, cases=int(table.numbers[-1]) + 1)
        scene = msgspec.structs.replace(scene, run=run)
    for dispersion in dispersions:
        check_dispersion(dispersion, scene, problems)
    dispersed = frozenset(dispersion.parameter.path for dispersion in dispersions)
    if not problems:
        check_shapes(dispersions, scene, problems)
        check_initial_rates(scene, dispersed, problems)
    if len(dispersions) == len(distributions):
        copulas = resolve_correlations(correlations, scene, dispersions, problems)
        if copulas and scene.run.sampler == SALTELLI:
            problems.add(
                "run.sampler",
                "needs parameters that vary independently: remove [[correlation]]",
                scene.run.sampler,
            )
    check_formula_outcomes(scene, dispersed, problems)
    outcomes = [column.name for column in outcome_columns(contents(scene, dispersed))]
    if reference is not None:
        _check_reference(reference, outcomes, problems)
    for requirement in requirements:
        _check_requirement(requirement, requirements, outcomes, problems)
    check_measurements(measurements, contents(scene, dispersed), problems)
    for scenario in scenarios:
        scenario_tree(tree, scene, scenario, problems)
    map_plan = read_map(tree, scene, problems)
    size_plan = read_size(tree, scene, requirements, problems)
    problems.raise_if_any(source)
    _warn_inertia_range(scene, dispersions, source)
    no_effect = tuple(_no_effect_notes(scene, settings, dispersions, distributions))
    return CampaignFile(
        str(name),
        tree.get("title", ""),
        scene,
        dispersions,
        copulas,
        requirements,
        reference,
        tree,
        no_effect,
        table,
        folder,
        tuple(understood),
        scenarios,
        map_plan,
        size_plan,
        measurements,
    )


def _with_strokes(scene: Scene) -> Scene:
    """Copy of a scene in which each spring that has a table but no stroke gets the last extension
    of the table as its stroke."""
    springs = tuple(
        msgspec.structs.replace(spring, stroke=spring.table.extension[-1])
        if spring.table is not None and spring.table.extension and math.isinf(spring.stroke)
        else spring
        for spring in scene.spring
    )
    return msgspec.structs.replace(scene, spring=springs)


def _check_input_table(
    table: InputTable, dispersions: Sequence[Dispersion], problems: Problems
) -> None:
    """Add a problem for each column of the samples that is not used, if its name begins with
    ``in_`` or differs from that of a dispersed parameter (or ``case``) by capitals, punctuation or
    ``in_`` only. If ``problems`` is still empty then, add one if no column gives a dispersed
    parameter."""
    used = {dispersion.column for dispersion in dispersions}
    known = [dispersion.parameter.column for dispersion in dispersions]
    spellings = {_letters(name): name for name in (CASE, *known)}
    for name in (*table.columns, *table.words):
        meant = spellings.get(_letters(name))
        if meant and name not in used and name not in known:
            problems.add(
                f"run.samples, column {name}", f"no such column; it must be called {meant}"
            )
        elif name.startswith("in_") and name not in used and name not in known:
            reason = f"{nearest(name, known)}; samples give only parameters of [dispersion]"
            problems.add(f"run.samples, column {name}", f"no such input here: {reason}")
    if not used - {""} and not problems:
        reason = f"gives no input: it has no column of a dispersed parameter; {nearest('', known)}"
        problems.add("run.samples", reason, table.path.name)


def _letters(name: str) -> str:
    """Name of a column for comparison: in small letters, punctuation as ``_``, without a leading
    ``in_``."""
    return re.sub(r"\W", "_", name).lower().removeprefix("in_")


def _check_reference(reference: Reference, outcomes: list[str], problems: Problems) -> None:
    """Add a problem for each outcome of the published statistics that the campaign does not
    have."""
    for name in reference.outcome:
        if name not in outcomes:
            reason = "no such outcome; " + nearest(name, outcomes)
            problems.add(f"reference.outcome.{name}", reason)


def _check_requirement(
    requirement: Requirement,
    requirements: Sequence[Requirement],
    outcomes: list[str],
    problems: Problems,
) -> None:
    """Add problems of a requirement. Its metric is an outcome of the campaign, with a bound that a
    value can violate and, of two, in order; or, without bounds, a status other than ok, or
    "violation" if there are requirements of other kinds."""
    key_path, low, high = (
        f"requirement.{requirement.name}",
        requirement.at_least,
        requirement.at_most,
    )
    metrics = [*NOT_OK_LABELS, VIOLATION, *outcomes]
    if requirement.metric == VIOLATION:
        if low is not None or high is not None:
            reason = (
                f"{VIOLATION!r} of the other requirements has no bound: leave at_least and at_most "
                "out"
            )
            problems.add(key_path, reason)
        if all(other.metric == VIOLATION for other in requirements):
            problems.add(key_path, f"{VIOLATION!r} needs other requirements that may be violated")
    elif requirement.metric in NOT_OK_LABELS:
        if low is not None or high is not None:
            reason = (
                f"{requirement.metric!r} is a status, which has no bound: leave at_least and "
                "at_most out"
            )
            problems.add(key_path, reason)
    elif requirement.metric not in outcomes:
        problems.add(
            f"{key_path}.metric",
            "no such outcome or status; " + nearest(requirement.metric, metrics),
            requirement.metric,
        )
    elif low is None and high is None:
        problems.add(key_path, "needs at_least or at_most")
    elif is_yes_or_no(requirement.metric) and (
        (low or 0.0) <= 0.0 and (1.0 if high is None else high) >= 1.0
    ):
        problems.add(
            key_path, "is always satisfied: this outcome is 0 or 1; to forbid 1 give at_most = 0"
        )
    elif low is not None and high is not None and low > high:
        problems.add(f"{key_path}.at_most", f"must be at least at_least = {low:g}", high)


def _read_distributions(tree: Any, problems: Problems) -> dict[str, Distribution]:
    """Convert the table [dispersion], ``tree``, to distributions by key, the TOML path of a
    parameter. Adds problems; entries with one are left out."""
    if not isinstance(tree, dict):
        problems.add("dispersion", "must be a table", tree)
        return {}
    distributions = {}
    for key, spec in tree.items():
        if isinstance(spec, dict) and spec and all(isinstance(v, dict) for v in spec.values()):
            problems.add(
                f"dispersion.{key}",
                'put the path in quotes: "body.upper.mass_kg" = { uniform = 20.0 }',
            )
            continue
        if not isinstance(spec, dict):
            problems.add(f"dispersion.{key}", "must be a table, such as { uniform = 20.0 }", spec)
            continue
        read = read_table(Distribution, spec, f"dispersion.{key}", problems)
        if read is not None:
            distributions[key] = read
    return distributions


def _warn_inertia_range(scene: Scene, dispersions: tuple[Dispersion, ...], source: str) -> None:
    """Issue a SceneWarning for each body whose dispersed moments of inertia can form a tensor that
    no solid body has: one moment at the upper end of its `Dispersion.reach`, and the others at
    their lower ends, with the nominal products of inertia. ``source`` begins its text."""
    by_path = {d.parameter.path: d for d in dispersions}
    for name in scene.body:
        axes = [by_path.get(f"body.{name}.inertia.{axis}") for axis in ("xx", "yy", "zz")]
        for heavy in range(3):
            corner = {}
            for axis, dispersion in enumerate(axes):
                if dispersion is not None:
                    bound = (
                        dispersion.reach[1 if axis == heavy else 0] * dispersion.parameter.factor
                    )
                    corner[dispersion.parameter.path] = bound
            fault = (
                inertia_fault(inertia_tensor(replace(scene, corner).body[name])) if corner else None
            )
            if fault:
                reason = f"dispersion of body.{name}.inertia can give a case whose inertia {fault}"
                warn(f"{source}: {reason}", SceneWarning)
                break


def _no_effect_notes(
    scene: Scene,
    settings: dict[str, Any],
    dispersions: tuple[Dispersion, ...],
    distributions: dict[str, Distribution],
) -> Iterator[str]:
    """Yield a sentence on each setting that changes the nominal case only: it sets the nominal
    value of a dispersed parameter whose distribution has absolute values, or whose values a column
    of the samples gives. Nothing is yielded for a parameter whose distribution the settings give
    too, and nothing at all if they replace the table [dispersion].

    Parameters
    ----------
    scene : Scene
        Scene with the settings.
    settings : dict
        Values by TOML path.
    dispersions : tuple of Dispersion
    distributions : dict of str to Distribution
        The table [dispersion], by key: an entry for each of ``dispersions``, in the same order.
    """
    if "dispersion" in settings:  # the user has set the distributions too
        return
    absolute = {
        d.parameter.path: d
        for d, (key, spec) in zip(dispersions, distributions.items(), strict=True)
        if (d.column or (not spec.relative and _is_absolute(spec)))
        and f"dispersion.{key}" not in settings
    }
    for key, setting_value in settings.items():
        try:
            dispersion = absolute.get(find(scene, key).path)
        except UnknownPath:  # a table, or a number that cannot be dispersed
            continue
        if dispersion is not None:
            parameter = dispersion.parameter
            number = value(scene, parameter.path) / parameter.factor
            remedy = f"put dispersion.{parameter.key} = {{ constant = {number:g} }}"
            if dispersion.column:
                remedy = "remove the column from the samples"
            yield (
                f"{key} = {setting_value} applies to the nominal case only; all others sample "
                f"{dispersion.sentence}: to set it in all, {remedy}"
            )


def _is_absolute(spec: Distribution) -> bool:
    """True if a distribution gives absolute values: it is discrete or constant, or is written with
    several numbers, such as (low, high), instead of one half range or sigma about the nominal
    value."""
    return (
        spec.discrete is not None
        or spec.constant is not None
        or any(isinstance(x, tuple) for x in (spec.uniform, spec.normal, spec.triangular))
    )
