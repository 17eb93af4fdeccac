"""Rehearsals of the calibration of cameras with simulated ones."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.cameras.rig_file import read_rig, write_rig
from defsense_fab.capture.tags.detection import BoardFinder
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, save_board
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.live import board_twin
from defsense_fab.twin.live.board_twin import BoardTwin
from tests.support.errors import raises
from tests.support.films import command, parse_json


@pytest.fixture
def camera(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_board(CharucoBoard(), tmp_path / "board.json")

    def run(what, *words, more=("--json",)):
        return command(capsys, "capture", "camera", what, *words, "--board", "board.json", *more)

    return run


def test_rehearsal_finds_the_true_cameras(camera, tmp_path):
    code, out, lines = camera("calibrate", "twin", "--views", "10", "--name", "a", "b")
    assert code == 0
    assert lines[0].startswith("a: 1 of 10 views; ")
    truth = BoardTwin(CharucoBoard()).cameras
    assert np.abs(truth[0].focal / truth[1].focal - 1).max() > 0.005
    for data, true, name in zip(parse_json(out), truth, "ab", strict=True):
        assert data["name"] == name
        assert data["true_focal"] == true.focal.tolist()
        assert np.abs(np.array(data["focal"]) / true.focal - 1).max() < 0.002
        assert np.abs(np.array(data["center"]) - true.matrix[:2, 2]).max() < 3
        assert (data["hints"], data["left_out"]) == ([], 0)
        assert data["coverage"] >= 0.9
    assert not read_rig(tmp_path / "cameras.toml").placed
    code, out, _ = camera("arrange", "twin", "--views", "8")
    data = parse_json(out)
    assert (code, data["warnings"]) == (0, [])
    assert data["distances"] == pytest.approx(data["true_distances"], rel=2e-3)
    assert data["true_distances"][1] > 100
    code, out, _ = camera("check", "twin", "--views", "2", more=())
    assert code == 0
    # With another seed the cameras differ from the calibrated ones.
    code, out, _ = camera("check", "twin:seed=2", "--views", "2")
    assert (code, parse_json(out)["holds"]) == (1, False)


def test_board_is_shown_in_its_measured_size_and_detected():
    for board in (
        CharucoBoard(9, 6, 20.0, 14.0, measured=19.4),
        CharucoBoard(6, 6, 60.0, 42.0, legacy=True),
        CharucoBoard(inverted=True),
    ):
        twin = BoardTwin(board, seed=4)
        open_camera = twin.together()
        finder = BoardFinder(board)
        true = board.corners - board.corners.mean(axis=0)
        source = open_camera("cam_1")
        source.start()
        view = finder.find(source.read(0)[0])
        assert view is not None
        # The view agrees with the true position of the board to a fraction of a pixel.
        middle = twin.show_to_all()(0.0).patches[0]
        world = middle.center + (true * [1, -1, 1]) @ middle.axes.T
        pixels = twin.cameras[1].project(world)[view.ids]
        assert np.linalg.norm(pixels - view.corners, axis=1).max() < 0.4
        source.close()


def test_same_seed_gives_the_same_frames():
    def frame(seed):
        source = BoardTwin(CharucoBoard(), seed).alone("cam_0")
        source.start()
        image, first = source.read(0)
        _, second = source.read(0)
        source.close()
        assert (first, second) == (0, 100_000_000)
        return image

    assert np.array_equal(frame(3), frame(3))
    assert not np.array_equal(frame(3), frame(4))


def test_hand_gives_up_after_many_positions(monkeypatch):
    monkeypatch.setattr(board_twin, "MAX_POSITIONS", 0)
    source = BoardTwin(CharucoBoard()).alone("cam_0")
    source.start()
    source.read(0)
    with raises(CaptureError, "views-too-few", camera="cam_0"):
        source.read(0)
    source.close()


def test_invalid_twins_are_rejected(camera, tmp_path):
    for words, value in (
        (("twin", "twin"), "twin"),
        (("0", "twin"), "twin"),
        (("twin:speed=2",), "speed"),
        (("twin:cameras=7",), "cameras: 7"),
        (("twin:cameras=3", "--name", "a", "b"), "cam_0 cam_1 cam_2"),
    ):
        code, _, (error,) = camera("calibrate", *words)
        assert code == 2
        assert value in error
    assert camera("arrange", "twin:cameras=1")[0] == 2
    truth = BoardTwin(CharucoBoard()).cameras
    write_rig(tmp_path / "cameras.toml", [replace(truth[0], name="only")], {})
    assert "only" in camera("check", "twin")[2][0]
