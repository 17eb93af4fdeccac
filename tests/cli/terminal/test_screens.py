"""Displays on low terminals: the instruction and the keys stay visible."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from defsense_fab.calibration.guided_measurement import MeasurementView
from defsense_fab.calibration.protocol import JigStep
from defsense_fab.capture.sessions.guided_recording import CameraView, CaptureView
from defsense_fab.cli.terminal import camera_calibration, guided_recording
from defsense_fab.cli.terminal.guided_measurement import MeasurementTerminal
from defsense_fab.cli.terminal.screen import fitting
from defsense_fab.core.storage.session_manifest import Criterion
from defsense_fab.workflow.cameras.live_views import BoardShown


def shown(pages, height):
    """Return the lines of a terminal 80 characters wide."""
    console = Console(file=io.StringIO(), width=80, height=height, color_system=None)
    page = fitting(console, pages)
    return ["".join(s.text for s in row) for row in console.render_lines(page, pad=False)]


def capture(cameras=2, poses=4):
    image = np.full((480, 640), 128, np.uint8)
    outlines = 100 + 40 * np.array([[[0, 0], [1, 0], [1, 1], [0, 1]]])
    of = tuple(
        CameraView(f"cam_{k}", image, outlines, (3,), np.array([True]), 30.0, 0)
        for k in range(cameras)
    )
    reached = {f"pose_{k}": (0.4, np.arange(5) < 2) for k in range(poses)}
    rng = np.random.default_rng(0)
    return CaptureView(
        "ready", 1, (("rest", 5.0), ("bend", 20.0)), 20.0, of, ("a", "b", "c", "d"),
        np.array([0.1, -0.05, 0.02, np.nan]), 1000 + rng.normal(size=(100, 4)), reached, 10, 2, 12,
        0.2, 100, 60, ("camera cam_1: 12 frames late or lost",), "Show bend.",
    )  # fmt: skip


def measurement(phase):
    return MeasurementView(
        phase, JigStep(0, 75.0, "a"), 3, 40, 2, 4.0, None, np.array([1500.0, 1400, 1600]), (), (),
        1234,
    )  # fmt: skip


@pytest.mark.parametrize("height", [24, 30, 50])
def test_recording(height):
    rows = shown(guided_recording.pages(capture(), 80), height)
    assert len(rows) <= height
    assert rows[-1].startswith("Enter ")
    text = "\n".join(rows)
    for there in ("step 2 of 2", "Show bend.", "10 of 12", "pose_3", "+10.00%", "late or lost"):
        assert there in text
    assert ("▀" in text or "▄" in text) or height == 24  # pictures


@pytest.mark.parametrize("height", [24, 40])
@pytest.mark.parametrize("phase", ["place", "settling", "unplugged"])
def test_measurement(phase, height):
    terminal = MeasurementTerminal(Criterion(), 15.0, 150.0)
    rows = shown(terminal.pages(measurement(phase)), height)
    assert len(rows) <= height
    assert "q stop" in rows[-1]
    text = "\n".join(rows)
    assert ("R75" in text) == (phase != "unplugged")
    for there in ("2 of 40 readings", "1500.0 ohm", "1600.0 ohm"):
        assert there in text


def test_window_of_a_few_rows_shows_the_keys():
    rows = shown(guided_recording.pages(capture(3, 8), 80), 8)
    assert len(rows) <= 8
    assert rows[-1].startswith("Enter ")
    assert "step 2 of 2" in rows[0]


@pytest.mark.parametrize("count", [1, 2])
def test_calibration_of_cameras(count):
    image = np.full((480, 640), 128, np.uint8)
    corners = tuple(np.array([[100.0, 100], [200, 100]]) for _ in range(count))
    names = tuple(f"cam_{k}" for k in range(count))
    cells = np.ones((5, 8), int) if count == 1 else None
    board = BoardShown(names, (image,) * count, corners, cells, 7, 20, ("tilt the board",))
    rows = shown(camera_calibration.pages(board, 80), 24)
    assert len(rows) <= 24
    assert rows[-1].startswith("Enter finish")
    assert "7 of 20 views" in "\n".join(rows)


def test_lines_of_a_recording_without_a_terminal(capsys):
    """One line per step, repeated at intervals in a long step."""
    lines = guided_recording.CaptureLines(interval=3600)
    view = replace(capture(), phase="showing")
    lines.show(view)
    lines.show(replace(view, left=19.0))
    first = capsys.readouterr().err.splitlines()
    assert [line.split(";")[0] for line in first] == [
        "step 2/2: bend, 20 s", "note: camera cam_1: 12 frames late or lost",
    ]  # fmt: skip
    often = guided_recording.CaptureLines(interval=0.0)
    often.show(view)
    often.show(replace(view, left=7.0, samples=900))
    later = capsys.readouterr().err.splitlines()[-1]
    assert later.startswith("step 2/2: bend, 7 s left; 10 of 12 tags by several cameras; 900 samp")
    assert "pose_0 40%" in later
