"""What a twin's run leaves as a recording does: the read-out board's samples, the log of the steps,
and, beside them, the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.readout.recording import Recorder
from ...capture.readout.source import Event, StampedSample
from ...capture.sessions.session import Log, PoseStep
from ...core.device.device import CONVERTERS
from ...core.storage.files import replace_file
from ...sensing.serial_frames import PROTOCOL, Info, Sample, Stream, encode
from ...sensing.voltage_divider import conversion_time
from .twin_recordings import Truth, TwinRun, TwinRuns

TRUTH, RUN_1 = "truth.npz", "run-1"


def list_steps(run: TwinRun) -> list[PoseStep]:
    """What was asked of the hand."""
    begins = [begin for begin, _ in run.walk.steps]
    lasts = np.diff([*begins, float(run.walk.times[-1])])
    return [PoseStep(n, float(s)) for (_, n), s in zip(run.walk.steps, lasts, strict=True)]


def is_led_on(made: TwinRuns, seconds: float, period: int) -> bool:
    """Whether the read-out board's LED is on, that toggles every `period` ms of its own clock."""
    b = made.traits.board
    return bool(int((b.offset + (1 + b.drift) * seconds) * 1000 / period) % 2)


def write_samples(path: Path, made: TwinRuns, run: TwinRun, converter: str, led: int = 0) -> None:
    """The samples as the host's reader has them, after a serial line; `led` is the period of the
    LED, ms, or 0 where it is still. Raises StorageError."""
    with Recorder(path, run.sums.shape[1]) as recorder:
        recorder.extend(_received(made, run, list(CONVERTERS).index(converter), led))


def _received(
    made: TwinRuns, run: TwinRun, number: int, led: int
) -> Iterator[Event | StampedSample]:
    c, channels = made.converter, run.sums.shape[1]
    about = Info(
        PROTOCOL, (1, 0), number, channels, c.averages, round(made.traits.board.rate), led,
        channels, c.full_scale,
    )  # fmt: skip
    yield Event(0, "start", {**vars(about), "version": list(about.version)})
    # As the firmware has it: the LED as it was when the conversions began.
    begun = run.truth.sample_time - conversion_time(number, channels, c.averages) / 2
    sent = [
        Sample(k, us % (1 << 32), bool(led) and is_led_on(made, at, led), False, c.averages, tuple(sums))
        for k, (us, sums, at) in enumerate(
            zip(run.device_us.tolist(), run.sums.tolist(), begun.tolist(), strict=True)
        )
    ]
    if made.traits.board.steps:  # counts of a converter without steps do not go into a frame
        sent = [m for m in Stream().feed(b"".join(map(encode, sent))) if isinstance(m, Sample)]
    for host, us, sample in zip(run.host_ns.tolist(), run.device_us.tolist(), sent, strict=True):
        yield StampedSample(host, us, sample)


def write_log(path: Path, run: TwinRun) -> None:
    """When each step was shown. Raises StorageError."""
    log = Log(path)
    try:
        for k, ((begin, _), step) in enumerate(zip(run.walk.steps, list_steps(run), strict=True)):
            told: dict[str, Any] = {"step": k, "name": step.name, "seconds": step.seconds}
            log.event("step", **told, host_ns=round(1e9 * begin))
            log.event("done", step=k, host_ns=round(1e9 * (begin + step.seconds)))
        log.event("end", why="all steps were shown", host_ns=round(1e9 * run.walk.times[-1]))
    finally:
        log.close()


def write_truth(
    path: Path, channels: Sequence[str], made: TwinRuns, truth: Truth, begins: float = 0.0
) -> None:
    """All of it by the session's clock, which `begins` at so many s of the twin's. Raises
    StorageError."""
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file, time=truth.time - begins, ids=made.markers.ids,
            points=truth.points.astype(np.float32), sample_time=truth.sample_time - begins,
            poses=np.array(made.fields.poses), weights=truth.weights, channels=np.array(channels),
            signals=truth.signals, ohm=truth.ohm,
        )  # fmt: skip
