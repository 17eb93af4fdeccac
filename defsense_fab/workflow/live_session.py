"""A device live: frames of what its read-out board says, as they come."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from ..capture.readout.source import RecordingEnd
from ..core.arrays import Float, Int
from ..core.errors import LiveError
from ..core.progress import Progress, silent
from ..runtime.frames.live_frame import LiveFrame
from ..runtime.live.live_run import LiveRun, RunOptions, live_run
from ..runtime.surface.live_surface import Mode
from .arguments import array, called, of_kind, path, whole
from .layout import Layout
from .model import MODES, Model, fitting_device

_LOOK = 0.1  # s, after which it is looked whether the run goes on: Ctrl-C is heard between
_RATES = 10, 500  # Hz


class Live:
    """A run that was begun by `live`: `for frame in run` gives the newest frame, each once.

    What is slower than the read-out board misses frames, which their `number` tells; nothing waits
    for it. Leaving the loop in any way closes port and threads, as do `close`, the end of a `with`
    block, and the end of a recording that is played. Each `LiveFrame` has `time` s, `markers`
    (m, 3) mm and `radius` (m,) mm around them, `quality`, `signals` (c,), `controls` by the poses'
    names, `notes`, and `vertices` (v, 3) mm of the surface, whose triangles are the run's `faces`
    (f, 3), both None without a layout.
    """

    def __init__(self, run: LiveRun, newest: _Newest, faces: Int | None, of: Layout | None) -> None:
        """By `live`."""
        self.faces = faces
        self._run, self._newest, self._of = run, newest, of
        self._end = weakref.finalize(self, run.close)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know now, in sentences."""
        return tuple(map(str, (*self._run.notes, *self._run.loop.status.notes)))

    @property
    def closed(self) -> bool:
        """Whether port and threads are closed."""
        return not self._end.alive

    def __iter__(self) -> Iterator[LiveFrame]:
        """Raises LiveError once the run is closed, and what ends it: CaptureError for a port."""
        if self.closed:
            raise LiveError(f"{self._run.port}: this run is closed; begin another with live(...)")
        return self._frames()

    def close(self) -> None:
        """Close port and threads; a second time nothing happens."""
        self._end()

    def __enter__(self) -> Live:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.close()

    def _frames(self) -> Iterator[LiveFrame]:
        try:
            while not self.closed:
                frame = self._newest.take(_LOOK)
                if frame is not None:
                    yield frame
                elif not self._goes_on():
                    return
        finally:
            self.close()

    def _goes_on(self) -> bool:
        try:
            return self._run.loop.wait(0.0)
        except RecordingEnd:
            return False

    def __repr__(self) -> str:
        ended = ", closed" if self.closed else ""
        return f"<Live {self._run.device!r} from {self._run.port}{ended}>"


def live(
    model: Model,
    layout: Layout | None = None,
    *,
    port: str,
    rate: int = 100,
    rest_resistances: ArrayLike | None = None,
    divider_resistances: ArrayLike | None = None,
    surface: Mode | None = "default",
    record: str | Path | None = None,
    progress: Progress = silent,
) -> Live:
    """Begin to run a model on a device, as `defsense run` does (docs/live.md).

    `port` is that of the read-out board ("/dev/ttyUSB0", "COM3", "socket://host:port"), "twin" for
    a simulated device ("twin:unit=1,seed=7,minutes=5,cut=left@20-30"), or "replay:FILE" of a
    recording; the board takes `rate` samples a second. The `layout` that the model was trained with
    gives surface, poses and cords. R0 is measured while the device lies still at the beginning,
    unless `rest_resistances` (c,) ohm are given; `divider_resistances` (c,) ohm of the read-out
    board are those of the training. Both are in the order of the layout's cords, or of the model's
    channels. `surface` as in `Model.surface`, None: without. Readings are kept in the folder
    `record`, if that is given.

    Raises LiveError for what does not go together, CaptureError for a port that cannot be opened,
    StorageError where readings cannot be kept.
    """
    of_kind(model, "model", Model, LiveError)
    called(progress, LiveError)
    device = fitting_device(model.record, layout)
    if not isinstance(port, str) or not port:
        raise LiveError(f"port {port!r}: must be text, as in '/dev/ttyUSB0' or 'twin'")
    if layout is None and port.partition(":")[0] == "twin":
        raise LiveError(f"port {port!r}: a twin needs the layout of its device; give it")
    rate = whole(rate, "rate", LiveError, *_RATES)
    if surface is not None and of_kind(surface, "surface", str, LiveError) not in MODES:
        raise LiveError(f"surface {surface!r}: is unknown; there are {', '.join(MODES)}, and None")
    newest = _Newest()
    options = RunOptions(
        port, rate, _ohm("divider_resistances", divider_resistances, device.board_channels),
        _ohm("rest_resistances", rest_resistances, device.board_channels),
        surface=None if layout is None else surface, keep=record is not None,
        record=None if record is None else path(record, "record", LiveError), views=(newest,),
    )  # fmt: skip
    run = live_run(device, options, progress)
    try:
        run.loop.start()
    except BaseException:  # Ctrl-C, too
        run.close()
        raise
    solved = device.rest if options.surface is not None else None
    return Live(run, newest, None if solved is None else np.asarray(solved.faces, np.int64), layout)


def _ohm(name: str, values: ArrayLike | None, wired: tuple[str, ...]) -> Float | None:
    if values is None:
        return None
    ohm = array(values, name, LiveError)
    if ohm.shape != (len(wired),) or not (np.isfinite(ohm).all() and (ohm > 0).all()):
        raise LiveError(
            f"{name}: must be {len(wired)} numbers above 0, in ohm, of {', '.join(wired)}"
        )
    return ohm


class _Newest:
    """A view of the run that keeps the newest frame until it is taken."""

    name, trouble, news = "Python", None, None

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: LiveFrame | None = None

    def send(self, frame: LiveFrame) -> None:
        with self._changed:
            self._frame = frame
            self._changed.notify()

    def take(self, seconds: float) -> LiveFrame | None:
        """The newest that was not taken; None if none comes in so many s."""
        with self._changed:
            self._changed.wait_for(lambda: self._frame is not None, seconds)
            frame, self._frame = self._frame, None
            return frame

    def close(self) -> None:
        """Nothing is open."""
