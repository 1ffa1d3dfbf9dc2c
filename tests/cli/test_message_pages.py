"""The pages of statuses and messages name all that the code has."""

import re
import sys
from pathlib import Path

import pytest

from sepmc.cli import exits
from sepmc.schema import Status

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def site():
    """Modules of the site that read messages, and their remedies."""
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        import messages
        import remedies
    finally:
        sys.path.pop(0)
    return messages, remedies


def page(name):
    return (DOCS / "reference" / f"{name}.md").read_text(encoding="utf-8")


def test_every_status_has_meaning_and_remedy():
    """Only a case that reached its end needs none."""
    assert all(status.meaning for status in Status)
    assert [status for status in Status if not status.remedy] == [Status.OK]


def test_every_status_has_a_first_step_on_its_page():
    """But for the statuses that no kernel writes."""
    written = {
        name
        for file in (DOCS.parent / "sepmc").rglob("*.py")
        if file.name != "schema.py"
        for name in re.findall(r"Status\.([A-Z_]{3,})\b", file.read_text(encoding="utf-8"))
    }
    steps = page("statuses").partition("## What to do next")[2]
    labels = {
        label for row in re.findall(r"^\| (.*?) \|", steps, re.M) for label in row.split(", ")
    }
    assert {f"`{Status[name].label}`" for name in written - {"OK"}} <= labels


def test_every_exit_code_is_on_the_page():
    codes = (exits.DONE, exits.FAILED, exits.BAD_INPUT, exits.INVALID)
    rows = re.findall(r"^\| ([\d, ]+) \|", page("messages"), re.M)
    listed = {int(code) for row in rows for code in row.split(",")}
    assert listed == {*codes, exits.INTERRUPTED, exits.TERMINATED}


@pytest.mark.parametrize(
    ("kinds", "table"), [("NOTE", "OF_NOTES"), ("FOLDER_ERRORS", "OF_FOLDERS")]
)
def test_every_message_has_a_remedy(site, kinds, table):
    """And every remedy has a message."""
    messages, remedies = site
    wanted = getattr(messages, kinds)
    results = [m for m in messages.read_messages() if m.kind in wanted]
    groups = messages.with_remedies(results, getattr(remedies, table))
    assert groups.pop("") == []
    assert [pattern for pattern, group in groups.items() if not group] == []
    assert len(results) > 50


def test_every_error_of_a_user_is_on_the_page(site):
    """Each class of error whose message a command prints belongs to a section of the page."""
    messages, _ = site
    kinds = {m.kind for m in messages.read_messages()}
    public = {
        name
        for file in (DOCS.parent / "sepmc").rglob("*.py")
        for name in re.findall(
            r"^class ([A-Z]\w+)\(.*(?:Error|Exception)\b", file.read_text(), re.M
        )
    }
    internal = {
        "FormulaError",  # its text becomes that of a problem
        "FormatError",  # its text becomes that of a problem
        "NoLikelihoodError",  # its text becomes that of an InputError
        "FarPosteriorError",  # its too
        "TranslationError",  # of texts and formulas that sepmc itself contains
        "TooManyProblems",  # ends the reading of a file with many problems
        "UnknownError",  # of `sepmc check`, whose text says what is not known
        "UnknownPath",  # its text becomes that of a problem
        "WorkLimitError",  # ends a single case, which then has a note
    }
    listed = {*messages.FOLDER_ERRORS, *messages.ARGUMENT_ERRORS}
    assert public - internal <= listed
    assert listed <= kinds
