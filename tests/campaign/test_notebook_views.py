"""What a notebook shows of results and cases: well-formed tables with small figures."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from support.sizing_problem import FORCE, campaign

from sepmc.analysis.inline_figures import histogram_svg, position_svg
from sepmc.analysis.statistics import histogram


def numbers(svg, path):
    """Numbers in the n-th path of a figure."""
    return [
        float(x) for x in re.findall(r"[\d.]+", ET.fromstring(svg).findall("path")[path].get("d"))
    ]


def test_bars_and_bounds():
    """Bins are taken together; a bound outside the range is left out."""
    values = np.concatenate([np.zeros(500), np.linspace(0.0, 1.0, 500)])
    svg = histogram_svg(histogram(values), [0.25, 7.0])
    bars, bound = numbers(svg, 0), numbers(svg, 1)
    assert len(ET.fromstring(svg)) == 2
    assert bars[2] == 0.0  # the first bar is the highest one
    assert min(bars[4::2][:-1]) > 15.0
    assert bound[0] == pytest.approx(1.0 + 0.25 * 118.0, abs=0.1)
    assert histogram_svg(None) == histogram_svg(histogram(np.ones(9))) == ""


def test_position():
    assert numbers(position_svg(3.0, 1.0, 5.0), 0)[0] == pytest.approx(60.0)
    assert numbers(position_svg(9.0, 1.0, 5.0), 0)[0] == pytest.approx(119.0)
    assert position_svg(1.0, 1.0, 1.0) == ""


def test_result_and_case():
    """A verdict, a row for each outcome with its histogram, and where each input lies."""
    result = campaign().with_settings({FORCE.key: 1600.0}).run(200, 2)
    shown = result._repr_html_()
    table = ET.fromstring(f"<div>{shown}</div>")
    violations = result.requirements()["violations"].iloc[0]
    assert any(
        one.text.endswith(f": fast, {violations} of 200 cases violate it")
        for one in table.findall("p")
    )
    rows = {row.find("th").text: row for row in table.find("table/tbody")}
    assert list(rows) == list(result.statistics().index)
    svg = rows["separation_speed_m_s"].find(".//svg")
    assert len(svg) == 2  # bars and the bound
    case = result.case(int(result.to_pandas()["in_spring_pusher_factor"].idxmin()))
    (row,) = ET.fromstring(f"<div>{case._repr_html_()}</div>").findall("table/tr")
    assert row.find("td").text == "in_spring_pusher_factor"
    assert case.reach == {"in_spring_pusher_factor": (pytest.approx(0.2), pytest.approx(1.8))}
    assert 20.0 < numbers(ET.tostring(row.find(".//svg"), encoding="unicode"), 0)[0] < 60.0
