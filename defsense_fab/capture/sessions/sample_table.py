"""All samples of the read-out board in a session, with their times by the cameras' clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.storage.files import replace_file
from ...sensing.response import relative_change
from ..readout.recording import read_recording
from .session import BOARD, CaptureSession

_BLOCK = 10_000  # samples written at once


@dataclass(frozen=True)
class ClockPart:
    """Of the `samples` of a run between two starts of the read-out board: the tracks' time =
    `offset` + (1 + `drift`) * the read-out board's time, s."""

    samples: slice
    offset: float
    drift: float

    def later(self, by: float) -> ClockPart:
        """For tracks whose times are later by so many s."""
        return replace(self, offset=self.offset + by)


def write_samples(
    path: Path, session: CaptureSession, clocks: Mapping[str, Sequence[ClockPart]],
    rest: Mapping[str, Sequence[float | None]],
) -> None:  # fmt: skip
    """A table of the samples of the runs in `clocks`: run, the read-out board's count and clock,
    time as that of the tracks, s, (R - R0)/R0 by R0 at `rest` (c,) ohm and resistances, ohm; empty
    where not known. One run is in memory at a time. No table where no run has a sample. Raises
    StorageError."""
    path.unlink(missing_ok=True)
    runs = [name for name in clocks if (session.folder / name / BOARD).exists()]
    if not runs or not session.channels:
        return
    names = [*session.channels, *(f"{channel}_ohm" for channel in session.channels)]
    with replace_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(["run", "counter", "device_us", "time", *names]) + "\n")
        for name in runs:
            recording = read_recording(session.folder / name / BOARD)
            time = np.full(len(recording.counter), np.nan)
            for part in clocks[name]:
                device = recording.device_us[part.samples] / 1e6
                time[part.samples] = part.offset + (1 + part.drift) * device
            R0 = np.array([np.nan if r is None else r for r in rest[name]])
            for k in range(0, len(time), _BLOCK):
                rows = slice(k, k + _BLOCK)
                ohm = recording.resistances(np.array(session.reference), rows)
                own = recording.counter[rows], recording.device_us[rows]
                file.write(_lines(name, *own, time[rows], R0, ohm))


def _lines(name: str, counter: Int, device: Int, time: Float, R0: Float, ohm: Float) -> str:
    with np.errstate(all="ignore"):
        table = np.column_stack([counter, device, time, relative_change(ohm, R0), ohm])
    c = ohm.shape[1]
    row = f"{name},%d,%d,%.6f" + ",%.6f" * c + ",%.4f" * c + "\n"
    cells: str = (row * len(table)) % tuple(table.ravel().tolist())
    return cells.replace(",nan", ",").replace(",inf", ",").replace(",-inf", ",")
