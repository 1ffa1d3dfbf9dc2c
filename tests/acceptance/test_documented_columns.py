"""The generated tables of the site contain every column, audit bound, status, option and module."""

import sys
from pathlib import Path

import pytest

import sepmc
from sepmc.cli.app import main
from sepmc.schema import AUDIT_BOUNDS, Status, audit_columns, history_columns

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def tables():
    """The module that generates the tables."""
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        import tables
    finally:
        sys.path.remove(str(DOCS / "_ext"))
    return tables


def first_cells(table):
    """The names in the first column of a Markdown table."""
    return {line.split("|")[1].strip(" `") for line in table.splitlines()[2:]}


def test_every_table_is_on_a_page(tables):
    """Every generated table has a page."""
    pages = "\n".join(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))
    assert [name for name in tables.TABLES if f"\n{{{{ table: {name} }}}}\n" not in pages] == []


def test_columns_of_a_campaign_are_listed(tables):
    """Every outcome of a shipped campaign is in the list, without the names of its file."""
    campaign = sepmc.load("residual-thrust.toml")
    listed = first_cells(tables.outcomes())
    contents = tables.EVERY
    for column in campaign.outcome_columns:
        name = column.name
        for body in campaign.scene.body:
            name = name.replace(f"{body}_", f"{contents.bodies[0]}_")
        for joint in campaign.scene.joint:
            name = name.replace(f"{joint}_", "JOINT_")
        for clearance in campaign.scene.clearance:
            name = name.replace(f"{clearance.name}_", "CLEARANCE_")
        for event in campaign.scene.event:
            name = name.replace(f"{event.name}_", "EVENT_")
        for spring in campaign.scene.spring:
            name = name.replace(f"{spring.name}_", "SPRING_")
        assert name in listed or name.removeprefix("JOINT_") in listed


def test_audits_histories_and_statuses_are_listed(tables):
    """Audit columns with their bounds, columns of histories, and statuses."""
    assert first_cells(tables.audits()) == {column.name for column in audit_columns()}
    assert all(f"| {bound:g} |" in tables.audits() for bound in AUDIT_BOUNDS.values())
    names = {column.name.replace("pin1", "pinN") for column in history_columns(tables.EVERY)}
    assert first_cells(tables.histories()) == names
    assert first_cells(tables.statuses()) == {status.label for status in Status}


def test_every_option_is_listed(tables):
    """Every command with every option."""
    text = tables.commands()
    for name, command in main.commands.items():
        part = text.partition(f"## `sepmc {name}`")[2].partition("\n## ")[0]
        for parameter in command.params:
            assert all(option in part for option in parameter.opts if option.startswith("--"))


def test_every_module_is_described(tables):
    """Every module of the package has a first sentence."""
    rows = [line for line in tables.modules().splitlines() if line.startswith("| `")]
    assert len(rows) > 150
    assert [row for row in rows if not row.rstrip(" |").split("|")[-1].strip()] == []


def test_pin_loads_are_at_hole_entry_and_tip(tables):
    """As in CONVENTIONS.md; the name of the column is older."""
    meanings = {column.name: column.meaning for column in history_columns(tables.EVERY)}
    ends = [meanings[name] for name in meanings if name.endswith("_pin1_mouth_load_N")]
    assert ends
    assert all("at the hole entry, while" in meaning for meaning in ends)
