"""The panel next to the device: its texts, and its button for animations."""

import contextlib
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.runtime.frames.live_frame import Note
from defsense_fab.runtime.view import live_view
from defsense_fab.runtime.view.live_scene import ViewedDevice
from defsense_fab.runtime.view.live_view import LivePanel, PanelActions
from tests.runtime.live_frames import frame, wait_for

pytest.importorskip("viser")
RECORD, STOP = live_view.RECORD_LABEL, live_view.STOP_LABEL
DEVICE = ViewedDevice(
    "bar", None, None, ("a", "b"), (), 1.0, np.zeros(2), np.ones(2), 0.4
)  # fmt: skip


class Gui:
    """A panel of viser without a server."""

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
    live = LivePanel(SimpleNamespace(gui=gui), DEVICE, actions)
    try:
        yield live, gui
    finally:
        live.close()


def test_notes_of_the_frame_are_shown():
    with panel(PanelActions()) as (live, gui):
        live.show(frame(notes=(Note("torn", "cord a is open"),)))
        assert live.notes == "- cord a is open"
        assert gui.buttons == {}


def test_notes_of_the_run_are_shown_without_frames():
    notes = ["port: the read-out board is gone"]
    actions = PanelActions()
    with panel(actions) as (live, _):
        actions.notes, actions.latency = lambda: notes, lambda: "12 ms late"
        assert wait_for(lambda: live.notes == "- port: the read-out board is gone")
        live.show(frame(notes=(Note("torn", "cord a is open"),)))
        assert "12 ms late" in live.summary
        notes.clear()
        assert wait_for(lambda: live.notes == "")


def test_label_of_the_button_follows_the_recording():
    """Recordings also start without the button, and may fail to start."""
    state, requests = {"on": True, "fails": False}, []

    def record(on):
        requests.append(on)
        if not state["fails"]:
            state["on"] = on
        return "no room" if state["fails"] else "done"

    with panel(PanelActions(None, record, lambda: state["on"])) as (_, gui):
        (button,) = gui.buttons.values()
        assert button.label == STOP
        button.click()
        assert (requests, button.label) == ([False], RECORD)
        state["fails"] = True
        button.click()
        assert (requests, button.label) == ([False, True], RECORD)
        state["on"] = True  # started elsewhere
        assert wait_for(lambda: button.label == STOP)


def test_button_is_disabled_while_a_file_is_written():
    started, go = threading.Event(), threading.Event()

    def record(on):
        started.set()
        assert go.wait(60)
        return "written"

    with panel(PanelActions(None, record, lambda: False)) as (_, gui):
        (button,) = gui.buttons.values()
        thread = threading.Thread(target=button.click)
        thread.start()
        assert started.wait(60)
        assert button.disabled
        go.set()
        thread.join()
        assert not button.disabled
