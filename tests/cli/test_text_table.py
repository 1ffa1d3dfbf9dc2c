"""Tables in plain text."""

from sepmc.text_table import text_table


def test_columns_are_aligned_without_trailing_blanks():
    rows = [("name", "n", "verdict"), ("a", "10", ""), ("longer", "7", "pass")]
    assert text_table(rows, left=(0, 2)) == [
        "name     n  verdict",
        "a       10",
        "longer   7  pass",
    ]


def test_the_first_column_is_left_by_default():
    assert text_table([("a", "1"), ("bb", "22")]) == ["a    1", "bb  22"]
