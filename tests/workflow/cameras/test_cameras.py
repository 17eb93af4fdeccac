"""Cameras are calibrated, arranged and checked, from videos of a board and from live pictures."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from defsense_fab.capture.cameras.rig_file import read_rig, write_rig
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, save_board
from defsense_fab.cli.capture.camera_check import describe_check
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError, DefsenseError, DeviceError
from defsense_fab.core.progress import silent
from defsense_fab.workflow.cameras import recorded_views
from defsense_fab.workflow.cameras.board_videos import find_boards
from defsense_fab.workflow.cameras.cameras import (
    arrange_cameras,
    calibrate_cameras,
    check_cameras,
)
from defsense_fab.workflow.cameras.live_views import arrange_live, calibrate_live, check_live
from defsense_fab.workflow.cameras.options import (
    ArrangementOptions,
    CalibrationOptions,
    CameraOptions,
)
from tests.support.errors import raises
from tests.support.films import BOARD, LEFT, RIGHT, board_scene, images, take
from tests.twin.film import Shutter

pytestmark = pytest.mark.slow

POSES, RATE_HZ = 14, 10.0
VIDEOS = ("left.mkv", "right.mkv")
MOVED_RIGHT = replace(RIGHT, translation=RIGHT.translation + np.array([0, 2, 0]))


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Videos of two cameras that see a board, still for two frames in each pose."""
    folder = tmp_path_factory.mktemp("boards")
    for name, camera in (("left", LEFT), ("right", RIGHT)):
        take(
            folder / f"{name}.mkv",
            camera,
            lambda t: board_scene(int(RATE_HZ * t + 0.5) // 2),
            2 * POSES / RATE_HZ,
            Shutter(RATE_HZ),
        )
    save_board(BOARD, folder / "board.json")
    save_board(CharucoBoard(9, 6), folder / "other.json")
    return folder


@pytest.fixture(scope="module")
def find_once():
    """Find the boards of each video once: that takes the most time."""
    results, original = {}, recorded_views.find_boards

    def find(paths, board, rate, progress):
        for path in paths:
            if (path, board, rate) not in results:
                results[path, board, rate] = original([path], board, rate, progress)[0]
        return [results[path, board, rate] for path in paths]

    return find


@pytest.fixture
def rig_file(boards, find_once, tmp_path, monkeypatch):
    """A calibration that does not exist yet; the current folder has the videos."""
    monkeypatch.chdir(boards)
    monkeypatch.setattr(recorded_views, "find_boards", find_once)
    return tmp_path / "cameras.toml"


def no_screen(_):
    raise AssertionError("recordings need no screen")


def calibrate(rig_file, *sources, board="board.json", **settings):
    cameras = CameraOptions(Path(board), rig_file)
    return calibrate_cameras(
        sources, cameras, CalibrationOptions(**settings), open_screen=no_screen
    )


def arrange(rig_file, *sources, keep_world=False):
    cameras = CameraOptions(Path("board.json"), rig_file)
    arrangement = ArrangementOptions(keep_world=keep_world)
    return arrange_cameras(sources, cameras, arrangement, open_screen=no_screen)


def check(rig_file, *sources, board="board.json"):
    cameras = CameraOptions(Path(board), rig_file)
    return check_cameras(sources, cameras, open_screen=no_screen)


def test_calibration_and_arrangement_agree_with_the_true_cameras(rig_file):
    data = calibrate(rig_file, *VIDEOS)
    assert [d["name"] for d in data] == ["left", "right"]
    for d, true in zip(data, (LEFT, RIGHT), strict=True):
        assert d["error"] < 0.1
        assert np.abs(np.array(d["focal"]) - true.focal).max() < 2
    assert not read_rig(rig_file).placed
    assert "<svg" in rig_file.with_suffix(".html").read_text("utf-8")
    data = arrange(rig_file, *VIDEOS)
    assert data["distances"] == pytest.approx([0, 120], abs=0.3)
    assert data["warnings"] == []
    arranged = read_rig(rig_file)
    assert arranged.placed
    true = RIGHT.rotation @ LEFT.rotation.T
    turned = arranged.cameras[1].rotation @ true.T
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 0.3
    assert check(rig_file, *VIDEOS).is_valid


def test_new_calibration_of_a_camera_removes_all_positions(rig_file):
    write_rig(rig_file, [LEFT, RIGHT], {})
    calibrate(rig_file, "left.mkv")
    rig = read_rig(rig_file)
    assert [c.name for c in rig.cameras] == ["left", "right"]
    assert not rig.placed


def test_world_of_a_file_is_kept_on_request(rig_file):
    shifted = replace(RIGHT, translation=RIGHT.translation + np.array([4.0, 0, 0]))
    write_rig(rig_file, [LEFT, shifted], {})
    data = arrange(rig_file, *VIDEOS, keep_world=True)
    assert data["frame"] == f"the world of {rig_file}"
    left, right = read_rig(rig_file).cameras
    assert np.allclose(left.center, LEFT.center, atol=1e-6)
    assert np.allclose(left.rotation, LEFT.rotation, atol=1e-9)
    assert np.linalg.norm(right.center - RIGHT.center) < 0.5
    data = arrange(rig_file, *VIDEOS)
    assert data["frame"] == "of camera left"
    assert np.allclose(read_rig(rig_file).cameras[0].center, 0)


def test_world_is_not_kept_without_positions(rig_file):
    write_rig(rig_file, [replace(c, translation=np.zeros(3)) for c in (LEFT, RIGHT)], {})
    with raises(CaptureError, "camera-poses-missing"):
        arrange(rig_file, *VIDEOS, keep_world=True)


def test_names_are_checked_before_the_work(rig_file, tmp_path, monkeypatch):
    calibrate(rig_file, "left.mkv", name=("GoPro 1",))
    calibrate(rig_file, "right.mkv", name=("käse.2",))
    rig = read_rig(rig_file)
    assert [c.name for c in rig.cameras] == ["GoPro 1", "käse.2"]
    assert all(recorded_views.intrinsics_sigma(rig, c.name).any() for c in rig.cameras)
    monkeypatch.setattr(recorded_views, "find_boards", None)
    for name in ("gopro 1", "../left", str(tmp_path / "left"), "frames", "log", "session"):
        with pytest.raises(CaptureError):
            calibrate(rig_file, "left.mkv", name=(name,))
    with pytest.raises(CaptureError):
        calibrate_live("left", "gopro 1", BOARD, rig_file, 25, Screen(), None, fisheye=False)


@pytest.mark.parametrize("names", [("a",), ("a", "b", "c")])
def test_each_source_needs_a_name(rig_file, names):
    with raises(DeviceError, "camera-count-differs", count=len(names)):
        calibrate(rig_file, *VIDEOS, name=names)


@pytest.mark.parametrize("words", [["--name", "a", "b"], ["--name", "a", "--name", "b"]])
def test_names_follow_one_option_or_several(rig_file, capsys, words):
    files = ["--board", "board.json", "--calibration", str(rig_file), "--json"]
    assert run_command(["capture", "camera", "calibrate", *VIDEOS, *files, *words]) == 0
    assert [d["name"] for d in json.loads(capsys.readouterr().out)] == ["a", "b"]
    assert [c.name for c in read_rig(rig_file).cameras] == ["a", "b"]


def test_check_detects_moved_and_zoomed_cameras(rig_file):
    write_rig(rig_file, [LEFT, RIGHT], {})
    assert check(rig_file, *VIDEOS).is_valid
    write_rig(rig_file, [LEFT, MOVED_RIGHT], {})
    moved = check(rig_file, *VIDEOS)
    assert moved.diagnosis.cause.kind == "moved"
    assert max(moved.diagnosis.check.camera_errors) < 0.5
    zoomed = RIGHT.matrix * [[1.05], [1.05], [1]]
    zoomed[:2, 2] = RIGHT.matrix[:2, 2]
    write_rig(rig_file, [LEFT, replace(RIGHT, matrix=zoomed)], {})
    assert not check(rig_file, *VIDEOS).is_valid


def test_check_measures_the_squares_of_a_shrunk_print(rig_file, boards):
    write_rig(rig_file, [LEFT, RIGHT], {})
    stated = replace(BOARD, square=30 / 0.97, marker=21 / 0.97, measured=None)
    save_board(stated, boards / "stated.json")
    result = check(rig_file, *VIDEOS, board="stated.json")
    cause = result.diagnosis.cause
    assert (cause.kind, cause.order) == ("board", None)
    assert cause.square == pytest.approx(30.0, abs=0.05)
    assert result.stated_square == pytest.approx(30.93, abs=0.01)
    assert result.is_board_plausible
    other = replace(result, board=CharucoBoard(square=40.0, marker=28.0))
    assert not other.is_board_plausible


def test_check_finds_the_order_of_the_sources(rig_file):
    write_rig(rig_file, [LEFT, RIGHT], {})
    result = check(rig_file, *VIDEOS[::-1])
    assert result.diagnosis.cause.kind == "order"
    assert result.source_order == VIDEOS


@pytest.mark.parametrize(
    ("cameras", "sources"),
    [
        ([LEFT, RIGHT], VIDEOS),
        ([LEFT, RIGHT], VIDEOS[::-1]),
        ([LEFT, MOVED_RIGHT], VIDEOS),
        ([LEFT, replace(RIGHT, matrix=RIGHT.matrix * [[1.4], [1.4], [1]])], VIDEOS),
    ],
)
def test_check_prints_numbers_and_exits_with_its_answer(rig_file, capsys, cameras, sources):
    write_rig(rig_file, cameras, {})
    result = check(rig_file, *sources)
    words = ["capture", "camera", "check", *sources, "--board", "board.json"]
    code = run_command([*words, "--calibration", str(rig_file)])
    assert code == (0 if result.is_valid else 1)
    out = capsys.readouterr().out
    assert out.splitlines() == describe_check(result, "board.json")
    assert "nan" not in out


def test_names_of_inaccurate_cameras_are_reported(rig_file):
    write_rig(rig_file, [LEFT, replace(RIGHT, matrix=RIGHT.matrix * [[1.4], [1.4], [1]])], {})
    result = check(rig_file, *VIDEOS)
    assert result.diagnosis.cause.kind == "lens"
    assert result.inaccurate_cameras == ("right",)


def test_sizes_show_that_sources_are_swapped():
    sizes = [(480, 360), (640, 480)]
    cameras = [replace(LEFT, size=(640, 480)), RIGHT]
    with raises(CaptureError, "image-size-differs", size=(480, 360)):
        recorded_views.check_sizes(cameras, sizes, ["a.mkv", "b.mkv"])
    recorded_views.check_sizes(cameras, sizes[::-1], ["a.mkv", "b.mkv"])


def test_views_of_different_instants_are_reported(rig_file, boards):
    fourcc = cv2.VideoWriter.fourcc(*"FFV1")
    late = cv2.VideoWriter(str(boards / "late.mkv"), cv2.CAP_FFMPEG, fourcc, RATE_HZ, RIGHT.size)
    for image in images(boards / "right.mkv")[2:]:
        late.write(image)
    late.release()
    write_rig(rig_file, [LEFT, RIGHT], {})
    try:
        warnings = arrange(rig_file, "left.mkv", "late.mkv")["warnings"]
    except CaptureError:
        return
    assert warnings


def test_unusual_metadata_are_accepted(rig_file):
    write_rig(rig_file, [LEFT, RIGHT], {})
    lines = ['sigma_left = "no"', "sigma_right = [1, 2]", "day = 2026-01-01", "more = { a = 1 }"]
    rig_file.write_text(rig_file.read_text("utf-8") + "\n".join(lines) + "\n")
    arrange(rig_file, *VIDEOS)
    assert read_rig(rig_file).metadata["adjusted"] is True


def test_boards_that_are_not_visible_or_not_valid_are_rejected(rig_file, boards):
    with raises(CaptureError, "board-not-found", frames=2 * POSES):
        calibrate(rig_file, "left.mkv", board="other.json")
    text = (boards / "board.json").read_text("utf-8")
    (boards / "nan.json").write_text(re.sub(r'"square": [0-9.]+', '"square": NaN', text))
    with pytest.raises(CaptureError) as caught:
        calibrate(rig_file, "left.mkv", board="nan.json")
    assert caught.value.where.endswith("nan.json")
    assert not rig_file.exists()


def test_chessboard_without_tags_and_other_tags_are_named(tmp_path):
    squares = np.kron(np.indices((6, 8)).sum(axis=0) % 2, np.ones((40, 40))) * 255
    other = CharucoBoard(8, 6, 40.0, 28.0, "6X6_100").charuco.generateImage((320, 240))
    for name, board, reason in (
        ("squares", squares, "squares, but no tags"),
        ("other", other, "tags of 6X6_50"),
        ("nothing", np.full((240, 320), 255), ""),
    ):
        (tmp_path / name).mkdir()
        picture = cv2.copyMakeBorder(
            board.astype(np.uint8), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255
        )
        for k in range(3):
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), picture)
        with raises(CaptureError, "board-not-found", frames=3) as caught:
            find_boards([tmp_path / name], BOARD, None, silent)
        assert reason in caught.value.data["reason"]
        assert bool(reason) == bool(caught.value.data["reason"])


