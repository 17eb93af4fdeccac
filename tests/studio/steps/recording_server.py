"""A server and a browser that record what they are sent, and the session of a device."""

from __future__ import annotations

import contextlib

from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.session.device_session import DeviceSession


class RecordingBrowser:
    """A browser that records its messages."""

    is_open = True

    def __init__(self):
        self.events = []

    def send(self, event):
        self.events.append(event)


class RecordingServer:
    """A server that keeps what is published."""

    def __init__(self):
        self.events, self.arrays = [], []

    def publish(self, event):
        self.events.append(event)

    def publish_arrays(self, arrays):
        self.arrays.append(arrays)

    def last(self, kind):
        """Return the last event of a class."""
        return next(event for event in reversed(self.events) if isinstance(event, kind))

    def all(self, kind):
        """Return the events of a class."""
        return [event for event in self.events if isinstance(event, kind)]


@contextlib.contextmanager
def open_step(kind, folder):
    """Open a step of the device in a folder, as the page does, with its server."""
    server = RecordingServer()
    session = DeviceSession(server, Project(folder), Agreement(trusted=True))
    step = kind(session)
    session.on_device_changed.append(step.on_device_changed)
    session.on_build_loaded.append(step.on_build_loaded)
    session.on_freshness.append(step.on_freshness)
    session.load()
    step.on_device_changed()
    try:
        yield step, server
    finally:
        step.close()
        session.close()


def ask(step, request):
    """Handle a request of a browser, and return the answer."""
    return step.handlers[type(request)](RecordingBrowser(), request)


def settle(step, timeout_s=120.0):
    """Wait until the session and a step have published everything."""
    for _ in range(2):  # a result of one may be work for the other
        assert step.session.wait(timeout_s)
        assert step.wait(timeout_s)
