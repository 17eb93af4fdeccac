"""Boards for calibrating cameras as files."""

import pytest

from defsense_fab.capture.tags.tag_patterns import CharucoBoard, load_board
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError
from defsense_fab.workflow.tags.boards import store_measurement, write_board
from defsense_fab.workflow.tags.options import CharucoOptions
from tests.support.errors import raises


def test_default_board_is_written_with_its_sheet(tmp_path):
    files = write_board(tmp_path / "new")
    assert files.board == CharucoBoard() == load_board(tmp_path / "new")
    assert files.sheet.read_bytes().startswith(b"%PDF")
    assert not files.lost_measurement


def test_tags_scale_with_the_squares(tmp_path):
    board = write_board(tmp_path, CharucoOptions(square=15.0)).board
    assert board.marker / board.square == pytest.approx(22 / 30)


@pytest.mark.parametrize("name", ["printed", "inverted", "legacy"])
def test_boards_that_exist_already_are_not_drawn(tmp_path, name):
    files = write_board(tmp_path, CharucoOptions(**{name: True}))
    assert files.sheet is None
    assert [p.name for p in tmp_path.iterdir()] == ["board.json"]


def test_measurement_is_stored_until_the_board_is_written_again(tmp_path):
    write_board(tmp_path)
    assert store_measurement(tmp_path, 29.9).board.scale == pytest.approx(29.9 / 30)
    assert load_board(tmp_path).measured == 29.9
    assert write_board(tmp_path).lost_measurement
    assert load_board(tmp_path).measured is None


def test_measurement_must_be_near_the_drawing(tmp_path):
    write_board(tmp_path)
    with raises(CaptureError, "print-scale-wrong"):
        store_measurement(tmp_path, 20.0)
    assert load_board(tmp_path).measured is None


def test_measurement_is_not_combined_with_another_design(tmp_path):
    with raises(CaptureError, "options-conflict", option="--square"):
        run_command(["capture", "board", str(tmp_path), "--square", "20", "--measured", "19.9"])
