"""The results of a processed session, and their files: tracks at rest, signals, samples and
quality.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.markers import Tracks
from ...core.storage.files import replace_file, storage_errors, write_json, write_text
from ...sensing.response import relative_change
from ..files.formats import write_tracks
from ..files.track_conversion import on_even_frames
from ..readout.recording import read_recording
from .session import BOARD, CaptureSession


@dataclass(frozen=True)
class ProcessedSession:
    """What processing a session gives.

    Attributes:
        tracks: Tracks in the first camera's frame.
        aligned: Tracks in the device's rest frame.
        signals: Relative changes (R - R0)/R0 at the tracks' times (t, c).
        ohm: Resistances at the tracks' times (t, c), ohm.
        residual: Residuals of the alignment (t,), mm.
        quality: Values of `quality.json`.
        clocks: By run: relations of the board's clock to the tracks' times.
    """

    tracks: Tracks
    aligned: Tracks
    signals: Float
    ohm: Float
    residual: Float
    quality: dict[str, Any]
    clocks: dict[str, list[ClockPart]]


BLOCK_SAMPLES = 10_000  # samples written at once


@dataclass(frozen=True)
class ClockPart:
    """Relation of clocks between two starts of the read-out board.

    The tracks' time is offset + (1 + drift) times the board's time.

    Attributes:
        samples: The samples of the part.
        offset: Offset, s.
        drift: Relative rate difference.
    """

    samples: slice
    offset: float
    drift: float

    def shifted(self, by: float) -> ClockPart:
        """Return the relation for tracks whose times are later by so many s."""
        return replace(self, offset=self.offset + by)


def write_samples(
    path: Path,
    session: CaptureSession,
    clocks: Mapping[str, Sequence[ClockPart]],
    rest: Mapping[str, Sequence[float | None]],
) -> None:
    """Write a table of all samples of the read-out board.

    Columns are run, the board's counter and clock, the tracks' time, s, (R - R0)/R0 and
    resistances, ohm; cells are empty where not known. One run is in memory at a time. No table is
    written if no run has a sample.

    Args:
        path: File to write.
        session: The session.
        clocks: By run: relations of its clocks.
        rest: By run: resistances at rest R0 (c,), ohm.

    Raises:
        StorageError: If it cannot be written.
    """
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
            for k in range(0, len(time), BLOCK_SAMPLES):
                rows = slice(k, k + BLOCK_SAMPLES)
                ohm = recording.resistances(np.array(session.reference), rows)
                counts = recording.counter[rows], recording.device_us[rows]
                file.write(_format_rows(name, *counts, time[rows], R0, ohm))


def _format_rows(name: str, counter: Int, device: Int, time: Float, R0: Float, ohm: Float) -> str:
    with np.errstate(all="ignore"):
        table = np.column_stack([counter, device, time, relative_change(ohm, R0), ohm])
    channels = ohm.shape[1]
    row = f"{name},%d,%d,%.6f" + ",%.6f" * channels + ",%.4f" * channels + "\n"
    cells: str = (row * len(table)) % tuple(table.ravel().tolist())
    return cells.replace(",nan", ",").replace(",inf", ",").replace(",-inf", ",")


TRACKS, ALIGNED, SIGNALS, SAMPLES, QUALITY, REPORT = (
    "tracks.csv",
    "aligned.csv",
    "signals.csv",
    "samples.csv",
    "quality.json",
    "report.html",
)


def write_results(folder: Path, session: CaptureSession, result: ProcessedSession) -> None:
    """Write all results but the tracks in the cameras' frame and the report.

    Raises:
        StorageError: If they cannot be written.
    """
    write_tracks(folder / ALIGNED, result.aligned)
    columns = ["frame", "time", *session.channels, "alignment_residual"]
    tracks = result.tracks
    even_tracks, _ = on_even_frames(
        Tracks(tracks.time, tracks.ids[:0], tracks.points[:, :0], tracks.sigma[:, :0], tracks.frame)
    )
    rows = [
        f"{frame},{time:.6f}{',' * (len(columns) - 2)}"
        for frame, time in zip(even_tracks.frame, even_tracks.time, strict=True)
    ]
    for row, frame, time, signals, residual in zip(
        np.searchsorted(even_tracks.frame, tracks.frame),
        tracks.frame,
        tracks.time,
        result.signals,
        result.residual,
        strict=True,
    ):
        rows[row] = ",".join(
            [str(frame), f"{time:.6f}", *map(_format_cell, signals), _format_cell(residual)]
        )
    with storage_errors(folder):
        write_text(folder / SIGNALS, "\n".join([",".join(columns), *rows]) + "\n")
        write_json(folder / QUALITY, result.quality)
        write_samples(folder / SAMPLES, session, result.clocks, result.quality["R0"])


def quantiles(values: Float) -> dict[str, float | None]:
    """Return median and 95 % quantile of the finite values, for `quality.json`."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return {"median": None, "95 %": None}
    return {"median": float(np.median(finite)), "95 %": float(np.quantile(finite, 0.95))}


def _format_cell(value: float) -> str:
    """Return a number as text; empty if it is not finite."""
    return f"{value:.6f}" if np.isfinite(value) else ""
