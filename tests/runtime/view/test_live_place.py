"""Frames go to the browsers that watch; notes and buttons go with them."""

from __future__ import annotations

import json
import struct
import threading

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError
from defsense_fab.runtime.frames.live_frame import Note, Quality
from defsense_fab.runtime.view.live_messages import (
    BendTwin,
    LiveDevice,
    LiveNotes,
    RecordAnimation,
    TakeRest,
    UndoTakeRest,
    WatchLive,
)
from defsense_fab.runtime.view.live_place import LivePlace
from defsense_fab.runtime.view.panel_actions import PanelActions
from defsense_fab.runtime.view.viewed_device import ViewedDevice
from tests.runtime.live_frames import frame, wait_for
from tests.support.errors import raises

CORNERS = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
DEVICE = ViewedDevice(
    "bar",
    CORNERS,
    FACES,
    ("a", "b"),
    (np.linspace([1.0, 1, 1], [3, 3, 3], 5), np.linspace([1.0, 2, 1], [2, 2, 3], 3)),
    1.0,
    np.zeros(2),
    np.ones(2),
    0.4,
)


class Server:
    """Keeps what is published."""

    def __init__(self):
        self.events, self.arrays = {}, {}

    def publish(self, event):
        self.events[type(event)] = event

    def publish_arrays(self, arrays):
        self.arrays[arrays.name] = arrays


class Browser:
    is_open = True

    def __init__(self):
        self.messages = []

    def post(self, key, content):
        self.messages.append((key, content))


@pytest.fixture
def server():
    return Server()


@pytest.fixture
def place(server):
    place = LivePlace(server)
    yield place
    place.close()


def ask(place, browser, request):
    return place.handlers[type(request)](browser, request)


def facts_of(content):
    length = struct.unpack_from("<I", content)[0]
    header = json.loads(content[4 : 4 + length])
    return header["facts"], {a["name"]: a["shape"] for a in header["arrays"]}


def test_device_is_introduced_and_removed(place, server):
    place.open(DEVICE, PanelActions(rest=lambda: None))
    device = server.events[LiveDevice]
    assert (device.name, device.channels, device.has_surface) == ("bar", ["a", "b"], True)
    assert (device.can_take_rest, device.can_record) == (True, False)
    arrays = server.arrays["live-device"].arrays
    assert arrays["cordCounts"].tolist() == [5, 3]
    assert arrays["cords"].shape == (8, 3)
    assert arrays["faces"].shape == (4, 3)
    place.close()
    assert server.events[LiveDevice].name == ""


def test_only_browsers_that_watch_get_frames(place):
    watching, other = Browser(), Browser()
    place.open(DEVICE, PanelActions())
    assert ask(place, watching, WatchLive(id=1, is_watching=True)).facts is None
    moved = CORNERS + np.array([1, 0, 0])
    place.send(frame(vertices=moved))
    assert other.messages == []
    (_, content) = watching.messages[-1]
    facts, shapes = facts_of(content)
    assert (facts["quality"], facts["controls"]) == ("trusted", {"bend": 0.25, "twist": -0.5})
    assert shapes == {
        "signals": [2],
        "markers": [3, 3],
        "radius": [3],
        "vertices": [4, 3],
        "cords": [8, 3],
    }
    ask(place, watching, WatchLive(id=2, is_watching=False))
    place.send(frame(2))
    assert len(watching.messages) == 1


def test_a_browser_that_comes_later_gets_the_newest_frame(place):
    place.open(DEVICE, PanelActions())
    place.send(frame(7))
    browser = Browser()
    assert ask(place, browser, WatchLive(id=1, is_watching=True)).facts.number == 7
    assert facts_of(browser.messages[-1][1])[0]["number"] == 7


def test_a_browser_that_has_gone_is_forgotten(place):
    place.open(DEVICE, PanelActions())
    browser = Browser()
    ask(place, browser, WatchLive(id=1, is_watching=True))
    browser.is_open = False
    place.send(frame())
    browser.is_open = True
    place.send(frame(2))
    assert browser.messages == []


def test_cords_follow_the_surface(place):
    from defsense_fab.runtime.view.live_arrays import FrameArrays

    arrays = FrameArrays(DEVICE)
    rest = np.asarray(arrays.rest.arrays["cords"])
    moved = np.asarray(arrays.of(frame(vertices=CORNERS + np.array([1, 2, 3]))).arrays["cords"])
    assert moved - rest == pytest.approx(np.tile([1, 2, 3], (8, 1)), abs=1e-6)