@pytest.mark.parametrize("command", ["calibrate", "arrange", "check"])
def test_images_of_different_sizes_are_refused(tmp_path, monkeypatch, boards, command):
    monkeypatch.chdir(tmp_path)
    write_rig(tmp_path / "cameras.toml", [LEFT, RIGHT], {})
    sources = ("left",) if command == "calibrate" else ("left", "right")
    for name in sources:
        (tmp_path / name).mkdir()
        for k, image in enumerate(images(boards / f"{name}.mkv")[:3]):
            picture = cv2.resize(image, (456, 342)) if name == sources[-1] and k == 2 else image
            cv2.imwrite(f"{name}/{k}.png", picture)
    words = [*sources, "--board", str(boards / "board.json"), "--calibration", "cameras.toml"]
    with raises(CaptureError, "image-sizes-differ", file="2.png", size=(456, 342)):
        run_command(["capture", "camera", command, *words])


def test_files_that_are_not_videos_are_rejected(rig_file, boards):
    (boards / "zero.mkv").write_bytes(b"")
    for name in ("none.mkv", "zero.mkv"):
        with pytest.raises(DefsenseError) as caught:
            calibrate(rig_file, name)
        assert name in caught.value.where


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["calibrate", "0", "left.mkv"], "sources-mixed"),
        (["calibrate", "left.mkv", "--rate", "nan"], "out-of-range"),
        (["calibrate", "0", "--views", "0"], "out-of-range"),
        (["calibrate", "left.mkv", "--calibration", "none/c.toml"], "folder-not-found"),
        (["arrange", "left.mkv"], "camera-count-invalid"),
    ],
)
def test_invalid_words_are_rejected(rig_file, words, code):
    with raises(DefsenseError, code):
        run_command(["capture", "camera", *words, "--board", "board.json"])


