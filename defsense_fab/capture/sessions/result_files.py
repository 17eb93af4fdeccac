"""The files of a processed session, that others read: tracks at rest, signals, samples, quality."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.markers import Tracks
from ...core.storage.files import storage_errors, write_json, write_text
from ..files.formats import write_tracks
from ..files.track_conversion import on_even_frames
from .processed_session import ProcessedSession
from .sample_table import write_samples
from .session import CaptureSession

TRACKS, ALIGNED, SIGNALS, SAMPLES, QUALITY, REPORT = (
    "tracks.csv", "aligned.csv", "signals.csv", "samples.csv", "quality.json", "report.html",
)  # fmt: skip


def write_results(folder: Path, session: CaptureSession, result: ProcessedSession) -> None:
    """All but the tracks in the cameras' frame and the report. Raises StorageError."""
    write_tracks(folder / ALIGNED, result.aligned)
    columns = ["frame", "time", *session.channels, "alignment_residual"]
    t = result.tracks
    whole, _ = on_even_frames(Tracks(t.time, t.ids[:0], t.points[:, :0], t.sigma[:, :0], t.frame))
    rows = [f"{k},{at:.6f}{',' * (len(columns) - 2)}"
            for k, at in zip(whole.frame, whole.time, strict=True)]  # fmt: skip
    for row, k, at, signals, residual in zip(
        np.searchsorted(whole.frame, t.frame), t.frame, t.time, result.signals, result.residual,
        strict=True,
    ):  # fmt: skip
        rows[row] = ",".join([str(k), f"{at:.6f}", *map(_cell, signals), _cell(residual)])
    with storage_errors(folder):
        write_text(folder / SIGNALS, "\n".join([",".join(columns), *rows]) + "\n")
        write_json(folder / QUALITY, result.quality)
        write_samples(folder / SAMPLES, session, result.clocks, result.quality["R0"])


def quantiles(values: Float) -> dict[str, float | None]:
    """Median and 95 % of the finite ones, for `quality.json`."""
    good = values[np.isfinite(values)]
    if not len(good):
        return {"median": None, "95 %": None}
    return {"median": float(np.median(good)), "95 %": float(np.quantile(good, 0.95))}


def _cell(value: float) -> str:
    """A number, or nothing where there is none."""
    return f"{value:.6f}" if np.isfinite(value) else ""
