"""A server without a network, and a browser of it, for tests of the studio's steps."""

from __future__ import annotations

import itertools

import msgspec

from defsense_fab.studio.messages.catalogue import DECODER
from defsense_fab.workflow.view import Arrays, Event, Reply


class FakeServer:
    """Keeps what is published.

    Attributes:
        events: The newest event of each kind.
        arrays: The newest arrays of each name.
        history: All events.
    """

    def __init__(self):
        self.events, self.arrays, self.history = {}, {}, []
        self.clients = set()

    def publish(self, event):
        assert isinstance(event, Event)
        self.events[type(event)] = msgspec.json.decode(msgspec.json.encode(event), type=type(event))
        self.history.append(event)

    def publish_arrays(self, arrays):
        assert isinstance(arrays, Arrays)
        self.arrays[arrays.name] = arrays

    def forget(self):
        self.events.clear()
        self.arrays.clear()


class FakeBrowser:
    """A browser whose requests pass through JSON, as real ones do.

    Attributes:
        events: Events that were sent to this browser alone.
        arrays: Arrays that were sent to this browser alone.
    """

    def __init__(self, app):
        self.app, self.events, self.arrays = app, [], []
        self.is_open = True
        self._numbers = itertools.count(1)

    def send(self, event):
        self.events.append(event)

    def send_arrays(self, arrays, reply_to=None):
        self.arrays.append(arrays)

    def ask(self, kind, **content):
        """Send a request and return its result; the errors of the application are raised."""
        values = {"kind": kind, "id": next(self._numbers), **content}
        request = DECODER.decode(msgspec.json.encode(values))
        result = self.app.handle(self, request)
        if isinstance(result, Arrays):
            return result
        msgspec.json.encode(Reply(id=request.id, result=result))
        assert result is None or isinstance(result, request.result)
        return result