def test_frames_of_a_simulated_device_contain_its_true_shape(place):
    from defsense_fab.runtime.view.live_arrays import FrameArrays

    arrays = FrameArrays(DEVICE, lambda: CORNERS + 1.0)
    assert "trueVertices" not in arrays.of(frame()).arrays
    assert (arrays.of(frame(vertices=CORNERS)).arrays["trueVertices"] == CORNERS + 1.0).all()


def test_failed_frames_name_the_cord_and_have_no_radius(place):
    from defsense_fab.runtime.view.live_arrays import frame_facts

    lost = frame(quality=Quality.FALLBACK, lost_channel="a", radius=np.full(3, np.nan))
    facts = frame_facts(lost)
    assert "without a" in facts.quality_text
    assert facts.marker_radius is None
    tracks = frame().markers + np.array([3, 4, 0])
    assert frame_facts(frame(tracks=tracks)).tracking_error == pytest.approx(5)


def test_notes_of_the_frame_are_shown(place, server):
    place.open(DEVICE, PanelActions())
    place.send(frame(notes=(Note("torn", "cord a is open"),)))
    assert wait_for(lambda: server.events[LiveNotes].notes == ["cord a is open"])


def test_notes_of_the_run_are_shown_without_frames(place, server):
    notes = ["port: the read-out board is gone"]
    place.open(DEVICE, PanelActions(notes=lambda: notes, latency=lambda: "12 ms late"))
    assert wait_for(lambda: server.events[LiveNotes].notes == notes)
    assert server.events[LiveNotes].latency == "12 ms late"
    place.send(frame(notes=(Note("torn", "cord a is open"),)))
    notes.clear()
    assert wait_for(lambda: server.events[LiveNotes].notes == [])


def test_recording_state_follows_recordings_that_start_elsewhere(place, server):
    state, requests = {"on": True, "fails": False}, []

    def record(on):
        requests.append(on)
        if not state["fails"]:
            state["on"] = on
        return "no room" if state["fails"] else "done"

    place.open(DEVICE, PanelActions(None, record, lambda: state["on"]))
    assert wait_for(lambda: server.events[LiveNotes].is_recording)
    assert ask(place, Browser(), RecordAnimation(id=1, is_on=False)).text == "done"
    assert not server.events[LiveNotes].is_recording
    state["fails"] = True
    assert ask(place, Browser(), RecordAnimation(id=2, is_on=True)).text == "no room"
    assert requests == [False, True]
    state["on"] = True
    assert wait_for(lambda: server.events[LiveNotes].is_recording)


def test_rest_is_taken_of_the_running_device(place):
    taken, undone = threading.Event(), threading.Event()
    for request in (TakeRest(id=1), UndoTakeRest(id=1)):
        with raises(LiveError, "not-running"):
            ask(place, Browser(), request)
    place.open(DEVICE, PanelActions(rest=taken.set, undo_rest=undone.set))
    ask(place, Browser(), TakeRest(id=2))
    assert taken.is_set()
    assert not undone.is_set()
    ask(place, Browser(), UndoTakeRest(id=3))
    assert undone.is_set()


def test_markers_alone_are_shown_without_a_surface(place, server):
    place.open(
        ViewedDevice("bar", None, None, ("a",), (), 1.0, np.zeros(1), np.ones(1), 0.4),
        PanelActions(),
    )
    assert not server.events[LiveDevice].has_surface
    browser = Browser()
    ask(place, browser, WatchLive(id=1, is_watching=True))
    place.send(frame())
    assert "vertices" not in facts_of(browser.messages[-1][1])[1]


def test_a_simulated_device_is_bent_by_its_poses(place, server):
    bent = []
    place.open(DEVICE, PanelActions(bend=bent.append, poses=("bend", "twist")))
    assert server.events[LiveDevice].poses == ["bend", "twist"]
    ask(place, Browser(), BendTwin(id=1, levels={"bend": 0.5}))
    ask(place, Browser(), BendTwin(id=2, levels=None))
    assert bent == [{"bend": 0.5}, None]


def test_a_real_device_cannot_be_bent(place):
    place.open(DEVICE, PanelActions())
    with raises(LiveError, "not-running"):
        ask(place, Browser(), BendTwin(id=1, levels={}))
