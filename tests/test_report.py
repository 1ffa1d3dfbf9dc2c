"""The report of a run: one page that holds all it shows, with verdicts, drivers and worst cases."""

import re
from html.parser import HTMLParser

import pytest
from click.testing import CliRunner

import sepmc
from sepmc import cli
from sepmc.trust.gate.plain import flown_plainly

REQUIRED = [
    {"name": "fast", "metric": "separation_speed_m_s", "at_least": 0.53, "probability": 0.9},
    {"name": "slow", "metric": "separation_speed_m_s", "at_most": 10.0, "probability": 0.9},
    {"name": "parts", "metric": "never-released"},
]


def call(*arguments):
    return CliRunner().invoke(cli.main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run folder with a requirement that fails and one that is shown."""
    settings = {"requirement": REQUIRED, "title": "A < B & <script>alert(1)</script>"}
    folder = tmp_path_factory.mktemp("report") / "run"
    with flown_plainly():
        sepmc.load("table2", settings).run(cases=60, seed=3, out=folder)
    return folder


@pytest.fixture(scope="module")
def page(run):
    found = call("report", run)
    assert found.exit_code == 0, found.output
    assert "flies case" in found.stdout
    return (run / "report.html").read_text(encoding="utf-8")


class Tags(HTMLParser):
    """All elements open and close in order; what they refer to."""

    def __init__(self):
        super().__init__()
        self.open, self.refers, self.count = [], [], {}

    def handle_starttag(self, tag, attrs):
        self.count[tag] = self.count.get(tag, 0) + 1
        self.refers += [value for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in ("meta", "br", "link", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs):
        self.refers += [value for name, value in attrs if name in ("src", "href", "xlink:href")]


def test_one_page(page):
    """It is well formed, asks nothing of other files, and shows what a file says as text."""
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert all(found.startswith("#") for found in tags.refers)
    assert "script" not in tags.count
    assert "A &lt; B &amp; &lt;script&gt;" in page
    # outcomes over time and as histograms, drivers, three figures of each worst case
    assert tags.count["svg"] == 2 + 1 + 1 + 3 * 2
    assert len(page) < 3e6


def test_what_it_says(page):
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))
    assert "FAIL fast: separation_speed_m_s &gt;= 0.53 m/s in 90 % of all cases" in text
    assert "PASS slow: separation_speed_m_s &lt;= 10 m/s" in text
    assert "NOT SHOWN parts: never-released does not occur in 99.73 %" in text
    assert "60 cases, 60 ok" in text
    assert "what drives separation_speed_m_s" in text
    assert "fast, " in text
    assert "of 60 cases: " in text
    assert "the worst of fast: separation_speed_m_s 0.4" in text
    assert "audit passed" in text
    assert "numerical error at most" in text
    assert "name = &#34;fast&#34;" in page  # the campaign file


def test_options(run, tmp_path):
    found = call("report", run, "--no-replay", "--quiet")
    assert (found.exit_code, found.output) == (0, "")
    assert "Worst cases" not in (run / "report.html").read_text(encoding="utf-8")
    wrong = call("report", tmp_path)
    assert wrong.exit_code == 2
    assert str(tmp_path) in wrong.stderr
