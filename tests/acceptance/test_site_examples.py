"""Every command and Python example of the site and of README.md is executed, with few cases.

Blocks marked ``sh`` and ``python`` of a page run in the order of the page, in one empty folder. A
comment ``<!-- not run: REASON -->`` before a block leaves it out; the options of its `sepmc`
commands are checked all the same. With few cases, ``--check`` may find a requirement that is not
shown.
"""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from sepmc.cli.app import main

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONVENTIONS.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += sorted((ROOT / "sepmc").rglob("README.md")) + sorted(ROOT.glob("*/README.md"))
BLOCK = re.compile(r"^(?:<!-- (.+?) -->\n)?```(sh|python)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILE = re.compile(r"`((?:[\w.]+/)+[\w.]+\.(?:py|md|toml|sh))`")
CASES = 50
# commands of which an example with fewer cases says the same
FEWER = ("--cases", str(CASES), "--no-plots")
# commands that take minutes, or last until Ctrl-C: only their options are checked
MINUTES = {"verify", "stress", "bench", "studio"}
# options that need as many cases as are given
AS_GIVEN = {"--dry-run", "--until", "--rare", "--samples", "--sampler"}


@dataclass
class Block:
    """A block of a page: its language, text, and the comment before it."""

    language: str
    text: str
    remark: str

    @property
    def is_run(self) -> bool:
        """True unless a comment leaves the block out."""
        return not self.remark.startswith("not run: ")

    @property
    def commands(self) -> list[list[str]]:
        """Arguments of its `sepmc` commands."""
        lines = self.text.replace("\\\n", " ").splitlines()
        words = [shlex.split(line, comments=True) for line in lines]
        return [each[1:] for each in words if each and each[0] == "sepmc"]


def blocks(page):
    """The blocks of a page that are code."""
    text = page.read_text(encoding="utf-8")
    return [Block(m[2], m[3], m[1] or "") for m in BLOCK.finditer(text)]


def name(page):
    """A page, for pytest to print."""
    return page.relative_to(ROOT).as_posix()


def parsed(arguments):
    """Read a command and its options, as the command line does; raises click.UsageError."""
    command = main.commands[arguments[0]]
    command.make_context(f"sepmc {arguments[0]}", list(arguments[1:]))


def shortened(arguments):
    """The same command with few cases and without figures."""
    if arguments[0] == "replay":
        return [*arguments, *(() if "--no-plots" in arguments else ("--no-plots",))]
    if arguments[0] != "campaign":
        return arguments
    if AS_GIVEN & set(arguments):
        return [*arguments, "--no-plots"]
    if "--cases" in arguments:
        value = arguments[arguments.index("--cases") + 1]
        fewer = value if ":" in value else str(min(CASES * (1 + int(float(value) > 2000)), 100))
        arguments = [fewer if word == value else word for word in arguments]
        return [*arguments, "--no-plots"]
    return [*arguments, *FEWER]


def in_place_of_fewer(arguments):
    """Saltelli designs and rare events have a least number of cases; others run as they stand."""
    if "saltelli" in arguments:
        return [("232" if word == "2320" else word) for word in arguments]
    if "--rare" in arguments and "--cases" not in arguments:
        return [*arguments, "--cases", "1e4"]
    return [("1e4" if word == "20000" and "--rare" in arguments else word) for word in arguments]


PAGES_WITH_CODE = sorted({page for page in PAGES if blocks(page)})


@pytest.mark.parametrize("page", PAGES_WITH_CODE, ids=name)
def test_options_exist(page, tmp_path, monkeypatch):
    """Every command of a page is read without an error, whether or not it is run."""
    monkeypatch.chdir(tmp_path)
    for block in blocks(page):
        for arguments in block.commands:
            if arguments != ["COMMAND", "--help"]:
                parsed(arguments)


RUN = [page for page in PAGES_WITH_CODE if any(block.is_run for block in blocks(page))]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN, ids=name)
def test_page_runs(page, tmp_path, monkeypatch):
    """The examples of a page do what it says, in its order."""
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks(page):
        if not block.is_run:
            continue
        if block.language == "python":
            exec(compile(block.text, name(page), "exec"), names)
            continue
        for arguments in block.commands:
            if arguments[0] in MINUTES:
                continue
            call = in_place_of_fewer(shortened(arguments))
            if (
                call[0] == "report" and page.name != "README.md"
            ):  # the same report, less its replays
                call = [*call, "--no-replay"]
            result = CliRunner().invoke(main, call, catch_exceptions=False)
            codes = (0, 1) if "--check" in call else (0,)
            assert result.exit_code in codes, f"sepmc {shlex.join(call)}\n{result.output}"


def test_named_files_exist():
    """Every file of the tree that a page names is there."""
    missing = []
    for page in PAGES:
        for path in FILE.findall(page.read_text(encoding="utf-8")):
            if not any((folder / path).exists() for folder in (ROOT, ROOT / "sepmc", page.parent)):
                missing.append(f"{name(page)}: {path}")
    assert missing == []


def test_blocks_are_found():
    """Pages have code, and what is left out has a reason."""
    everything = [block for page in PAGES for block in blocks(page)]
    assert len(everything) > 40
    assert all(len(block.remark) > len("not run: ") for block in everything if not block.is_run)
    assert isinstance(main, click.Group)