def test_sources_must_fit_the_calibration(rig_file):
    write_rig(rig_file, [LEFT, replace(RIGHT, size=(640, 480))], {})
    for command in (arrange, check):
        with raises(CaptureError, "image-size-differs"):
            command(rig_file, *VIDEOS)
    write_rig(rig_file, [LEFT], {})
    with raises(CaptureError, "camera-count-differs", cameras=1, count=2):
        check(rig_file, *VIDEOS)


class FilmedSource:
    """An `ImageSource` of the frames of a video."""

    def __init__(self, path, delay_ns=0, frames=None):
        self.name, self.frames = path.stem, frames or images(path)
        self.size = self.frames[0].shape[1::-1]
        self.delay_ns, self.position, self.state = delay_ns, 0, "new"

    def start(self):
        self.state = "open"

    def read(self, timeout):
        k = self.position
        if k >= len(self.frames):
            raise CaptureError("gives no more images", code="camera-disconnected")
        self.position += 1
        return self.frames[k], k * 100_000_000 + self.delay_ns

    def close(self):
        self.state = "closed"


class Screen:
    """Keeps the views that it is shown; presses a key after a number of them."""

    def __init__(self, count=None, key="enter"):
        self.views, self.count, self.name = [], count, key

    def show(self, view):
        self.views.append(view)

    def key(self, timeout):
        return self.name if self.count is not None and len(self.views) >= self.count else None


