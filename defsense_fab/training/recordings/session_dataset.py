"""Datasets of processed sessions: a recording of each of their runs."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.files.formats import read_tracks
from ...capture.sessions.result_files import ALIGNED, QUALITY, SAMPLES, SIGNALS
from ...capture.sessions.session import CaptureSession, load
from ...core.arrays import Bool, Float
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.markers import Tracks
from ...core.storage import typed_json
from ...core.storage.files import load_json
from ...core.storage.session_manifest import manifest_path
from ...sensing.response import relative_change
from ...store.layout import LAYOUT, LayoutRecord, layout_hash, load_layout
from ..data.dataset import Dataset, Recording
from ..data.dataset_assembly import join_datasets, select_channels
from .series import Table, read_table

_KEPT = 0.995  # of the samples: fewer are worth a word
_ROUNDING = 1e-6  # s, by which times in different files may differ


def session_dataset(folders: Sequence[Path], device: Device | None = None) -> Dataset:
    """The runs of the processed sessions in `folders`. With the `device`, sessions must be of it
    and of its cords as they are built, and the channels have its order.

    Raises TrainingError for sessions that are not processed, do not go together or have nothing to
    train on, CaptureError for damaged ones."""
    layout = device_layout(device)
    return join_datasets([_one(folder, device, layout) for folder in folders])


def device_layout(device: Device | None) -> LayoutRecord | None:
    """Of the device's build, if there is one."""
    if device is None or not (build_folder(device) / LAYOUT).exists():
        return None
    return load_layout(build_folder(device), TrainingError)


def _one(folder: Path, device: Device | None, layout: LayoutRecord | None) -> Dataset:
    session, quality = _processed(folder)
    known = session.layout
    if device is not None and session.device != device.name:
        raise TrainingError(
            f"{folder}: is a session of {session.device}, not of {device.name}; give this device's"
            " sessions"
        )
    if layout is not None and known and known != layout_hash(layout):
        raise TrainingError(
            f"{folder}: was recorded with other cords ({known}) than {build_folder(device)}"  # type: ignore[arg-type]
            f" has ({layout_hash(layout)}); train with the build that it was recorded with, or"
            " record anew"
        )
    signals = read_table(folder / SIGNALS)
    tracks = read_tracks(folder / ALIGNED)
    for name, count in ((SIGNALS, len(signals.values)), (ALIGNED, len(tracks.time))):
        if count < quality.get("frames", 0):
            raise TrainingError(
                f"{folder / name}: is cut off: {count} of {quality['frames']} frames; copy it"
                f" again, or run 'defsense capture process {folder}'"
            )
    tracks = _taken(tracks, signals)
    samples = read_table(folder / SAMPLES) if (folder / SAMPLES).exists() else None
    runs = quality["runs"]
    notes = list[str]()
    recordings, skipped = [], [f"{s['run']}: {s['why']}" for s in quality.get("skipped", [])]
    for run in runs:
        made = _recording(folder, session, run, quality, tracks, samples, signals, len(runs), notes)
        if isinstance(made, str):
            skipped.append(f"{run['run']}: {made}")
        else:
            recordings.append(made)
    if not recordings:
        raise TrainingError(f"{folder}: no run can be trained on: {'; '.join(skipped)}")
    told = {
        "notes": notes,
        "folder": str(folder),
        "device": session.device,
        "unit": recordings[0].unit,
        "layout": known,
        "begun": session.begun,
        "reference": dict(zip(session.channels, session.reference, strict=True)),
        "cameras": [camera.name for camera in session.rig.cameras],
        "version": quality.get("version"),
        "aligned_by": quality.get("aligned_by"),
        "signals": SAMPLES if samples is not None else SIGNALS,
        "skipped": skipped,
        "warnings": list(quality.get("warnings", [])),
    }
    provenance: dict[str, Any] = {"sessions": [told]}
    if layout is not None and layout.response is not None:
        provenance["response"] = typed_json.to_json(layout.response)
    m = session.markers
    out = Dataset(
        session.device, known, session.channels, m.ids, m.centers, tuple(recordings), provenance
    )
    wanted = [c.name for c in layout.by_channel()] if layout is not None else session.channels
    return select_channels(out, wanted)


def _processed(folder: Path) -> tuple[CaptureSession, dict[str, Any]]:
    """The session and what its processing told. Raises TrainingError where it is not processed, or
    was before its last run."""
    again = f"run 'defsense capture process {folder}' first"
    if manifest_path(folder) is None:
        raise TrainingError(
            f"{folder}: is no session ('defsense capture record' makes sessions), nor a dataset"
        )
    session = load(folder)
    if not session.channels:
        raise TrainingError(
            f"{folder}: was recorded without the read-out board; record it again with --port"
        )
    for name in (QUALITY, ALIGNED, SIGNALS):
        if not (folder / name).exists():
            raise TrainingError(f"{folder}: is not processed yet ({name} is missing); {again}")
    quality = load_json(folder / QUALITY, TrainingError, again)
    try:
        runs = [str(run["run"]) for run in [*quality["runs"], *quality["skipped"]]]
        several = len(quality["runs"]) > 1
        old = several and not all({"begin", "end"} <= set(run) for run in quality["runs"])
        if not isinstance(quality["R0"], dict):
            old = True
        if not all(isinstance(run.get(key, 0.0), int | float) for run in quality["runs"]
                   for key in ("begin", "end")):  # fmt: skip
            raise TypeError
    except (KeyError, TypeError):
        raise TrainingError(
            f"{folder / QUALITY}: lacks what is told of the runs; {again}"
        ) from None
    if old:
        raise TrainingError(f"{folder}: was processed by an older version; {again}")
    later = [run.name for run in session.runs if run.name not in runs]
    if later:
        raise TrainingError(f"{folder}: {later[0]} was recorded after it was processed; {again}")
    return session, quality


