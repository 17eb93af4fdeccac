"""Files of a simulated session: samples and log, as a recording writes them, and the truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...capture.readout.recording import Recorder
from ...capture.readout.source import Event, StampedSample
from ...capture.sessions.session import Log, PoseStep
from ...core.storage.files import replace_file
from ...sensing.serial_frames import PROTOCOL, Info, Sample, Stream, converter_code, encode
from ...sensing.voltage_divider import conversion_time
from .twin_recordings import Truth, TwinRun, TwinRuns

TRUTH, RUN_1 = "truth.npz", "run-1"


def list_steps(run: TwinRun) -> list[PoseStep]:
    """Return the steps that were requested of the hand, with their durations, s."""
    starts = [start for start, _ in run.walk.steps]
    durations = np.diff([*starts, float(run.walk.times[-1])])
    return [PoseStep(n, float(s)) for (_, n), s in zip(run.walk.steps, durations, strict=True)]


def is_led_on(runs: TwinRuns, seconds: float, period: int) -> bool:
    """Return whether the board's LED is on.

    Args:
        runs: The simulated sessions.
        seconds: Time, s.
        period: Time after which the LED toggles, ms of the board's clock.
    """
    return bool(int(runs.traits.board.clock(seconds) * 1000 / period) % 2)


def write_samples(path: Path, runs: TwinRuns, run: TwinRun, converter: str, led: int = 0) -> None:
    """Write the samples as the host receives them over a serial line.

    Args:
        path: The file.
        runs: The simulated sessions.
        run: The session to write.
        converter: Name of the converter, a key of `CONVERTERS`.
        led: Time after which the LED toggles, ms; 0 if it is off.

    Raises:
        StorageError: The file cannot be written.
    """
    with Recorder(path, run.sums.shape[1]) as recorder:
        recorder.extend(_received(runs, run, converter_code(converter), led))


def _received(
    runs: TwinRuns, run: TwinRun, number: int, led: int
) -> Iterator[Event | StampedSample]:
    c, channels = runs.converter, run.sums.shape[1]
    info = Info(
        PROTOCOL,
        (1, 0),
        number,
        channels,
        c.averages,
        round(runs.traits.board.rate),
        led,
        channels,
        c.full_scale,
    )
    yield Event(0, "start", {**vars(info), "version": list(info.version)})
    # Like the firmware: the state of the LED when the conversions started.
    starts = run.truth.sample_time - conversion_time(number, channels, c.averages) / 2
    rows = zip(run.device_us.tolist(), run.sums.tolist(), starts.tolist(), strict=True)
    samples = []
    for k, (us, sums, start) in enumerate(rows):
        is_on = bool(led) and is_led_on(runs, start, led)
        samples.append(Sample(k, us % (1 << 32), is_on, False, c.averages, tuple(sums)))
    if runs.traits.board.steps:  # counts of a continuous converter do not fit into a frame
        data = b"".join(map(encode, samples))
        samples = [m for m in Stream().feed(data) if isinstance(m, Sample)]
    stamps = zip(run.host_ns.tolist(), run.device_us.tolist(), samples, strict=True)
    for host, us, sample in stamps:
        yield StampedSample(host, us, sample)


def write_log(path: Path, run: TwinRun) -> None:
    """Write the log of the steps.

    Raises:
        StorageError: The file cannot be written.
    """
    log = Log(path)
    try:
        for k, ((start, _), step) in enumerate(zip(run.walk.steps, list_steps(run), strict=True)):
            host_ns = round(1e9 * start)
            log.event("step", step=k, name=step.name, seconds=step.seconds, host_ns=host_ns)
            log.event("done", step=k, host_ns=round(1e9 * (start + step.seconds)))
        log.event("end", why="all steps were shown", host_ns=round(1e9 * run.walk.times[-1]))
    finally:
        log.close()


def write_truth(
    path: Path, channels: Sequence[str], runs: TwinRuns, truth: Truth, start: float = 0.0
) -> None:
    """Write the truth, by the session's clock.

    Args:
        path: The file.
        channels: Names of the channels (c).
        runs: The simulated sessions.
        truth: The truth about the session.
        start: Time of the twin at which the session's clock is at 0, s.

    Raises:
        StorageError: The file cannot be written.
    """
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            time=truth.time - start,
            ids=runs.markers.ids,
            points=truth.points.astype(np.float32),
            sample_time=truth.sample_time - start,
            poses=np.array(runs.fields.poses),
            weights=truth.weights,
            channels=np.array(channels),
            signals=truth.signals,
            ohm=truth.ohm,
        )
