"""Show live frames in the browsers of a server: those that watch get the newest frame."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ...core.errors import LiveError
from ..frames.live_frame import LiveFrame
from .client import Client
from .live_arrays import NO_DEVICE, FrameArrays, frame_facts, live_device
from .live_messages import (
    FRAME_ARRAYS,
    AnimationResult,
    BendTwin,
    FrameFacts,
    LiveNotes,
    RecordAnimation,
    TakeRest,
    UndoTakeRest,
    WatchLive,
    WatchResult,
)
from .messages import Event, Request, encode_arrays
from .panel_actions import PanelActions
from .viewed_device import ViewedDevice
from .web_server import WebServer

_NOTES_INTERVAL_S = 0.25  # between two checks of the notes, which also change without frames
#: Handles a request of a browser.
Handler = Callable[[Client, Any], Any]


class LivePlace:
    """A place for one live device at a time on the pages of a server.

    Args:
        server: Sends events and arrays to the browsers.
    """

    def __init__(self, server: WebServer) -> None:
        self._server = server
        self._watchers = set[Client]()
        self._lock = threading.Lock()
        self._actions: PanelActions | None = None
        self._arrays: FrameArrays | None = None
        self._frame: LiveFrame | None = None
        self._content: bytes | None = None  # of the newest frame, if it was needed
        self._notes: LiveNotes | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that the place handles."""
        return {
            WatchLive: self._watch,
            TakeRest: self._take_rest,
            UndoTakeRest: self._undo_take_rest,
            RecordAnimation: self._record_animation,
            BendTwin: self._bend_twin,
        }

    @property
    def facts(self) -> FrameFacts | None:
        """Facts of the newest frame, or None."""
        frame = self._frame
        return None if frame is None else frame_facts(frame)

    @property
    def notes(self) -> Sequence[str]:
        """The notes that are shown."""
        return () if self._notes is None else self._notes.notes

    def open(self, device: ViewedDevice, actions: PanelActions) -> None:
        """Show a device, in place of an earlier one."""
        self.close()
        arrays = FrameArrays(device, actions.shape)
        self._actions, self._arrays = actions, arrays
        self._server.publish_arrays(arrays.rest)
        self._server.publish(live_device(device, actions))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._follow_notes, name="live notes", daemon=True)
        self._thread.start()

    def send(self, frame: LiveFrame) -> None:
        """Send a frame to the browsers that watch; a slow one gets fewer frames."""
        arrays = self._arrays
        if arrays is None:
            return
        with self._lock:
            self._watchers = {client for client in self._watchers if client.is_open}
            watchers = tuple(self._watchers)
            self._frame, self._content = frame, None
        if watchers:
            content = encode_arrays(arrays.of(frame))
            for client in watchers:
                client.post(("arrays", FRAME_ARRAYS), content)
            self._content = content

    def close(self) -> None:
        """Remove the device."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._arrays is not None:
            self._server.publish(NO_DEVICE)
        self._actions = self._arrays = self._frame = self._content = self._notes = None

    def disconnect(self, client: Client) -> None:
        """Forget a browser."""
        with self._lock:
            self._watchers.discard(client)

    def _watch(self, client: Client, request: WatchLive) -> WatchResult:
        with self._lock:
            if request.is_watching:
                self._watchers.add(client)
            else:
                self._watchers.discard(client)
            frame, arrays = self._frame, self._arrays
        if request.is_watching and frame is not None and arrays is not None:
            client.post(("arrays", FRAME_ARRAYS), self._content or encode_arrays(arrays.of(frame)))
        return WatchResult(facts=self.facts)

    def _take_rest(self, _: Client, __: TakeRest) -> None:
        rest = None if self._actions is None else self._actions.rest
        if rest is None:
            raise _not_running()
        rest()

    def _undo_take_rest(self, _: Client, __: UndoTakeRest) -> None:
        undo = None if self._actions is None else self._actions.undo_rest
        if undo is None:
            raise _not_running()
        undo()

    def _bend_twin(self, _: Client, request: BendTwin) -> None:
        bend = None if self._actions is None else self._actions.bend
        if bend is None:
            raise _not_running()
        bend(request.levels)

    def _record_animation(self, _: Client, request: RecordAnimation) -> AnimationResult:
        record = None if self._actions is None else self._actions.record
        if record is None:
            raise _not_running()
        text = record(request.is_on)
        self._update_notes()
        return AnimationResult(text=text)

    def _follow_notes(self) -> None:
        self._update_notes()
        while not self._stop.wait(_NOTES_INTERVAL_S):
            self._update_notes()

    def _update_notes(self) -> None:
        actions, frame = self._actions, self._frame
        if actions is None:
            return
        if actions.notes is not None:
            notes = [str(note) for note in actions.notes()]
        else:
            notes = [] if frame is None else [str(note) for note in frame.notes]
        latency = "" if actions.latency is None else actions.latency()
        found = LiveNotes(notes=notes, latency=latency, is_recording=actions.is_recording())
        if found != self._notes:
            self._notes = found
            self._publish(found)

    def _publish(self, event: Event) -> None:
        self._server.publish(event)


def _not_running() -> LiveError:
    return LiveError("no device runs live", code="not-running", action="Start the live view")