def _recording(
    folder: Path, session: CaptureSession, run: Mapping[str, Any], quality: Mapping[str, Any],
    tracks: Tracks, samples: Table | None, signals: Table, runs: int, notes: list[str],
) -> Recording | str:  # fmt: skip
    """A run, or why it cannot be used; what is doubtful of it is added to the `notes`."""
    name, c = str(run["run"]), len(session.channels)
    within = np.ones(len(tracks.time), bool) if runs == 1 else _within(tracks.time, run)
    part = tracks.part(within)
    if not part.seen.any():
        return "no marker was seen"
    R0, error, steps = _told_of(run, quality, folder / QUALITY, c)
    if samples is not None:
        rows = np.array([r == name for r in samples.run], bool)
        time = samples["time"][rows]
        ohm = samples.columns([f"{channel}_ohm" for channel in session.channels])[rows]
    else:
        rows = np.ones(len(signals.values), bool) if runs == 1 else _within(signals["time"], run)
        time, s = signals["time"][rows], signals.columns(session.channels)[rows]
        R0 = np.where(np.isfinite(R0), R0, 1.0)
        time = _rounded(time, part.time)
        there = np.isfinite(s).any(axis=1)  # frames that were dropped have none
        time, ohm = time[there], (R0 * (1 + s))[there]
    kept = rising(time)
    if not np.isfinite(relative_change(ohm[kept], R0)).any():
        return "there is no sample of the read-out board"
    if not kept.mean() > _KEPT:
        notes.append(
            f"{name}: {len(kept) - int(kept.sum())} of {len(kept)} samples have no time, or none"
            " after those before, and are left out"
        )
    if part.ids.tolist() != session.markers.ids.tolist():
        part = _as_designed(part, session)
    return Recording(
        f"{folder}/{name}", str(folder), session.unit or session.device, time[kept], ohm[kept], R0,
        part.time, part.points, part.sigma, error, steps,
    )  # fmt: skip


def _told_of(
    run: Mapping[str, Any], quality: Mapping[str, Any], path: Path, channels: int
) -> tuple[Float, float | None, tuple[tuple[float, str], ...]]:
    """R0 (c,) ohm of a run, NaN where not known, the error of its clocks, s, and its steps. Raises
    TrainingError for what its quality.json cannot tell."""
    try:
        told = quality["R0"].get(str(run["run"]), [None] * channels)
        R0 = np.array([np.nan if r is None else r for r in told], float)
        error = run.get("sync", {}).get("error_ms")
        if R0.shape != (channels,):
            raise ValueError(f"R0 of {len(R0)} channels, where there are {channels}")
        steps = tuple((float(at), str(pose)) for at, pose in run.get("steps", []))
        return R0, None if error is None else float(error) / 1e3, steps
    except (TypeError, ValueError, AttributeError) as problem:
        raise TrainingError(
            f"{path}: what it tells of {run['run']} cannot be ({problem}); run 'defsense capture"
            f" process {path.parent}' again"
        ) from None


def _taken(tracks: Tracks, signals: Table) -> Tracks:
    """Without the frames that were filled in for those that a camera dropped: nothing is known at
    them but their times, in either file."""
    others = [name for name in signals.names if name not in ("frame", "time")]
    told = np.isfinite(signals.columns(others)).any(axis=1)
    times = _rounded(signals["time"][told], tracks.time)
    return tracks.part(np.isin(tracks.time, times) | tracks.seen.any(axis=1))


def _rounded(time: Float, exact: Float) -> Float:
    """Times (n,) as those (t,) that they are rounded from, where they are."""
    k = np.clip(np.searchsorted(exact, time - _ROUNDING), 0, len(exact) - 1)
    return np.where(np.abs(exact[k] - time) < _ROUNDING, exact[k], time)


def _within(time: Float, run: Mapping[str, Any]) -> Bool:
    """Times (t,) of a run."""
    return np.asarray((time >= run["begin"] - _ROUNDING) & (time <= run["end"] + _ROUNDING))


def rising(time: Float) -> Bool:
    """Which of the times (n,) are known and increase, as many of them as can be: after the read-out
    board began anew its clock is known to some ms only, and samples may seem to come twice."""
    known = np.isfinite(time)
    if (np.diff(time[known]) > 0).all():
        return np.asarray(known)
    # The longest increasing subsequence (Fredman 1975): what ends the best one of each length.
    ends, rows, before = list[float](), list[int](), np.full(len(time), -1)
    for k in np.flatnonzero(known).tolist():
        at = bisect_left(ends, time[k])
        before[k] = rows[at - 1] if at else -1
        ends[at : at + 1], rows[at : at + 1] = [float(time[k])], [k]
    out = np.zeros(len(time), bool)
    k = rows[-1]
    while k >= 0:
        out[k] = True
        k = int(before[k])
    return out


def _as_designed(tracks: Tracks, session: CaptureSession) -> Tracks:
    """With the markers of the session, in their order."""
    ids = session.markers.ids
    points, sigma = np.full((2, len(tracks.time), len(ids), 3), np.nan)
    column = {int(i): k for k, i in enumerate(tracks.ids)}
    for k, i in enumerate(ids.tolist()):
        if i in column:
            points[:, k], sigma[:, k] = tracks.points[:, column[i]], tracks.sigma[:, column[i]]
    return Tracks(tracks.time, ids, points, sigma, tracks.frame)
