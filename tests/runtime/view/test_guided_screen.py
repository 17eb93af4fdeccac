"""A guided run on the page: texts, buttons, bars, plots and pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.guided_parts import Bars, Curve, Picture, Plot
from defsense_fab.core.guided_run import STOP, GuidedView, Key, RunState
from defsense_fab.core.progress import Notice
from defsense_fab.runtime.view.guided_screen import (
    BAND_COLOR,
    HIGHLIGHT_RGB,
    PICTURE_WIDTH,
    STATE_COLORS,
    GuidedScreen,
    part_html,
    small_picture,
    view_text,
)
from defsense_fab.runtime.view.page_server import close_page, serve_page
from tests.runtime.view.test_page_server import free_port

TIMEOUT_S = 600.0
OUTLINE = np.array([[[2.0, 2], [20, 2], [20, 20], [2, 20]]])
PICTURES = (
    Picture("cam_0", "1 tag", np.zeros((48, 64, 3), np.uint8), OUTLINE, ("7",), np.ones(1, bool)),
    Picture("cam_1", "no picture", None, np.zeros((0, 4, 2)), (), np.zeros(0, bool)),
)
COVERAGE = Bars(np.array([[0.0, 1, 0, 0, 0]]), ("bend<b>",), ("up to 40%",), "Recorded")
CURVES = (
    Curve("a", np.array([-2.0, -1, 0]), np.array([0.0, np.nan, 0.5]), 0, is_line=True),
    Curve("b<i>", np.array([-1.0]), np.array([0.1]), 1),
)
PLOT = Plot("(R - R0)/R0", CURVES, (-2.0, 0.0), (-1.0, 1.0), 0.5)
VIEW = GuidedView(
    RunState("ready", 1, frozenset({0}), (Key("enter", "start", "start"), STOP)),
    title="step 2 of 2: bend",
    instruction="Show **bend**.",
    status=("120 samples",),
    parts=(*PICTURES, Bars(np.array([[0.05]]), ("a",), ("+1.00%",)), PLOT, COVERAGE),
    notes=(Notice("camera-disconnected", "Camera cam_1 is disconnected.", "cam_1"),),
)


@pytest.fixture(scope="module")
def page():
    pytest.importorskip("viser")
    server = serve_page(free_port(), "test")
    yield server
    close_page(server)


def test_state_and_keys_of_the_phase_are_shown(page):
    folder = page.gui.add_folder("test")
    screen = GuidedScreen(page, folder, "Recording")
    screen.text_interval_s = screen.picture_interval_s = 0.0
    screen.show(VIEW)
    assert screen.view is VIEW
    assert set(screen.pictures) == {"cam_0", "cam_1"}
    active = replace(VIEW.state, phase="active", keys=(Key("r", "repeat", "repeat"), STOP))
    screen.show(replace(VIEW, state=active))
    assert screen.view.state is active
    screen.press("r")
    assert screen.key(TIMEOUT_S) == "r"
    screen.close()
    folder.remove()


def test_updates_are_limited_but_the_end_is_shown(page):
    folder = page.gui.add_folder("test")
    screen = GuidedScreen(page, folder, "Recording")
    screen.text_interval_s = TIMEOUT_S
    screen.show(VIEW)
    screen.show(replace(VIEW, title="later"))
    assert screen.view is VIEW
    end = replace(VIEW, state=replace(VIEW.state, phase="done", keys=()))
    screen.show(end)
    assert screen.view is end
    screen.close()
    folder.remove()


def test_text_has_the_step_the_instruction_and_the_notes():
    text = view_text(VIEW)
    for part in (VIEW.title, VIEW.instruction, VIEW.status[0], f"- **{VIEW.notes[0]}**"):
        assert part in text


def test_bars_show_their_state_and_the_expected_range():
    bars = Bars(np.array([[0.5], [0.9]]), bands=np.array([[0.4, 0.6]] * 2), states=("ok", "fault"))
    text = part_html(bars)
    assert text.count(BAND_COLOR) == 2
    assert STATE_COLORS["ok"] in text
    assert STATE_COLORS["fault"] in text
    assert "left:40.0%;width:20.0%" in text


def test_bars_show_the_filled_parts():
    page = part_html(COVERAGE)
    assert "bend&lt;b&gt;" in page
    assert (page.count("width:100%"), page.count("width:0%")) == (1, 4)
    assert COVERAGE.texts[0] in page


def test_plot_has_valid_points_and_a_legend():
    page = part_html(PLOT)
    assert 'points="0.0,65.0 260.0,32.5"' in page
    assert page.count("<circle") == 1
    assert "b&lt;i&gt;" in page
    assert "nan" not in page


def test_bar_shows_its_value():
    page = part_html(VIEW.parts[2])
    assert "+1.00%" in page
    assert "width:5%" in page


def test_pictures_are_small_and_have_outlines():
    picture = small_picture(PICTURES[0])
    assert picture.shape == (240, PICTURE_WIDTH, 3)
    assert (picture.reshape(-1, 3) == HIGHLIGHT_RGB).all(axis=1).any()
    assert small_picture(PICTURES[1]).shape == (180, PICTURE_WIDTH, 3)
