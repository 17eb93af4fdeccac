"""Tables in text of other programs: the same numbers from every form, or an error at the cell.

DEFSENSE_TABLE_VARIANTS sets the number of random variants.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError, TrainingError
from defsense_fab.core.storage.delimited_text import is_cut_off, read_delimited
from tests.support.errors import raises
from tests.support.table_variants import TableVariant, random_variant

VARIANTS = int(os.environ.get("DEFSENSE_TABLE_VARIANTS", "150"))


def read(path, kind=TrainingError):
    """Return the names and numbers of a table."""
    table = read_delimited(path, kind)
    rows = list(table.rows())
    columns = [
        table.numbers([row.cells[k] for row in rows], [row.line for row in rows], name)
        for k, name in enumerate(table.names)
    ]
    return table.names, np.array(columns).T


def read_text(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "t.csv"
    path.write_bytes(text.encode(encoding))
    return read(path)


@pytest.mark.parametrize("seed", range(VARIANTS))
def test_every_form_of_a_table_has_the_same_numbers(tmp_path, seed):
    variant: TableVariant = random_variant(np.random.default_rng(seed))
    path = tmp_path / "t.csv"
    path.write_bytes(variant.content)
    if variant.is_readable:
        names, values = read(path)
        assert names == variant.names
        np.testing.assert_array_equal(values, variant.values)
    else:
        with raises(TrainingError, variant.code, line=variant.line, column=variant.column):
            read(path)


def test_stated_separators_override_others(tmp_path):
    names, values = read_text(tmp_path, 'sep=;\n"a,b,c";d\n1,5;2\n')
    assert names == ("a,b,c", "d")
    assert values.tolist() == [[1.5, 2]]


@pytest.mark.parametrize(
    "cell", ["2.231,1", "2,231.1", "2 231,1", "2\u202f231,1", "2'231.1", "1.234.567", "1,234,567"]
)
def test_separators_of_thousands_are_refused_at_their_cell(tmp_path, cell):
    with raises(TrainingError, "not-a-number", line=3, column="b", value=cell):
        read_text(tmp_path, f'a;b\n1;2\n3;"{cell}"\n')


def test_commas_in_comma_separated_cells_are_decimal_where_they_cannot_be_thousands(tmp_path):
    assert read_text(tmp_path, 'a,b\n1,"2231,1"\n')[1].tolist() == [[1, 2231.1]]
    with raises(TrainingError, "not-a-number", line=2, column="b", value="2,231"):
        read_text(tmp_path, 'a,b\n1,"2,231"\n')


@pytest.mark.parametrize("text", ["a;b\n1,5;2\n1;2.231\n", "a;b\n1.5;2\n1;2,231\n"])
def test_mixed_decimal_signs_are_refused(tmp_path, text):
    with raises(TrainingError, "decimal-signs-mixed", line=3, column="b"):
        read_text(tmp_path, text)


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "file-empty"),
        (b"\n# nothing\n;;;\n", "file-empty"),
        (b"PK\x03\x04workbook", "not-text"),
        (b"a,b\n\0\0\0\0\n", "not-text"),
        (b"a,b,a\n1,2,3\n", "column-repeated"),
        (b"a,b\n1,2,3\n", "too-many-cells"),
        (b'a,b\n1,"2\n3,4\n', "quote-unclosed"),
    ],
)
def test_invalid_tables_are_refused(tmp_path, content, code):
    (tmp_path / "t.csv").write_bytes(content)
    with raises(CaptureError, code):
        read(tmp_path / "t.csv", CaptureError)


def test_missing_files_are_refused(tmp_path):
    with raises(TrainingError, "file-not-found"):
        read(tmp_path / "none.csv")
    with raises(TrainingError, "file-unreadable"):
        read(tmp_path)


@pytest.mark.parametrize("seed", range(200))
def test_whole_tables_without_a_last_line_end_keep_their_rows(seed):
    """Shortest forms of numbers have any number of decimals."""
    numbers = np.random.default_rng(seed).normal(size=(int(seed % 40) + 1, 2)).round(4)
    *earlier, last = [[repr(float(x)) for x in row] for row in numbers]
    fewest = min((len(row[1].partition(".")[2]) for row in earlier), default=0)
    if len(last[1].partition(".")[2]) >= fewest or len(earlier) < 3:
        assert not is_cut_off(last, earlier, 2)


def test_last_rows_that_may_be_cut_off():
    rows = [["0", "1.250"], ["1", "2.500"], ["2", "0.125"]]
    assert is_cut_off(["3", "1.2"], rows, 2)
    assert is_cut_off(["3", ""], rows, 2)
    assert is_cut_off(["3"], [], 2)
    assert not is_cut_off(["3", "1.200"], rows, 2)
    assert not is_cut_off(["3", "1.2"], rows[:1], 2)
    assert not is_cut_off(["3", ""], [*rows, ["2", ""]], 2)
    assert is_cut_off(["3", "na"], [["0", "nan"], *rows], 2)


@pytest.mark.parametrize("others", [[], ["1.5"], ["1,5"]])
def test_underscores_are_no_part_of_numbers(tmp_path, others):
    path = tmp_path / "t.csv"
    path.write_text("time;a\n" + "".join(f"0;{x}\n" for x in ["1_000", *others]))
    table = read_delimited(path, CaptureError)
    rows = list(table.rows())
    with raises(CaptureError, "not-a-number", line=2):
        table.numbers([r.cells[1] for r in rows], [r.line for r in rows], "a")
