"""Make datasets of processed sessions: a recording of each of their runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.files.formats import read_track_file
from ...capture.sessions.results import ALIGNED, QUALITY, SAMPLES, SIGNALS
from ...capture.sessions.session import CaptureSession, load
from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...core.markers import Tracks
from ...core.storage.files import load_json
from ...core.storage.session_manifest import manifest_path
from ...sensing.response import relative_change
from ..data.dataset import Dataset, Recording
from .series import Table, increasing_times, read_table

_MIN_INCREASING_SHARE = 0.995  # of the samples; a smaller share is noted
_TIME_ROUNDING_S = 1e-6  # by which times in different files may differ


def session_dataset(folder: Path) -> Dataset:
    """Make a dataset of the runs of a processed session.

    Args:
        folder: Folder of the session.

    Returns:
        The dataset.

    Raises:
        TrainingError: If the session is not processed, or has no usable run.
        CaptureError: If the session is damaged.
    """
    session, quality = _load_processed(folder)
    processed = _load_tables(folder, session, quality)
    notes = list(processed.notes)
    recordings, skipped = [], [f"{s['run']}: {s['why']}" for s in quality.get("skipped", [])]
    for run in quality["runs"]:
        recording = _make_recording(processed, run, notes)
        if isinstance(recording, str):
            skipped.append(f"{run['run']}: {recording}")
        else:
            recordings.append(recording)
    if not recordings:
        raise TrainingError(
            f"no run can be used for training: {'; '.join(skipped)}",
            code="no-usable-run",
            where=folder,
            skipped=tuple(skipped),
        )
    entry = {
        "notes": notes,
        "folder": str(folder),
        "device": session.device,
        "unit": recordings[0].unit,
        "layout": session.layout,
        "begun": session.started_at,
        "reference": dict(zip(session.channels, session.reference, strict=True)),
        "cameras": [camera.name for camera in session.rig.cameras],
        "version": quality.get("version"),
        "aligned_by": quality.get("aligned_by"),
        "signals": SAMPLES,
        "skipped": skipped,
        "warnings": list(quality.get("warnings", [])),
    }
    return Dataset(
        session.device,
        session.layout,
        session.channels,
        session.markers.ids,
        session.markers.centers,
        tuple(recordings),
        {"sessions": [entry]},
    )


@dataclass(frozen=True)
class _Processed:
    """A processed session.

    Attributes:
        folder: Its folder.
        session: The session as recorded.
        quality: Content of its quality.json.
        tracks: Tracks in the device's rest frame.
        samples: Samples of the read-out board.
        notes: What its tables lack.
    """

    folder: Path
    session: CaptureSession
    quality: Mapping[str, Any]
    tracks: Tracks
    samples: Table
    notes: tuple[str, ...]

    @property
    def has_one_run(self) -> bool:
        """Whether the session has one run, to which all frames belong."""
        return len(self.quality["runs"]) == 1


def _load_processed(folder: Path) -> tuple[CaptureSession, dict[str, Any]]:
    """Return a session and its quality.json; check that all of its runs are processed."""
    process = f"Run defsense capture process {folder} first"
    if manifest_path(folder) is None:
        raise TrainingError(
            "is neither a session nor a dataset",
            code="not-a-session",
            where=folder,
            action="Record a session with defsense capture record",
        )
    session = load(folder)
    if not session.channels:
        raise TrainingError(
            "was recorded without the read-out board",
            code="no-channels",
            where=folder,
            action="Record it again with the read-out board's port",
        )
    for name in (QUALITY, ALIGNED, SIGNALS, SAMPLES):
        if not (folder / name).exists():
            raise TrainingError(
                f"is not processed yet: {name} is missing",
                code="session-not-processed",
                where=folder,
                action=process,
                file=name,
            )
    quality = load_json(folder / QUALITY, TrainingError, process)
    try:
        processed = _read_runs(quality)
    except (KeyError, TypeError):
        raise TrainingError(
            "lacks facts on the runs",
            code="file-damaged",
            where=folder / QUALITY,
            action=process,
        ) from None
    later = [run.name for run in session.runs if run.name not in processed]
    if later:
        raise TrainingError(
            f"{later[0]} was recorded after it was processed",
            code="session-not-processed",
            where=folder,
            action=process,
            run=later[0],
        )
    return session, quality


def _read_runs(quality: dict[str, Any]) -> list[str]:
    """Return the names of the processed runs; check that times separate several runs."""
    names = [str(run["run"]) for run in [*quality["runs"], *quality["skipped"]]]
    if len(quality["runs"]) > 1:
        for run in quality["runs"]:
            if not all(isinstance(run[key], int | float) for key in ("begin", "end")):
                raise TypeError
    return names


def _load_tables(folder: Path, session: CaptureSession, quality: dict[str, Any]) -> _Processed:
    """Return a session with its tables, and notes on frames that they lack."""
    signals, samples = read_table(folder / SIGNALS), read_table(folder / SAMPLES)
    file = read_track_file(folder / ALIGNED)
    notes = [*signals.notes, *file.notes, *samples.notes]
    for name, count in ((SIGNALS, len(signals.values)), (ALIGNED, len(file.tracks.time))):
        if count < quality.get("frames", 0):
            notes.append(
                f"{name} has {count} of {quality['frames']} frames: copy it again, or run defsense"
                f" capture process {folder}"
            )
    tracks = _exclude_dropped(file.tracks, signals)
    return _Processed(folder, session, quality, tracks, samples, tuple(notes))


def _make_recording(
    processed: _Processed, run: Mapping[str, Any], notes: list[str]
) -> Recording | str:
    """Return the recording of a run, or why it cannot be used; add notes on doubtful data."""
    name, session = str(run["run"]), processed.session
    tracks = processed.tracks
    is_in_run = np.ones(len(tracks.time), bool)
    if not processed.has_one_run:
        is_in_run = _is_within(tracks.time, run)
    tracks = tracks.select(is_in_run)
    if not tracks.visible.any():
        return "no marker was visible"
    rest, error, steps = _read_run(run, processed)
    time, ohm = _samples_of_run(processed.samples, name, session.channels)
    is_kept = increasing_times(time)
    if not np.isfinite(relative_change(ohm[is_kept], rest)).any():
        return "there is no sample of the read-out board"
    if not is_kept.mean() > _MIN_INCREASING_SHARE:
        notes.append(
            f"{name}: {len(is_kept) - int(is_kept.sum())} of {len(is_kept)} samples have no time,"
            " or one not after those before, and are left out"
        )
    if tracks.ids.tolist() != session.markers.ids.tolist():
        tracks = _select_markers(tracks, session)
    return Recording(
        name=f"{processed.folder}/{name}",
        session=str(processed.folder),
        unit=session.unit or session.device,
        sample_time=time[is_kept],
        ohm=ohm[is_kept],
        rest=rest,
        time=tracks.time,
        points=tracks.points,
        sigma=tracks.sigma,
        sync_error=error,
        poses=steps,
    )


def _samples_of_run(samples: Table, name: str, channels: tuple[str, ...]) -> tuple[Float, Float]:
    """Return times (n,) s and resistances (n, c) ohm of a run's samples."""
    rows = np.array([r == name for r in samples.run], bool)
    ohm = samples.columns([f"{channel}_ohm" for channel in channels])[rows]
    return samples["time"][rows], ohm


