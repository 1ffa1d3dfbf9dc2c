"""Text tables: read as they are meant, or refused with line and reason."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_array_equal

from sepmc.formats.columns import split_header
from sepmc.formats.decks import read_deck
from sepmc.formats.text_table import FormatError, parse_table, read_table

ROWS = {
    "commas": "time_s,thrust_N\n0,1.5\n0.1,2.5\n",
    "semicolons": "time_s;thrust_N\n0;1.5\n0.1;2.5\n",
    "tabs": "time_s\tthrust_N\n0\t1.5\n0.1\t2.5\n",
    "blanks": "  time_s   thrust_N\n  0      1.5\n  0.1    2.5\n",
    "comments": "# from the stand\n% run 3\ntime_s,thrust_N\n0,1.5\n# pause\n0.1,2.5\n",
    "title": "Test stand 4\ntime_s,thrust_N\n0,1.5\n0.1,2.5\n",
    "windows": "\ufefftime_s,thrust_N\r\n0,1.5\r\n0.1,2.5\r\n",
    "quotes": '"time_s","thrust_N"\n"0","1.5"\n"0.1","2.5"\n',
    "blank lines": "\ntime_s, thrust_N\n\n0, 1.5\n,\n0.1, 2.5\n\n",
    "separator at the end": "time_s;thrust_N;\n0;1.5;\n0.1;2.5;\n",
    "exponents of Fortran": "time_s thrust_N\n0 0.15D+01\n1.0d-1 2.5\n",
}


@pytest.mark.parametrize("text", ROWS.values(), ids=list(ROWS))
def test_read(text):
    table = parse_table(text)
    assert list(table.columns) == ["time_s", "thrust_N"]
    assert_array_equal(table.columns["time_s"], [0.0, 0.1])
    assert_array_equal(table.columns["thrust_N"], [1.5, 2.5])


def test_a_line_of_units():
    table = parse_table("Time;Thrust\n[s];[lbf]\n0;1\n1;2\n")
    assert list(table.columns) == ["Time (s)", "Thrust (lbf)"]


def test_a_title_is_no_line_of_units():
    assert list(parse_table("mach,alpha\nCA,CN\n0,1\n1,2\n").columns) == ["CA", "CN"]


def test_names_for_a_table_without_header():
    table = parse_table("0 1\n1 2\n", ["time_s", "thrust_N"])
    assert_array_equal(table.columns["thrust_N"], [1.0, 2.0])


REFUSED = {
    "": "has no rows",
    "a,b\nc,d\n": "no line of numbers",
    "0,1\n1,2\n": "line 1: has no header; give the names of its 2 columns",
    "t;F\n0;0,5\n": "line 2: 0,5 has a decimal comma; write it with a point, 0.5",
    "t\tF\n0,1\t7\n": "line 2: 0,1 has a decimal comma",
    "t;F\n0;1.5\n1;2,5\n": "line 3: '2,5' has a decimal comma",
    "t,F\n0,1\n1\n": "line 3: has 1 values, the header 2 (comma between them)",
    "t,F\n0,1\n1,\n": "line 3: column F is blank",
    "t,F\n0,1\n1,x\n": "line 3: 'x' is no number",
    "t,F\n0,1\n1,nan\n": "line 3: 'nan' is not finite",
    "t,F\n0,1\n1,1e999\n": "line 3: '1e999' is not finite",
    "t,F,t\n0,1,2\n": "has the column 't' twice",
}


@pytest.mark.parametrize(("text", "reason"), REFUSED.items())
def test_refused(text, reason):
    with pytest.raises(FormatError) as caught:
        parse_table(text)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("title", "kind", "split"),
    [
        ("thrust_N", "force", ("thrust", "N")),
        ("Thrust (lbf)", "force", ("Thrust", "lbf")),
        ("Thrust [lbs]", "force", ("Thrust", "lbf")),
        ("Thrust, kN", "force", ("Thrust", "kN")),
        ("wind speed (kn)", "speed", ("wind speed", "kn")),
        ("wind speed (knots)", "speed", ("wind speed", "kn")),
        ("speed_m_s", "speed", ("speed", "m_s")),
        ("temp (C)", "temperature", ("temp", "degC")),
        ("rho (kg/m3)", "density", ("rho", "kg_per_m3")),
        ("thrust", "force", ("thrust", "")),
        ("alpha_deg", "angle", ("alpha", "deg")),
    ],
)
def test_units_of_a_header(title, kind, split):
    assert split_header(title, kind) == split


def test_parquet(tmp_path):
    file = tmp_path / "a.parquet"
    pq.write_table(pa.table({"time_s": [0.0, 1.0], "note": ["a", "b"], "n": [1, 2]}), file)
    table = read_table(file)
    assert (list(table.columns), table.texts) == (["time_s", "n"], ("note",))
    pq.write_table(pa.table({"time_s": [0.0, np.nan]}), file)
    with pytest.raises(FormatError, match="row 1, counted from 0: column 'time_s'"):
        read_table(file)
    file.write_bytes(b"PAR1 no such thing")
    with pytest.raises(FormatError, match="cannot be read as Parquet"):
        read_table(file)


@pytest.mark.parametrize(
    ("texts", "options", "reason"),
    [
        (["note"], {}, ""),
        (["mach"], {}, "column 'mach': contains no numbers, as it must"),
        (["CN"], {}, "column 'CN': contains no numbers"),
        (["note"], {"columns": {"normal": "note"}}, "column 'note': contains no numbers"),
    ],
)
def test_a_text_column_of_parquet(tmp_path, texts, options, reason):
    """Is allowed beside the columns that are needed, and an error in place of one."""
    columns = {"mach": [0.5, 0.9], "CA": [1.0, 2.0], "CN": [3.0, 4.0]}
    columns |= {name: ["a", "b"] for name in texts}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    if reason:
        with pytest.raises(FormatError, match=reason):
            read_deck(tmp_path / "a.parquet", options)
        return
    tree, understood = read_deck(tmp_path / "a.parquet", options)
    assert (tree["axial"], understood[-1]) == ([1.0, 2.0], "not read: note")


def test_files_that_are_none(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(FormatError, match="is no regular file"):
        read_table(tmp_path)
    (tmp_path / "zero.csv").write_bytes(b"a,b\n\0,1\n")
    with pytest.raises(FormatError, match="NUL bytes"):
        read_table(tmp_path / "zero.csv")
    (tmp_path / "big.csv").write_bytes(b"a" * 4_000_001)
    with pytest.raises(FormatError, match="must be at most 4,000,000"):
        read_table(tmp_path / "big.csv")


def test_a_commented_header_above_rows_with_text():
    """As logs of AltOS and TeleMega have it; without as many cells it stays a comment."""
    rows = "6, 0.1,boost, 12.5\n6, 0.2,coast, 13.5\n"
    table = parse_table("#version,time,state,height\n" + rows, gaps=True)
    assert list(table.columns) == ["version", "time", "state", "height"]
    assert_array_equal(table.columns["height"], [12.5, 13.5])
    assert np.isnan(table.columns["state"]).all()
    with pytest.raises(FormatError, match="is no line of numbers"):
        parse_table("#time,height\n" + rows, gaps=True)


def test_titles_that_occur_twice_are_numbered_in_logs():
    table = parse_table("t (s),h (m),x,h (m),x\n0,1,2,3,4\n1,1,2,3,4\n", gaps=True)
    assert list(table.columns) == ["t (s)", "h #1 (m)", "x #1", "h #2 (m)", "x #2"]
    assert table.columns["h #2 (m)"][0] == 3.0
