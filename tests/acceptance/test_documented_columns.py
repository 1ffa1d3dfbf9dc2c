"""campaigns/README.md lists every column of a case table, and every status, as the schema has it.

``python tests/acceptance/test_documented_columns.py`` writes the list anew.
"""

from pathlib import Path

from sepmc.schema import Contents, Status, audit_columns, outcome_columns

README = Path(__file__).parents[2] / "campaigns" / "README.md"
FIRST, LAST = "| column | unit | meaning |", "<!-- end of the columns -->"
# a body, a joint, a clearance and an event with all that can be asked of them
EVERY = Contents(
    ["BODY"],
    {"JOINT": ("BODY", "OTHER")},
    loads=("JOINT",),
    guides={"JOINT": 1},
    clearances=("CLEARANCE",),
    tip_off=("JOINT",),
    events=("EVENT",),
    transverse=("BODY",),
    ignitions=("MOTOR",),
)


def listed():
    """The list as the schema gives it."""
    lines = [FIRST, "|---|---|---|"]
    for column in [*outcome_columns(EVERY), *audit_columns()]:
        name = column.name.replace("pin1", "pinN")
        lines.append(f"| `{name}` | {column.unit} | {column.meaning.replace('pin 1', 'pin N')} |")
    lines += ["", "| status | meaning |", "|---|---|"]
    lines += [f"| `{status.label}` | {status.sentence} |" for status in Status]
    return "\n".join(lines) + "\n"


def written(text):
    """The list that the page has, and what stands before and after it."""
    before, _, rest = text.partition(FIRST)
    inside, _, after = rest.partition(LAST)
    return before, FIRST + inside, LAST + after


def test_every_column_is_listed():
    """The page has the lists that the schema gives."""
    assert written(README.read_text(encoding="utf-8"))[1] == listed()


if __name__ == "__main__":
    before, _, after = written(README.read_text(encoding="utf-8"))
    README.write_text(before + listed() + after, encoding="utf-8")