def _read_run(
    run: Mapping[str, Any], processed: _Processed
) -> tuple[Float, float | None, tuple[tuple[float, str], ...]]:
    """Return R0 (c,) ohm of a run (NaN where unknown), its clock error in s, and its poses."""
    channels = len(processed.session.channels)
    try:
        stated = processed.quality["R0"].get(str(run["run"]), [None] * channels)
        rest = np.array([np.nan if r is None else r for r in stated], float)
        error = run.get("sync", {}).get("error_ms")
        if rest.shape != (channels,):
            raise ValueError(f"R0 of {len(rest)} channels, where there are {channels}")
        steps = tuple((float(at), str(pose)) for at, pose in run.get("steps", []))
        return rest, None if error is None else float(error) / 1e3, steps
    except (TypeError, ValueError, AttributeError) as problem:
        raise TrainingError(
            f"the facts on {run['run']} are invalid ({problem})",
            code="file-damaged",
            where=processed.folder / QUALITY,
            action=f"Run defsense capture process {processed.folder} again",
            run=str(run["run"]),
        ) from None


def _exclude_dropped(tracks: Tracks, signals: Table) -> Tracks:
    """Return the tracks without frames that a camera dropped.

    They were filled in with their times only, in both files.
    """
    others = [name for name in signals.names if name not in ("frame", "time")]
    has_signal = np.isfinite(signals.columns(others)).any(axis=1)
    times = _undo_rounding(signals["time"][has_signal], tracks.time)
    return tracks.select(np.isin(tracks.time, times) | tracks.visible.any(axis=1))


def _undo_rounding(time: Float, exact: Float) -> Float:
    """Replace times (n,) by the times (t,) that they were rounded from, where there are any."""
    k = np.clip(np.searchsorted(exact, time - _TIME_ROUNDING_S), 0, len(exact) - 1)
    return np.where(np.abs(exact[k] - time) < _TIME_ROUNDING_S, exact[k], time)


def _is_within(time: Float, run: Mapping[str, Any]) -> Bool:
    """Return which times (t,) belong to a run."""
    is_after = time >= run["begin"] - _TIME_ROUNDING_S
    return np.asarray(is_after & (time <= run["end"] + _TIME_ROUNDING_S))


def _select_markers(tracks: Tracks, session: CaptureSession) -> Tracks:
    """Return the tracks with the markers of the session, in their order."""
    ids = session.markers.ids
    points, sigma = np.full((2, len(tracks.time), len(ids), 3), np.nan)
    column = {int(i): k for k, i in enumerate(tracks.ids)}
    for k, i in enumerate(ids.tolist()):
        if i in column:
            points[:, k], sigma[:, k] = tracks.points[:, column[i]], tracks.sigma[:, column[i]]
    return Tracks(tracks.time, ids, points, sigma, tracks.frame)