@pytest.fixture
def opener(boards):
    sources = []

    def make(delay_ns=0):
        def open_source(address):
            delay = delay_ns if address == "right" else 0
            sources.append(FilmedSource(boards / f"{address}.mkv", delay))
            return sources[-1]

        return open_source

    yield make
    assert all(source.state == "closed" for source in sources)


def test_live_calibration(opener, tmp_path):
    out, screen = tmp_path / "c.toml", Screen(27)
    calibrated = calibrate_live("left", "mine", BOARD, out, 25, screen, opener(), fisheye=False)
    assert np.abs(calibrated.intrinsics.camera.focal - LEFT.focal).max() < 3
    assert [c.name for c in read_rig(out).cameras] == ["mine"]
    progress = [view.progress for view in screen.views]
    assert progress == sorted(progress)
    assert 8 <= len(calibrated.views) <= POSES
    assert sum(view.alert for view in screen.views) == len(calibrated.views)
    assert not any(view.alert for view in screen.views[::2])  # the board still moves to a new pose


def test_live_arrangement_and_check(opener, tmp_path):
    out = tmp_path / "c.toml"
    moved = replace(RIGHT, rotation=LEFT.rotation, translation=LEFT.translation)
    write_rig(out, [LEFT, moved], {})
    screen = Screen(27)
    data = arrange_live(["left", "right"], BOARD, out, 30, screen, opener(10_000_000), keep=False)
    assert data["distances"][1] == pytest.approx(120, abs=0.2)
    assert all(len(view.parts) == 2 for view in screen.views)
    diagnosis = check_live(["left", "right"], BOARD, out, 3, Screen(), opener())
    assert diagnosis.check.holds
    assert diagnosis.check.boards == 3
    swapped = check_live(["right", "left"], BOARD, out, 3, Screen(), opener())
    assert swapped.cause.order == (1, 0)


