"""A live view and a guided run on pages of their own, as a browser sees them."""

from __future__ import annotations

import json

from websockets.sync.client import connect

from defsense_fab.runtime.view.live_page import LiveView, open_guided_page
from defsense_fab.runtime.view.panel_actions import PanelActions
from tests.runtime.live_frames import frame, wait_for
from tests.runtime.view.test_guided_screen import VIEW
from tests.runtime.view.test_live_place import DEVICE
from tests.runtime.view.test_web_server import free_port

LONG = 240.0


def socket_of(port):
    return connect(f"ws://127.0.0.1:{port}/socket", open_timeout=LONG, max_size=None)


def receive(socket, kind):
    """Return the next event of a kind, or the next arrays for "arrays"."""
    while True:
        message = socket.recv(timeout=LONG)
        if isinstance(message, bytes):
            if kind == "arrays":
                return message
            continue
        event = json.loads(message)
        if event["kind"] == kind:
            return event


def send(socket, kind, **content):
    socket.send(json.dumps({"kind": kind, "id": 1, **content}))
    return receive(socket, "reply")


def test_live_page_shows_the_device_and_its_frames():
    rested = []
    actions = PanelActions(rest=lambda: rested.append(True))
    view = LiveView(DEVICE, actions, free_port())
    try:
        assert str(view.port) in view.about
        with socket_of(view.port) as socket:
            assert receive(socket, "live-page")["screen"] == "live"
            assert receive(socket, "live-device")["name"] == "bar"
            assert send(socket, "watch-live", isWatching=True)["problem"] is None
            view.send(frame(vertices=DEVICE.vertices))
            assert b"live-frame" in receive(socket, "arrays")
            assert send(socket, "take-rest")["problem"] is None
            assert rested == [True]
            refused = send(socket, "press-key", key="q", step=0, phase="ready")
            assert refused["problem"]["code"] == "not-expected"
    finally:
        view.close()


def test_guided_page_shows_the_run_and_takes_keys():
    port = free_port()
    with open_guided_page(port, "Check the wiring") as page:
        assert page.url == f"http://127.0.0.1:{port}/"
        assert not page.has_token
        page.screen.show(VIEW)
        with socket_of(port) as socket:
            assert receive(socket, "live-page")["title"] == "Check the wiring"
            assert receive(socket, "guided-state")["title"] == VIEW.title
            send(socket, "press-key", key="enter", step=1, phase="ready")
            assert page.screen.key(LONG) == "enter"
    assert wait_for(lambda: _is_free(port))


def _is_free(port):
    try:
        socket_of(port).close()
    except OSError:
        return True
    return False
