"""A guided run on the pages of a server: texts, keys, bars, plots and pictures."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from defsense_fab.core.guided_parts import Bars, Curve, Picture, Plot
from defsense_fab.core.guided_run import STOP, GuidedView, Key, RunState
from defsense_fab.core.progress import Notice
from defsense_fab.runtime.view.guided_screen import (
    PICTURE_WIDTH,
    GuidedScreen,
    guided_state,
    picture_jpeg,
)
from defsense_fab.runtime.view.live_messages import GuidedState, PressKey

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


class Pages:
    """Keeps what is published."""

    def __init__(self):
        self.states, self.pictures = [], {}

    def publish(self, event):
        assert isinstance(event, GuidedState)
        self.states.append(event)

    def publish_arrays(self, arrays):
        self.pictures[arrays.name] = arrays.arrays["jpeg"]


@pytest.fixture
def pages():
    return Pages()


@pytest.fixture
def screen(pages):
    screen = GuidedScreen(pages, "Recording")
    screen.text_interval_s = screen.picture_interval_s = 0.0
    return screen


def press(screen, key, step, phase):
    screen.handle_key(None, PressKey(id=1, key=key, step=step, phase=phase))


def test_state_and_keys_of_the_phase_are_shown(screen, pages):
    assert pages.states[-1].run == "Recording"
    screen.show(VIEW)
    state = pages.states[-1]
    assert (state.phase, state.step, state.done) == ("ready", 1, [0])
    assert [(k.name, k.label) for k in state.keys] == [("enter", "start"), ("q", "stop")]
    assert (state.instruction, state.status) == (VIEW.instruction, list(VIEW.status))
    assert state.notes == [str(VIEW.notes[0])]
    screen.close()
    assert pages.states[-1].run == ""


def test_keys_of_another_step_or_phase_are_ignored(screen):
    screen.show(VIEW)
    press(screen, "enter", 0, "ready")
    press(screen, "enter", 1, "active")
    assert screen.key(0.0) is None
    press(screen, "enter", 1, "ready")
    assert screen.key(TIMEOUT_S) == "enter"


def test_updates_are_limited_but_the_end_is_shown(screen, pages):
    screen.show(VIEW)
    screen.text_interval_s = TIMEOUT_S
    screen.show(replace(VIEW, title="later"))
    assert screen.view is VIEW
    end = replace(VIEW, state=replace(VIEW.state, phase="done", keys=()))
    screen.show(end)
    assert screen.view is end
    assert pages.states[-1].phase == "done"


def test_an_equal_state_is_sent_once(screen, pages):
    for _ in range(3):
        screen.show(VIEW)
    assert len(pages.states) == 2  # with the first one


def test_alerts_are_counted_even_between_updates(screen, pages):
    active = replace(VIEW, state=replace(VIEW.state, phase="active"))
    screen.show(active)
    screen.text_interval_s = TIMEOUT_S
    screen.show(replace(active, alert=True))
    screen.show(VIEW)  # the step is complete
    screen.text_interval_s = 0.0
    screen.show(VIEW)
    assert pages.states[-1].alerts == 2


def test_bars_have_their_state_and_the_expected_range():
    bars = Bars(np.array([[0.5], [1.9]]), bands=np.array([[0.4, 0.6]] * 2), states=("ok", "fault"))
    (part,) = guided_state("", replace(VIEW, parts=(bars,))).parts
    assert part.values == [[0.5], [1.0]]
    assert part.bands == [[0.4, 0.6]] * 2
    assert part.states == ["ok", "fault"]
    (part,) = guided_state("", replace(VIEW, parts=(COVERAGE,))).parts
    assert part.values == [[0, 1, 0, 0, 0]]
    assert (part.names, part.texts, part.bands, part.colors) == (["bend<b>"], ["up to 40%"], [], [])


def test_plots_have_valid_points_only():
    plot = guided_state("", VIEW).parts[3]
    assert (plot.curves[0].x, plot.curves[0].y) == ([-2, 0], [0, 0.5])
    assert [c.is_line for c in plot.curves] == [True, False]
    assert (plot.x, plot.y, plot.aspect) == ([-2, 0], [-1, 1], 0.5)


def test_pictures_are_sent_as_jpeg(screen, pages):
    screen.show(VIEW)
    parts = pages.states[-1].parts
    assert [p.has_image for p in parts[:2]] == [True, False]
    assert set(pages.pictures) == {parts[0].array}
    image = cv2.imdecode(pages.pictures[parts[0].array], cv2.IMREAD_COLOR)
    assert image.shape == (48, 64, 3)
    assert image.max() > 100  # the outlines


def test_large_pictures_are_reduced():
    large = replace(PICTURES[0], image=np.zeros((960, 1280, 3), np.uint8))
    image = cv2.imdecode(picture_jpeg(large), cv2.IMREAD_COLOR)
    assert image.shape == (PICTURE_WIDTH * 3 // 4, PICTURE_WIDTH, 3)


def test_a_state_can_be_sent_without_keys(screen, pages):
    state = replace(VIEW.state, keys=(Key("r", "", "repeat"),))
    screen.show(replace(VIEW, state=state))
    assert pages.states[-1].keys[0].label == ""
