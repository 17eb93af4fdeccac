"""The order of the steps of a guided run, and what its keys do."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.guided_parts import Picture, draw_picture, resistance_bars
from defsense_fab.core.guided_run import STOP, GuidedRun, GuidedView, GuidedWork, Key

KEYS = {
    "ready": (
        Key("enter", "start", "start"),
        Key("b", "back", "back"),
        Key("s", "skip", "skip"),
        STOP,
    ),
    "active": (
        Key("r", "repeat", "repeat"),
        Key("t", "take", "complete"),
        Key("b", "wait", "back"),
        Key("s", "skip", "skip"),
        STOP,
    ),
    "waiting": (STOP,),
}


class CountingWork(GuidedWork):
    """Work whose steps end after two calls of `receive`; it records what happens."""

    def __init__(self, step_count, *, duration=2, interrupted_at=()):
        self.keys, self.step_count, self.events = KEYS, step_count, []
        self._duration, self._interrupted_at = duration, interrupted_at
        self._count = self._age = 0

    def start(self, step):
        self._age = 0
        self.events.append(("start", step))

    def receive(self):
        self._count += 1
        self._age += 1
        self.is_interrupted = self._count in self._interrupted_at

    def check(self, *, is_requested):
        if is_requested and self._age == 1:
            return "finish"
        return "done" if is_requested or self._age >= self._duration else None

    def leave(self, step, ending):
        self.events.append((ending, step))

    def skip(self, step):
        self.events.append(("skipped", step))

    def reopen(self, step):
        self.events.append(("reopen", step))

    def view(self, state):
        return GuidedView(state, "title", "instruction")


class ScriptedScreen:
    """A screen that presses the given keys, one after each view, and then none."""

    def __init__(self, *keys):
        self.keys, self.states = list(keys), []

    def show(self, view):
        self.states.append(view.state)

    def key(self, timeout):
        return self.keys.pop(0) if self.keys else None


def test_automatic_run_does_all_steps_that_are_not_done():
    work, screen = CountingWork(4), ScriptedScreen()
    run = GuidedRun(work, screen, done=[1], auto=True)
    assert run.run()
    assert run.done == {0, 1, 2, 3}
    assert [step for event, step in work.events if event == "start"] == [0, 2, 3]
    assert screen.states[-1].phase == "done"
    assert {state.phase for state in screen.states[:-1]} == {"active"}


def test_steps_wait_for_a_key_and_can_be_stopped_and_skipped():
    work = CountingWork(3)
    screen = ScriptedScreen(None, "x", "enter", None, None, "s", "q")
    run = GuidedRun(work, screen)
    assert not run.run()
    assert run.is_stopped
    assert (run.done, run.skipped) == ({0}, {1})
    assert work.events == [("start", 0), ("done", 0), ("skipped", 1)]
    assert screen.states[-1].phase == "ready"


def test_run_with_skipped_steps_is_not_complete():
    run = GuidedRun(CountingWork(2), ScriptedScreen("s", "enter", "s"))
    assert not run.run()
    assert not run.is_stopped
    assert run.skipped == {0, 1}


def test_back_does_the_step_before_again():
    work = CountingWork(3)
    keys = ["enter", None, None, "s", "b", "enter", None, None, "b", "b", "q"]
    run = GuidedRun(work, ScriptedScreen(*keys))
    assert not run.run()
    # Back from step 2 to the skipped step 1, which is done; then to steps 1 and 0.
    assert work.events[2:] == [
        ("skipped", 1),
        ("start", 1),
        ("done", 1),
        ("reopen", 1),
        ("reopen", 0),
    ]
    assert run.done == run.skipped == set()


def test_active_step_is_repeated_completed_or_left():
    work = CountingWork(2, duration=3)
    keys = ["enter", "r", None, "b", "enter", None, "t", "enter", None, "q"]
    run = GuidedRun(work, ScriptedScreen(*keys))
    assert not run.run()
    assert work.events == [
        ("start", 0),
        ("repeat", 0),
        ("start", 0),
        ("back", 0),
        ("start", 0),
        ("done", 0),
        ("start", 1),
        ("stop", 1),
    ]


def test_work_can_end_the_run():
    run = GuidedRun(CountingWork(5, duration=9), ScriptedScreen("t"), auto=True)
    assert run.run()
    assert run.done == set()


def test_interrupted_work_waits_and_only_stops():
    work = CountingWork(1, interrupted_at=(2, 3, 4))
    screen = ScriptedScreen(None, "s", "t", "r")
    assert GuidedRun(work, screen, auto=True).run()
    phases = [state.phase for state in screen.states]
    assert phases == ["active", "waiting", "waiting", "waiting", "active", "done"]
    assert screen.states[1].keys == (STOP,)


@pytest.mark.parametrize(
    ("ohm", "text", "share"),
    [(100.0, "100.0 ohm", 0.5), (0.0, "short", 0.0), (np.inf, "open", 0), (np.nan, "-", 0)],
)
def test_resistances_are_bars(ohm, text, share):
    bars = resistance_bars({"a": ohm, "b": 200.0 / 1.15})
    assert (bars.names[0], bars.texts[0]) == ("a", text)
    assert bars.values[0, 0] == pytest.approx(share)


def test_picture_has_outlines_and_points_in_the_scaled_image():
    image = np.zeros((40, 60), np.uint8)
    points = np.array([[[10.0, 20]], [[50.0, 20]]])
    part = Picture("cam", "", image, points, (), np.array([True, False]))
    pixels = draw_picture(part, (30, 20), (1, 2, 3), (4, 5, 6))
    assert pixels.shape == (20, 30, 3)
    assert (pixels == (1, 2, 3)).all(axis=2).sum() == 1
    assert (pixels[10, 25] == (4, 5, 6)).all()
