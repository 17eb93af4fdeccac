"""Recalibrate a model from recorded sessions of poses, with or without cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ...capture.readout.recording import read_recording
from ...capture.sessions.session import (
    BOARD,
    CaptureSession,
    load,
    read_log,
    rest_frames,
    step_starts,
)
from ...capture.sessions.signals import resistances
from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ...training.data.dataset import Recording
from ...training.fitting import recalibration
from ...training.fitting.model_file import MODEL, load_model, write_model
from ...training.fitting.recalibration import Recalibration
from .training import choose_model_path

_MIN_REST_SAMPLES = 6


@dataclass(frozen=True)
class WrittenRecalibration:
    """A recalibration and its file.

    Attributes:
        path: File of the corrected model; None if correcting the gains is not sufficient.
        result: The recalibration.
    """

    path: Path | None
    result: Recalibration


def recalibrate(
    model: Path, sessions: Sequence[Path], out: Path | None = None
) -> WrittenRecalibration:
    """Correct the gains of a model file by recorded sessions, and write the corrected model.

    Args:
        model: File of the model, or its folder.
        sessions: Folders of sessions with rest and poses, as recorded; no markers are used.
        out: File of the corrected model; None for `recalibrated.json` next to the model.

    Raises:
        TrainingError: A session is of another device or other channels, or has no rest or poses;
            or a file is not a model.
        StorageError: The corrected model cannot be written.
    """
    loaded = load_model(model)
    parent = model if model.is_dir() else model.parent
    path = choose_model_path(out or parent / f"recalibrated{Path(MODEL).suffix}")
    result = recalibrate_model(loaded, sessions)
    if result.problems:
        return WrittenRecalibration(None, result)
    write_model(path, result.model)
    return WrittenRecalibration(path, result)


def recalibrate_model(model: TrainedModel, sessions: Sequence[Path]) -> Recalibration:
    """Correct the gains of a model by all runs of sessions.

    Args:
        model: The model.
        sessions: Folders of sessions with rest and poses, as recorded; no markers are used.

    Returns:
        The recalibration; the metadata of its model record the sessions and the result.

    Raises:
        TrainingError: A session is of another device or other channels, or has no rest or poses.
    """
    recordings = [r for folder in sessions for r in _load_runs(model, folder)]
    result = recalibration.recalibrate(model, recordings)
    entry = {
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "by": [str(folder) for folder in sessions],
        **result.to_json(),
    }
    metadata = {**model.metadata, "recalibrated": [*model.metadata.get("recalibrated", []), entry]}
    return replace(result, model=replace(result.model, metadata=metadata))


def _load_runs(model: TrainedModel, folder: Path) -> list[Recording]:
    """Return recordings of a session's runs, without frames."""
    session = load(folder)
    _require_same_device(model, folder, session)
    order = [session.channels.index(name) for name in model.channels]
    no_points = np.zeros((0, len(model.ids), 3))
    recordings = []
    for run in session.runs:
        if not (run / BOARD).exists():
            continue
        board = read_recording(run / BOARD)
        if len(board.counter) < 2:
            continue
        start_ns = int(board.host_ns[0])
        time, rows = np.unique((board.host_ns - start_ns) / 1e9, return_index=True)
        ohm = resistances(session, board)[rows][:, order]
        events = read_log(run)
        rest = _median_rest(ohm[rest_frames(events, time, start_ns)])
        if rest is None:
            raise TrainingError(
                "has no rest, from which the cords' resistances at rest are measured",
                code="no-rest-pose",
                where=run,
                action="Record the routine from its start",
            )
        recordings.append(
            Recording(
                name=f"{folder.name}/{run.name}",
                session=folder.name,
                unit="",
                sample_time=time,
                ohm=ohm,
                rest=rest,
                time=np.zeros(0),
                points=no_points,
                sigma=no_points,
                poses=tuple(step_starts(events, start_ns)),
            )
        )
    if not recordings:
        raise TrainingError(
            "the read-out board recorded no samples",
            code="no-samples",
            where=folder,
            action="Record the routine",
        )
    return recordings


def _require_same_device(model: TrainedModel, folder: Path, session: CaptureSession) -> None:
    """Raise an error for a session of another device, or of other channels."""
    if session.device != model.device:
        raise TrainingError(
            f"is a session of {session.device}, but the model is of {model.device}",
            code="devices-differ",
            where=folder,
            action=f"Give a session of {model.device}",
            devices=(model.device, session.device),
        )
    if set(session.channels) != set(model.channels):
        raise TrainingError(
            f"has the channels {', '.join(session.channels)}, but the model has"
            f" {', '.join(model.channels)}",
            code="channels-differ",
            where=folder,
            action="Give a session with the cords that the model was trained with",
            missing=tuple(c for c in model.channels if c not in session.channels),
            extra=tuple(c for c in session.channels if c not in model.channels),
        )


def _median_rest(ohm: Float) -> Float | None:
    """Return the median (c,) in ohm of samples (n, c) at rest; None if there are too few."""
    known = ohm[np.isfinite(ohm).all(axis=1)]
    return np.median(known, axis=0) if len(known) >= _MIN_REST_SAMPLES else None
