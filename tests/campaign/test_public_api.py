"""Every public name has a docstring in numpy form that agrees with its signature and its body."""

import ast
import inspect
import itertools
import re
import textwrap
from pathlib import Path

import pytest

import sepmc
from sepmc.analysis.telemetry import FlightComparison
from sepmc.campaign.execution.rare_event import RareEventEstimate

PUBLIC = {name: getattr(sepmc, name) for name in sepmc.__all__ if name != "__version__"}
# returned by a public method
PUBLIC |= {"RareEventEstimate": RareEventEstimate, "FlightComparison": FlightComparison}


def members(cls):
    """Public methods and properties that a class has from this package, by name."""
    by_name = {}
    for base in reversed(cls.__mro__):
        if base.__module__.partition(".")[0] == "sepmc":
            for name, member in vars(base).items():
                function = getattr(member, "fget", None) or getattr(member, "func", None) or member
                if not name.startswith("_") and inspect.isfunction(function):
                    by_name[name] = member
    return by_name


NAMES = {name: item for name, item in PUBLIC.items()} | {
    f"{name}.{member}": function
    for name, item in PUBLIC.items()
    if inspect.isclass(item)
    for member, function in members(item).items()
}


def function_of(item):
    """Function of a method or property; the item itself else."""
    return getattr(item, "fget", None) or getattr(item, "func", None) or item


def sections(item):
    """Sections of a numpy docstring: lines under an underlined title, by title."""
    lines = inspect.cleandoc(item.__doc__ or "").split("\n")
    starts = [k for k in range(len(lines) - 1) if lines[k] and re.fullmatch("-{3,}", lines[k + 1])]
    return {lines[k]: lines[k + 2 : end] for k, end in itertools.pairwise([*starts, len(lines)])}


def named(section):
    """Names of the entries of a section: ``a, b : type`` at the margin."""
    entries = [line.partition(" : ")[0] for line in section if line and not line.startswith(" ")]
    return [name.strip().lstrip("*") for entry in entries for name in entry.split(",")]


def faults(name, item):
    """Sentences on what the docstring of a name lacks."""
    function, result = function_of(item), sections(function_of(item))
    summary = inspect.cleandoc(function.__doc__ or "").split("\n\n")[0]
    if not summary or summary.startswith(f"{name}("):  # the text that dataclasses make
        yield "no docstring"
        return
    if not summary.rstrip().endswith((".", ":")):
        yield "its first paragraph is no sentence"
    if inspect.isclass(item):
        if not issubclass(item, Warning | Exception):
            wanted = list(inspect.signature(item).parameters)
            listed = named(result.get("Parameters", [])) + named(result.get("Attributes", []))
            if missing := [key for key in wanted if key not in listed]:
                yield f"undocumented: {missing}"
        return
    if function is item:
        wanted = [key for key in inspect.signature(item).parameters if key != "self"]
        listed = named(result.get("Parameters", []))
        if sorted(wanted) != sorted(listed):
            yield f"parameters {wanted}, documented {listed}"
        returns = inspect.signature(item).return_annotation
        if returns not in (None, "None") and "Returns" not in result:
            yield "no Returns"
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    if any(isinstance(node, ast.Raise) for node in ast.walk(tree)) and "Raises" not in result:
        yield "no Raises"


def test_every_name_is_on_the_page():
    """The API reference of the site lists each name of ``sepmc.__all__``."""
    text = (Path(__file__).parents[2] / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"auto\w+:: sepmc\.(\w+)$", text, re.MULTILINE))
    assert listed == set(sepmc.__all__) - {"__version__"}
    assert len(NAMES) >= 55  # members of classes included


@pytest.mark.parametrize("name", NAMES)
def test_docstring_is_complete(name):
    """Parameters are those of the signature; Returns and Raises are there where they apply."""
    assert not list(faults(name, NAMES[name]))