def test_live_calibration_that_fails_or_is_stopped_writes_nothing(opener, tmp_path):
    out = tmp_path / "c.toml"
    with raises(CaptureError, "camera-disconnected"):
        calibrate_live("left", "mine", BOARD, out, 60, Screen(), opener(), fisheye=False)
    with pytest.raises(KeyboardInterrupt):
        calibrate_live("left", "mine", BOARD, out, 25, Screen(3, "q"), opener(), fisheye=False)
    assert not list(tmp_path.iterdir())


def test_live_cameras_must_be_simultaneous_and_of_their_size(opener, tmp_path):
    out = tmp_path / "c.toml"
    write_rig(out, [LEFT, RIGHT], {})
    with raises(CaptureError, "camera-disconnected"):  # their frames are never of one instant
        arrange_live(["left", "right"], BOARD, out, 5, Screen(), opener(50_000_000), keep=False)
    write_rig(out, [LEFT, replace(RIGHT, size=(640, 480))], {})
    with raises(CaptureError, "image-size-differs"):
        check_live(["left", "right"], BOARD, out, 3, Screen(), opener())


def test_live_view_names_a_chessboard_without_tags_until_the_board_is_seen(boards, tmp_path):
    squares = np.kron(np.indices((6, 8)).sum(axis=0) % 2, np.ones((40, 40))) * 255
    squares = cv2.copyMakeBorder(squares.astype(np.uint8), 20, 20, 60, 60, 0, value=255)
    found = images(boards / "left.mkv")[:3]
    squares = cv2.resize(cv2.cvtColor(squares, cv2.COLOR_GRAY2BGR), found[0].shape[1::-1])
    source, screen = FilmedSource(Path("left"), frames=[squares] * 33 + found), Screen()
    with raises(CaptureError, "camera-disconnected"):
        calibrate_live(
            "left", "mine", BOARD, tmp_path / "c.toml", 25, screen, lambda _: source, fisheye=False
        )
    reasons = [[note.data["reason"] for note in view.notes] for view in screen.views]
    assert not any(reasons[:30])
    assert ["they show squares, but no tags"] in reasons
    assert reasons[-1] == []
