"""Signals in tables of other programs."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.recordings.series import read_series
from tests.support.errors import raises

TIME = np.arange(50) / 50
OHM = np.round(2000 + 100 * np.random.default_rng(0).random((50, 2)), 3)


def write(path, separator=",", decimal=".", encoding="utf-8", head="", names="time,a_ohm,b_ohm"):
    rows = [
        separator.join(f"{x:.3f}".replace(".", decimal) for x in (t, *ohm))
        for t, ohm in zip(TIME, OHM, strict=True)
    ]
    lines = [names.replace(",", separator), *rows]
    path.write_bytes((head + "\r\n".join(lines) + "\r\n").encode(encoding))
    return path


@pytest.mark.parametrize(
    "form",
    [
        {},
        {"separator": ";", "decimal": ","},
        {"separator": "\t", "decimal": ",", "encoding": "utf-16"},
        {"separator": ";", "head": "sep=;\r\n"},
        {"encoding": "utf-8-sig", "names": "Time,a_Ohm,b_OHM"},
    ],
)
def test_tables_of_spreadsheets_are_read(tmp_path, form):
    series = read_series(write(tmp_path / "s.csv", **form))
    assert series.channels == ("a", "b")
    np.testing.assert_array_equal(series.time, TIME)
    np.testing.assert_array_equal(series.ohm, OHM)
    assert series.notes == ()


@pytest.mark.parametrize("lost", range(1, 22))
def test_last_row_that_is_cut_off_is_left_out(tmp_path, lost):
    """One byte of the line's end, or all, may be missing without a loss of numbers."""
    path = write(tmp_path / "s.csv")
    path.write_bytes(path.read_bytes()[:-lost])
    series = read_series(path)
    is_whole = lost <= 2
    assert len(series.time) == 49 + is_whole
    assert len(series.notes) == (not is_whole)
    np.testing.assert_array_equal(series.ohm, OHM[: len(series.time)])


def test_short_rows_in_the_middle_are_refused(tmp_path):
    path = write(tmp_path / "s.csv")
    lines = path.read_text().splitlines()
    lines[10] = lines[10].rsplit(",", 1)[0]
    path.write_text("\n".join(lines) + "\n")
    with raises(TrainingError, "cell-count-differs", line=11):
        read_series(path)
