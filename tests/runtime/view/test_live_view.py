"""The panel beside the device: what it tells, and its button for animations."""

import contextlib
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.runtime.view.live_scene import ViewedDevice
from defsense_fab.runtime.view.live_view import LivePanel, PanelActions
from tests.runtime.live_frames import frame, wait_for

pytest.importorskip("viser")
DEVICE = ViewedDevice(
    "bar", None, None, ("a", "b"), (), 1.0, np.zeros(2), np.ones(2), 0.4
)  # fmt: skip


class Gui:
    """What viser's panel is asked for, without a server."""

    def __init__(self):
        self.buttons = {}

    def add_markdown(self, content):
        return SimpleNamespace(content=content)

    def add_folder(self, name):
        return contextlib.nullcontext()

    def add_uplot(self, *_, **__):
        return SimpleNamespace(data=None)

    def add_progress_bar(self, value):
        return SimpleNamespace(value=value)

    def add_button(self, label, **_):
        button = SimpleNamespace(label=label, disabled=False)
        button.on_click = lambda clicked: setattr(button, "click", lambda: clicked(None))
        self.buttons[label] = button
        return button


@contextlib.contextmanager
def panel(actions):
    gui = Gui()
    made = LivePanel(SimpleNamespace(gui=gui), DEVICE, actions)
    try:
        yield made, gui
    finally:
        made.close()


def test_the_frame_s_notes_where_there_are_no_others():
    with panel(PanelActions()) as (made, gui):
        made.show(frame(notes=("cord a is open",)))
        assert made._notes.content == "- cord a is open"
        assert gui.buttons == {}


def test_notes_of_the_run_are_told_while_no_frame_comes():
    notes = ["port: the read-out board is gone"]
    actions = PanelActions()
    with panel(actions) as (made, _):
        actions.notes, actions.latency = lambda: notes, lambda: "12 ms late"
        assert wait_for(lambda: made._notes.content == "- port: the read-out board is gone")
        made.show(frame(notes=("cord a is open",)))
        assert "12 ms late" in made._said.content
        notes.clear()
        assert wait_for(lambda: made._notes.content == "")


def test_the_button_is_what_is_being_recorded():
    """By a flag, or in vain: it never says what is not so."""
    state, asked = {"on": True, "fails": False}, []

    def record(on):
        asked.append(on)
        if not state["fails"]:
            state["on"] = on
        return "no room" if state["fails"] else "done"

    with panel(PanelActions(None, record, lambda: state["on"])) as (_, gui):
        (button,) = gui.buttons.values()
        assert button.label == "Stop, and write it"
        button.click()
        assert (asked, button.label) == ([False], "Record the animation")
        state["fails"] = True
        button.click()
        assert (asked, button.label) == ([False, True], "Record the animation")
        state["on"] = True  # begun by someone else
        assert wait_for(lambda: button.label == "Stop, and write it")


def test_the_button_waits_while_a_file_is_written():
    begun, go = threading.Event(), threading.Event()

    def record(on):
        begun.set()
        assert go.wait(60)
        return "written"

    with panel(PanelActions(None, record, lambda: False)) as (_, gui):
        (button,) = gui.buttons.values()
        thread = threading.Thread(target=button.click)
        thread.start()
        assert begun.wait(60)
        assert button.disabled
        go.set()
        thread.join()
        assert not button.disabled
