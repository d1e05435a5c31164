"""Tables that are written."""

import csv
import io

from eadp.io.text.csv import write_rows


def test_texts_that_spreadsheets_would_take_as_formulas_are_texts():
    stream = io.StringIO()
    texts = ["=HYPERLINK(1)", "@SUM(1)", "+cmd|x", "-a", "\t=1", "north = 2", ""]
    numbers = [-1.5, "-1.5e-3", "+2", "-inf", None]
    write_rows(stream, [["=a", "b"], texts, numbers])
    rows = list(csv.reader(io.StringIO(stream.getvalue())))
    assert rows[0] == ["'=a", "b"]
    assert rows[1] == ["'=HYPERLINK(1)", "'@SUM(1)", "'+cmd|x", "'-a", "'\t=1", "north = 2", ""]
    assert rows[2] == ["-1.5", "-1.5e-3", "+2", "-inf", ""]
