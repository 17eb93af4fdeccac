"""Rehearsals of the calibration of cameras with simulated ones."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.capture.cameras.rig_file import read_rig, write_rig
from defsense_fab.capture.tags.detection import BoardFinder
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, save_board
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError, DeviceError
from defsense_fab.twin.live import board_twin
from defsense_fab.twin.live.board_twin import BoardTwin
from defsense_fab.twin.options import TwinCameras
from tests.support.errors import raises
from tests.support.films import command, parse_json


@pytest.fixture
def board_folder(tmp_path, monkeypatch):
    """The current folder, with a board."""
    monkeypatch.chdir(tmp_path)
    save_board(CharucoBoard(), tmp_path / "board.json")
    return tmp_path


@pytest.fixture
def camera(board_folder, capsys):
    """Run a command of cameras; return its exit code, output and error lines."""

    def run(name, *words, more=("--json",)):
        return command(capsys, "capture", "camera", name, *words, "--board", "board.json", *more)

    return run


@pytest.mark.slow
def test_rehearsal_finds_the_true_cameras(camera, tmp_path):
    code, out, lines = camera("calibrate", "twin", "--views", "10", "--name", "a", "b")
    assert code == 0
    assert lines
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
        twin = BoardTwin(board, TwinCameras(seed=4))
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
        source = BoardTwin(CharucoBoard(), TwinCameras(seed=seed)).alone("cam_0")
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
    with raises(CaptureError, "too-few-views", camera="cam_0"):
        source.read(0)
    source.close()


def run(*words):
    return run_command(["capture", "camera", *words, "--board", "board.json"])


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("twin", "twin"), "twin-not-alone"),
        (("0", "twin"), "twin-not-alone"),
        (("twin:speed=2",), "twin-cameras-invalid"),
        (("twin:cameras=7",), "out-of-range"),
        (("twin:cameras=3", "--name", "a", "b"), "camera-count-differs"),
    ],
)
def test_invalid_twins_are_rejected(board_folder, words, code):
    with raises(DeviceError, code):
        run("calibrate", *words)


def test_single_camera_is_not_arranged(board_folder):
    with raises(DeviceError, "camera-count-invalid", count=1):
        run("arrange", "twin:cameras=1")


def test_twin_with_another_number_of_cameras_is_rejected(board_folder):
    truth = BoardTwin(CharucoBoard()).cameras
    write_rig(board_folder / "cameras.toml", [replace(truth[0], name="only")], {})
    with raises(CaptureError, "camera-count-differs", cameras=1, count=2):
        run("check", "twin")
