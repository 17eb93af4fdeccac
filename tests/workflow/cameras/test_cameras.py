"""Cameras calibrated, arranged and checked, from films of a board and from live pictures."""

import argparse
import json
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rich.live import Live

from defsense_fab.capture.cameras.rig_file import read_rig, write_rig
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, save_board
from defsense_fab.cli.capture import capture_cameras
from defsense_fab.cli.terminal.camera_calibration import BoardTerminal
from defsense_fab.core.errors import CaptureError, DeviceError
from defsense_fab.core.progress import silent
from defsense_fab.workflow.cameras import recorded_views
from defsense_fab.workflow.cameras.live_views import arrange_live, calibrate_live, check_live
from tests.support.errors import raises
from tests.support.films import BOARD, LEFT, RIGHT, board_scene, command, images, parse_json, take
from tests.twin.film import Shutter

POSES, RATE = 14, 10.0


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Two cameras that see a board, still for two frames in each place."""
    folder = tmp_path_factory.mktemp("boards")
    for name, camera in (("left", LEFT), ("right", RIGHT)):
        take(
            folder / f"{name}.mkv", camera, lambda t: board_scene(int(RATE * t + 0.5) // 2),
            2 * POSES / RATE, Shutter(RATE),
        )  # fmt: skip
    save_board(BOARD, folder / "board.json")
    save_board(CharucoBoard(9, 6), folder / "other.json")
    return folder


@pytest.fixture(scope="module")
def looked():
    """`look`, which finds a board in the same video once: that takes the most time."""
    known, original = {}, recorded_views.find_boards

    def look(paths, board, rate=None, progress=silent):
        for path in paths:
            if (path, board, rate) not in known:
                known[path, board, rate] = original([path], board, rate, progress)[0]
        return [known[path, board, rate] for path in paths]

    return look


@pytest.fixture
def camera(boards, looked, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(boards)
    monkeypatch.setattr(recorded_views, "find_boards", looked)

    def run(what, *sources, board="board.json", out=None, more=()):
        before = {p: p.read_bytes() for p in tmp_path.iterdir()}
        code, said, errors = command(
            capsys, "capture", "camera", what, *sources, "--board", board, "--calibration",
            out or tmp_path / "cameras.toml", "--json", *more,
        )  # fmt: skip
        if code == 2:
            assert (len(errors), said) == (1, "")
            assert before == {p: p.read_bytes() for p in tmp_path.iterdir()}
            return errors[0]
        assert not errors
        return parse_json(said)

    return run


def test_calibrated_and_arranged_like_the_true_ones(camera, tmp_path):
    data = camera("calibrate", "left.mkv", "right.mkv")
    assert [d["name"] for d in data] == ["left", "right"]
    for d, true in zip(data, (LEFT, RIGHT), strict=True):
        assert d["error"] < 0.1
        assert np.abs(np.array(d["focal"]) - true.focal).max() < 2
    assert not read_rig(tmp_path / "cameras.toml").placed
    assert "<svg" in (tmp_path / "cameras.html").read_text("utf-8")
    data = camera("arrange", "left.mkv", "right.mkv")
    assert data["distances"] == pytest.approx([0, 120], abs=0.3)
    assert data["warnings"] == []
    found = read_rig(tmp_path / "cameras.toml")
    assert found.placed
    true = RIGHT.rotation @ LEFT.rotation.T
    turned = found.cameras[1].rotation @ true.T
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 0.3
    checked = camera("check", "left.mkv", "right.mkv")
    assert checked["holds"]
    # One that is calibrated anew does not stand where it stood: nor does the other to it.
    camera("calibrate", "left.mkv")
    again = read_rig(tmp_path / "cameras.toml")
    assert [c.name for c in again.cameras] == ["left", "right"]
    assert not again.placed


def test_the_world_of_a_file_is_kept_on_request(camera, tmp_path):
    out = tmp_path / "cameras.toml"
    shifted = replace(RIGHT, translation=RIGHT.translation + np.array([4.0, 0, 0]))
    write_rig(out, [LEFT, shifted], {})
    data = camera("arrange", "left.mkv", "right.mkv", more=["--keep-world"])
    assert data["frame"] == f"the world of {out}"
    left, right = read_rig(out).cameras
    assert np.allclose(left.center, LEFT.center, atol=1e-6)
    assert np.allclose(left.rotation, LEFT.rotation, atol=1e-9)
    assert np.linalg.norm(right.center - RIGHT.center) < 0.5
    data = camera("arrange", "left.mkv", "right.mkv")
    assert data["frame"] == "of camera left"
    assert np.allclose(read_rig(out).cameras[0].center, 0)
    write_rig(out, [replace(c, translation=np.zeros(3)) for c in (LEFT, RIGHT)], {})
    assert "no world" in camera("arrange", "left.mkv", "right.mkv", more=["--keep-world"])


def test_names_of_cameras_are_checked_before_the_work(camera, tmp_path, monkeypatch):
    camera("calibrate", "left.mkv", more=["--name", "GoPro 1"])
    camera("calibrate", "right.mkv", more=["--name", "käse.2"])
    out = tmp_path / "cameras.toml"
    rig = read_rig(out)
    assert [c.name for c in rig.cameras] == ["GoPro 1", "käse.2"]
    assert all(recorded_views.intrinsics_sigma(rig, c.name).any() for c in rig.cameras)
    monkeypatch.setattr(recorded_views, "find_boards", None)
    assert "same files" in camera("calibrate", "left.mkv", more=["--name", "gopro 1"])
    for name in ("../left", str(tmp_path / "left"), "frames", "log", "session"):
        assert repr(name) in camera("calibrate", "left.mkv", more=["--name", name])
    with pytest.raises(CaptureError):
        calibrate_live("left", "gopro 1", BOARD, out, 25, Screen(), None)


def test_names_after_one_option_or_several(camera, tmp_path):
    sources = ["left.mkv", "right.mkv"]
    assert [d["name"] for d in camera("calibrate", *sources, more=["--name", "a", "b"])] == [
        "a", "b",
    ]  # fmt: skip
    out = tmp_path / "other.toml"
    again = camera("calibrate", *sources, out=out, more=["--name", "a", "--name", "b"])
    assert [c.name for c in read_rig(out).cameras] == [d["name"] for d in again] == ["a", "b"]
    for names in (["a"], ["a", "b", "c"]):
        error = camera("calibrate", *sources, more=["--name", *names])
        assert "--name" in error
        assert all(source in error for source in sources)


def test_a_check_finds_what_moved(camera, tmp_path):
    out = tmp_path / "cameras.toml"
    write_rig(out, [LEFT, RIGHT], {})
    assert camera("check", "left.mkv", "right.mkv")["holds"]
    write_rig(out, [LEFT, replace(RIGHT, translation=RIGHT.translation + np.array([0, 2, 0]))], {})
    moved = camera("check", "left.mkv", "right.mkv")
    assert not moved["holds"]
    assert max(moved["own"]) < 0.5
    zoomed = RIGHT.matrix * [[1.05], [1.05], [1]]
    zoomed[:2, 2] = RIGHT.matrix[:2, 2]
    write_rig(out, [LEFT, replace(RIGHT, matrix=zoomed)], {})
    assert not camera("check", "left.mkv", "right.mkv")["holds"]


def test_a_check_explains_what_is_wrong(camera, boards, tmp_path, capsys):
    out = tmp_path / "cameras.toml"
    write_rig(out, [LEFT, RIGHT], {})
    # What is stated of a board that a printer fitted to the page.
    save_board(
        replace(BOARD, square=30 / 0.97, marker=21 / 0.97, measured=None), boards / "stated.json"
    )
    data = camera("check", "left.mkv", "right.mkv", board="stated.json")
    assert (data["holds"], data["cause"], data["order"]) == (False, "board", None)
    assert data["square"] == pytest.approx(30.0, abs=0.05)
    words = said(capsys, out, "left.mkv", "right.mkv", board="stated.json")
    for part in (f"{data['square']:.2f} mm", "30.93 mm", "capture board stated.json --measured MM"):
        assert part in words
    more = capture_cameras._describe_size(argparse.Namespace(board="b"), CharucoBoard(), 27.0)
    assert "capture board b --printed --square MM" in more
    data = camera("check", "right.mkv", "left.mkv")
    assert (data["holds"], data["cause"]) == (False, "order")
    assert data["order"] == ["left.mkv", "right.mkv"]
    words = said(capsys, out, "right.mkv", "left.mkv")
    assert "left.mkv right.mkv" in words
    write_rig(out, [LEFT, replace(RIGHT, translation=RIGHT.translation + np.array([0, 2, 0]))], {})
    assert "a camera has been moved" in said(capsys, out, "left.mkv", "right.mkv")
    write_rig(out, [LEFT, replace(RIGHT, matrix=RIGHT.matrix * [[1.4], [1.4], [1]])], {})
    assert "zoom, focus or resolution of right" in said(capsys, out, "left.mkv", "right.mkv")
    write_rig(out, [replace(LEFT, size=(640, 480)), replace(RIGHT, size=(480, 360))], {})
    assert "another order" not in camera("check", "left.mkv", "right.mkv")


def said(capsys, out, *sources, board="board.json"):
    """What a check of cameras that do not hold prints; never a number that is none."""
    code, words, _ = command(
        capsys, "capture", "camera", "check", *sources, "--board", board, "--calibration", out
    )
    assert code == 1
    assert "nan" not in words
    return words


def test_sizes_show_that_sources_are_swapped():
    sizes = [(480, 360), (640, 480)]
    cameras = [replace(LEFT, size=(640, 480)), RIGHT]
    with raises(CaptureError, "image-size-differs", size=(480, 360)):
        recorded_views.check_sizes(cameras, sizes, ["a.mkv", "b.mkv"])
    recorded_views.check_sizes(cameras, sizes[::-1], ["a.mkv", "b.mkv"])


def test_views_of_different_instants_are_reported(camera, boards, tmp_path):
    fourcc = cv2.VideoWriter.fourcc(*"FFV1")
    late = cv2.VideoWriter(str(boards / "other.mkv"), cv2.CAP_FFMPEG, fourcc, RATE, RIGHT.size)
    for image in images(boards / "right.mkv")[2:]:
        late.write(image)
    late.release()
    write_rig(tmp_path / "cameras.toml", [LEFT, RIGHT], {})
    said = camera("arrange", "left.mkv", "other.mkv")
    assert "same time" in (said if isinstance(said, str) else said["warnings"][0])


def test_unusual_metadata_are_accepted(camera, tmp_path):
    out = tmp_path / "cameras.toml"
    write_rig(out, [LEFT, RIGHT], {})
    lines = ['sigma_left = "no"', "sigma_right = [1, 2]", "day = 2026-01-01", "more = { a = 1 }"]
    out.write_text(out.read_text("utf-8") + "\n".join(lines) + "\n")
    camera("arrange", "left.mkv", "right.mkv")
    assert read_rig(out).metadata["adjusted"] is True


def test_invalid_input_is_refused(camera, boards, tmp_path):
    assert "28 frames" in camera("calibrate", "left.mkv", board="other.json")
    shutil.copy(boards / "board.json", boards / "nan.json")
    text = (boards / "board.json").read_text("utf-8")
    (boards / "nan.json").write_text(re.sub(r'"square": [0-9.]+', '"square": NaN', text))
    assert "nan.json" in camera("calibrate", "left.mkv", board="nan.json")
    assert "none.mkv" in camera("calibrate", "none.mkv")
    (boards / "zero.mkv").write_bytes(b"")
    assert "zero.mkv" in camera("calibrate", "zero.mkv")
    assert camera("calibrate", "0", "left.mkv").startswith("error: ")
    assert "left" in camera("calibrate", "left.mkv", "right.mkv", more=["--name", "left"] * 2)
    assert "--rate" in camera("calibrate", "left.mkv", more=["--rate", "nan"])
    assert "--views" in camera("calibrate", "0", more=["--views", "0"])
    assert str(tmp_path / "none") in camera(
        "calibrate", "left.mkv", out=tmp_path / "none" / "c.toml"
    )
    assert camera("arrange", "left.mkv").startswith("error: ")
    assert "defsense capture camera calibrate" in camera("arrange", "left.mkv", "right.mkv")
    write_rig(tmp_path / "cameras.toml", [LEFT, replace(RIGHT, size=(640, 480))], {})
    assert "640 x 480" in camera("arrange", "left.mkv", "right.mkv")
    assert "640 x 480" in camera("check", "left.mkv", "right.mkv")
    write_rig(tmp_path / "cameras.toml", [LEFT], {})
    assert "(left)" in camera("check", "left.mkv", "right.mkv")


class Fake:
    """`Images` of frames that were filmed, each shown `again` times; ends as told."""

    def __init__(self, path, again=1, late_ns=0):
        self.name, self.frames = path.stem, images(path)
        self.size = self.frames[0].shape[1::-1]
        self.again, self.late, self.k, self.state = again, late_ns, 0, "new"

    def start(self):
        self.state = "open"

    def read(self, timeout):
        k = self.k // self.again
        if k >= len(self.frames):
            raise CaptureError("gives no more images", code="camera-disconnected")
        self.k += 1
        return self.frames[k], self.k * 100_000_000 + self.late

    def close(self):
        self.state = "closed"


class Screen:
    """Keeps what it is shown; presses a key after so many pictures."""

    def __init__(self, after=None, key="enter"):
        self.shown, self.after, self.pressed = [], after, key

    def show(self, shown):
        self.shown.append(shown)

    def key(self, timeout):
        return self.pressed if self.after is not None and len(self.shown) >= self.after else None


@pytest.fixture
def opener(boards):
    opened = []

    def make(late_ns=0):
        def opens(source):
            late = late_ns if source == "right" else 0
            opened.append(Fake(boards / f"{source}.mkv", late_ns=late))
            return opened[-1]

        return opens

    yield make
    assert all(f.state == "closed" for f in opened)


def test_live_calibration(opener, tmp_path):
    out, screen = tmp_path / "c.toml", Screen(27)
    (done,) = calibrate_live("left", "mine", BOARD, out, 25, screen, opener())
    assert np.abs(done.intrinsics.camera.focal - LEFT.focal).max() < 3
    assert [c.name for c in read_rig(out).cameras] == ["mine"]
    taken = [s.taken for s in screen.shown]
    assert taken == sorted(taken)
    assert 8 <= taken[-1] <= POSES
    assert sum(s.flash for s in screen.shown) == taken[-1]
    assert not any(s.flash for s in screen.shown[::2])  # in a new place it is not still yet


def test_live_arrangement_and_check(opener, tmp_path):
    out = tmp_path / "c.toml"
    apart = replace(RIGHT, rotation=LEFT.rotation, translation=LEFT.translation)
    write_rig(out, [LEFT, apart], {})
    screen = Screen(27)
    data = arrange_live(["left", "right"], BOARD, out, 30, screen, opener(10_000_000))
    assert data["distances"][1] == pytest.approx(120, abs=0.2)
    assert all(len(s.images) == 2 for s in screen.shown)
    found = check_live(["left", "right"], BOARD, out, 3, Screen(), opener())
    assert found.check.holds
    assert found.check.boards == 3
    swapped = check_live(["right", "left"], BOARD, out, 3, Screen(), opener())
    assert swapped.cause.order == (1, 0)


def test_live_cameras_that_fail(opener, tmp_path):
    out = tmp_path / "c.toml"
    with raises(CaptureError, "camera-disconnected"):
        calibrate_live("left", "mine", BOARD, out, 60, Screen(), opener())
    with pytest.raises(KeyboardInterrupt):
        calibrate_live("left", "mine", BOARD, out, 25, Screen(3, "q"), opener())
    assert not list(tmp_path.iterdir())
    write_rig(out, [LEFT, RIGHT], {})
    before = out.read_bytes()
    with raises(CaptureError, "camera-disconnected"):  # their frames are never of one instant
        arrange_live(["left", "right"], BOARD, out, 5, Screen(), opener(50_000_000))
    write_rig(out, [LEFT, replace(RIGHT, size=(640, 480))], {})
    with raises(CaptureError, "image-size-differs"):
        check_live(["left", "right"], BOARD, out, 3, Screen(), opener())
    assert before != out.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.toml"]


def test_the_screen_shows_all(opener, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    seen = Screen(9)
    out = tmp_path / "c.toml"
    write_rig(out, [LEFT, RIGHT], {})
    check_live(["left", "right"], BOARD, out, 2, seen, opener())
    with pytest.raises(DeviceError):
        BoardTerminal().__enter__()
    screen = BoardTerminal()
    with Live(console=screen._console, auto_refresh=False) as screen._live:
        for shown in seen.shown:
            screen.show(shown)
    said = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", capsys.readouterr().out)
    assert "2 views" in said
    assert "corners" in said
    assert json.dumps("hold the board still")[1:-1] in said
