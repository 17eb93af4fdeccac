"""Run a model on a device, and iterate over its frames."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np

from ..capture.readout.source import RecordingEnd
from ..core.arrays import Int
from ..core.errors import LiveError
from ..core.progress import Progress, silent
from ..runtime.frames.live_frame import LiveFrame
from .arguments import called, of_kind
from .arguments import options as convert_options
from .layout import Layout
from .model import Model, fitting_device
from .run.options import RunOptions
from .run.run import LiveRun, prepare_run
from .run.sources import Port

_POLL_INTERVAL_S = 0.1  # between checks for the end of the run; Ctrl-C is handled at each


class Live:
    """A live run, created by `live`; do not instantiate it directly.

    Iterating over it yields the newest frame, each frame once. A loop that is slower than the
    read-out board skips frames, which the `number` of the frames shows; the board does not wait.
    Leaving the loop in any way closes the port and the threads, as do `close`, the end of a `with`
    block, and the end of a recording that is replayed.

    A `LiveFrame` has `time` (s), `markers` (m, 3) mm and their uncertainty `radius` (m,) mm,
    `quality`, `signals` (c,), `controls` by the names of the poses, `notes`, and `vertices` (v, 3)
    mm of the surface (None without a layout).

    Attributes:
        faces: Triangles (f, 3) of the surface; None without a layout.
    """

    def __init__(
        self, run: LiveRun, newest: _NewestFrame, faces: Int | None, layout: Layout | None
    ) -> None:
        self.faces = faces
        self._run, self._newest = run, newest
        self._layout = layout  # the run reads files of its device, which are deleted with it
        self._end = weakref.finalize(self, run.close)

    @property
    def notes(self) -> tuple[str, ...]:
        """Present notes for the user, as sentences."""
        return tuple(map(str, (*self._run.notes, *self._run.loop.status.notes)))

    @property
    def closed(self) -> bool:
        """Whether port and threads are closed."""
        return not self._end.alive

    def __iter__(self) -> Iterator[LiveFrame]:
        """Iterate over the newest frames.

        Raises:
            LiveError: The run is closed.
            CaptureError: The port failed.
        """
        if self.closed:
            raise LiveError(
                "this run is closed",
                code="run-closed",
                where=self._run.port,
                action="Start another with live(...)",
            )
        return self._frames()

    def close(self) -> None:
        """Close port and threads, if they are open."""
        self._end()

    def __enter__(self) -> Live:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _frames(self) -> Iterator[LiveFrame]:
        try:
            while not self.closed:
                frame = self._newest.take(_POLL_INTERVAL_S)
                if frame is not None:
                    yield frame
                elif not self._is_running():
                    return
        finally:
            self.close()

    def _is_running(self) -> bool:
        try:
            return self._run.loop.wait(0.0)
        except RecordingEnd:
            return False

    def __repr__(self) -> str:
        state = ", closed" if self.closed else ""
        return f"<Live {self._run.device!r} from {self._run.port}{state}>"


def live(
    model: Model,
    layout: Layout | None = None,
    *,
    port: str,
    progress: Progress = silent,
    **options: Any,
) -> Live:
    """Start to run a model on a device, as `defsense run` does (docs/live.md).

    Resistances of the options are in the order of the layout's cords, or without a layout of the
    model's channels.

    Args:
        model: The model.
        layout: The layout that the model was trained with. Surface and controls need it.
        port: Port of the read-out board ("/dev/ttyUSB0", "COM3", "socket://host:port",
            "udp://HOST"), "twin" for a simulated device
            ("twin:unit=1,seed=7,minutes=5,cut=A@20-30"), or "replay:FILE" for a recording.
        progress: Receives each stage's name, completed fraction and a message.
        **options: Fields of `RunOptions`, such as `rate=50`, `rest=[1500, 900]` or `surface="arap"`
            (None: without a surface). Readings are recorded only into a given folder, `record`.

    Raises:
        LiveError: An argument is invalid, or the layout does not fit the model.
        CaptureError: The port cannot be opened.
        StorageError: The recording cannot be written.
    """
    of_kind(model, "model", Model, LiveError)
    called(progress, LiveError)
    device = fitting_device(model.record, layout)
    if not isinstance(port, str) or not port:
        raise LiveError(
            f"must be text, not {port!r}",
            code="not-a-port",
            where="port",
            action="Write it as '/dev/ttyUSB0', 'COM3' or 'twin'",
            argument="port",
        )
    record = convert_options(options, RunOptions, LiveError)
    if layout is None:
        if Port(port).is_twin:
            raise LiveError(
                f"{port!r} simulates a device, which needs its layout",
                code="layout-missing",
                where="port",
                action="Give the layout",
                argument="layout",
            )
        record = replace(record, surface=None)
    newest = _NewestFrame()
    keeps = record.record is not None
    run = prepare_run(
        device, port, record, receivers=(newest,), keeps_readings=keeps, progress=progress
    )
    try:
        run.loop.start()
    except BaseException:  # also KeyboardInterrupt
        run.close()
        raise
    rest = device.rest if record.surface is not None else None
    return Live(run, newest, None if rest is None else np.asarray(rest.faces, np.int64), layout)


class _NewestFrame:
    """A receiver that keeps the newest frame until it is taken."""

    name, trouble, news = "Python", None, None

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: LiveFrame | None = None

    def send(self, frame: LiveFrame) -> None:
        with self._changed:
            self._frame = frame
            self._changed.notify()

    def take(self, timeout: float) -> LiveFrame | None:
        """Return the newest frame that was not taken; None if none arrives in `timeout` s."""
        with self._changed:
            self._changed.wait_for(lambda: self._frame is not None, timeout)
            frame, self._frame = self._frame, None
            return frame

    def close(self) -> None:
        """Release no resources."""
