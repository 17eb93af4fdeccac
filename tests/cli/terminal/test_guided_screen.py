"""Guided runs in low terminals: the instruction and the keys stay visible."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from defsense_fab.calibration.guided_measurement import MEASUREMENT_KEYS, draw_specimen
from defsense_fab.calibration.protocol import JigStep
from defsense_fab.calibration.readings import Geometry
from defsense_fab.cli.terminal.guided_screen import (
    GuidedLines,
    GuidedTerminal,
    fitting_page,
    pages,
)
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.guided_parts import (
    Bars,
    Curve,
    Picture,
    Plot,
    resistance_bars,
)
from defsense_fab.core.guided_run import GuidedView, Key, RunState
from defsense_fab.core.progress import Notice
from tests.support.errors import raises


def visible_rows(view, height):
    """Return the lines of a terminal 80 characters wide."""
    console = Console(file=io.StringIO(), width=80, height=height, color_system=None)
    page = fitting_page(console, pages(view, 80))
    return ["".join(s.text for s in row) for row in console.render_lines(page, pad=False)]


def recording_view(cameras=2, poses=4):
    """Return a view of a recording with all kinds of parts."""
    image = np.full((480, 640), 128, np.uint8)
    outlines = 100 + 40 * np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]])
    pictures = [
        Picture(f"cam_{k}", "1 tag", image, outlines, ("3",), np.array([True]))
        for k in range(cameras)
    ]
    noise = np.random.default_rng(0).normal(size=100)
    trace = Curve("a", np.linspace(-20, 0, 100), noise, 0, is_line=True)
    names = tuple(f"pose_{k}" for k in range(poses))
    return GuidedView(
        RunState("ready", 1, frozenset({0}), MEASUREMENT_KEYS["ready"]),
        title="step 2 of 2: bend, 20 s",
        instruction="Show **bend**.",
        status=("10 of 12 tags in several cameras",),
        progress=0.5,
        parts=(
            *pictures,
            Bars(np.array([[0.5], [0.0]]), ("a", "b"), ("+10.00%", "-"), has_colors=True),
            Plot("(R - R0)/R0", (trace,), (-20.0, 0.0), (-3.0, 3.0), 0.17),
            Bars(np.tile(np.arange(5) < 2, (poses, 1)), names, ("up to 40%",) * poses, "recorded"),
        ),
        notes=(Notice("frames-late", "12 frames were late", "cam_1"),),
    )


@pytest.mark.parametrize("height", [24, 30, 50])
def test_texts_stay_visible_and_pictures_shrink(height):
    rows = visible_rows(recording_view(), height)
    assert len(rows) <= height
    assert rows[-1].startswith("Enter ")
    text = "\n".join(rows)
    for part in ("step 2 of 2", "Show bend.", "10 of 12", "pose_3", "+10.00%", "were late"):
        assert part in text
    assert "▀" in text or height == 24


@pytest.mark.parametrize("height", [24, 40])
@pytest.mark.parametrize("phase", ["ready", "active", "waiting"])
def test_keys_of_the_phase_stay_visible(phase, height):
    ohm = {"bottom": 1500.0, "neutral": float("inf"), "top": 0.0}
    view = GuidedView(
        RunState(phase, 3, frozenset({0, 1}), MEASUREMENT_KEYS[phase]),
        title="2 of 40 readings",
        instruction="Place the specimen on **jig R75**.",
        parts=(
            draw_specimen(JigStep(0, 75.0, "a"), Geometry(), 150.0),
            resistance_bars(ohm),
        ),
    )
    rows = visible_rows(view, height)
    assert len(rows) <= height
    text = "\n".join(rows)
    for part in ("2 of 40 readings", "jig R75", "1500.0 ohm", "open", "short"):
        assert part in text
    for key in MEASUREMENT_KEYS[phase]:
        assert key.label in rows[-1]
    assert any("\u2801" <= c <= "\u28ff" for c in text)  # the drawing of the specimen


def test_window_of_a_few_rows_shows_the_keys():
    rows = visible_rows(recording_view(3, 8), 8)
    assert len(rows) <= 8
    assert rows[-1].startswith("Enter ")
    assert "step 2 of 2" in rows[0]


def test_bars_show_the_expected_range():
    bars = Bars(np.array([[0.25]]), ("a",), bands=np.array([[0.5, 0.75]]), states=("fault",))
    state = RunState("active", 0, frozenset(), ())
    (row,) = [r for r in visible_rows(GuidedView(state, "", "", parts=(bars,)), 24) if "█" in r]
    assert row.count("█") == row.count("▒") == 6  # a quarter of 24 characters each


@pytest.mark.parametrize("count", [1, 2])
def test_points_on_pictures(count):
    image = np.full((480, 640), 128, np.uint8)
    corners = np.array([[[100.0, 100]], [[200, 100]]])
    parts = [
        Picture(f"cam_{k}", "2 corners", image, corners, (), np.ones(2, bool)) for k in range(count)
    ]
    state = RunState("active", 7, frozenset(range(7)), (Key("enter", "finish", "complete"),))
    view = GuidedView(
        state, "7 of 20 views", "Tilt the board.", parts=(*parts, Bars(np.ones((4, 6))))
    )
    rows = visible_rows(view, 24)
    assert len(rows) <= 24
    assert rows[-1].startswith("Enter finish")
    assert "7 of 20 views" in "\n".join(rows)


def test_lines_without_a_terminal(capsys):
    """There is one line per step and one per note; lines are repeated in a long step."""
    view = recording_view()
    lines = GuidedLines(interval_s=3600)
    lines.show(view)
    lines.show(replace(view, title="step 2 of 2: bend, 19 s"))
    first = capsys.readouterr().err.splitlines()
    assert first == ["step 2 of 2: bend, 20 s; Show bend.", f"note: {view.notes[0]}"]
    often = GuidedLines(interval_s=0.0)
    often.show(view)
    often.show(replace(view, title="step 2 of 2: bend, 7 s"))
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("step 2 of 2: bend, 7 s; 10 of 12 tags in several cameras")


def test_full_screen_needs_a_terminal():
    with raises(DeviceError, "terminal-missing"):
        GuidedTerminal().__enter__()
