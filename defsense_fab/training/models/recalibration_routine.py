"""Recalibrate a model from recorded sessions of poses, with or without cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ...capture.readout.recording import read_recording
from ...capture.sessions.session import BOARD, load, read_log, rest_frames, step_starts
from ...capture.sessions.signals import resistances
from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Recording
from ..fitting.recalibration import Recalibration, recalibrate

_MIN_REST_SAMPLES = 6


def recalibrate_from(model: TrainedModel, folders: Sequence[Path]) -> Recalibration:
    """Recalibrate a model from all runs of sessions, as recorded; no markers are used.

    Args:
        model: The trained model.
        folders: Folders of sessions with rest and poses.

    Returns:
        The recalibration; the metadata of its model record the sessions and the result.

    Raises:
        TrainingError: If a session is of another device or other channels, or has no rest or poses.
    """
    result = recalibrate(model, [r for folder in folders for r in _load_runs(model, folder)])
    entry = {
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "by": [str(folder) for folder in folders],
        **result.to_json(),
    }
    metadata = {**model.metadata, "recalibrated": [*model.metadata.get("recalibrated", []), entry]}
    return replace(result, model=replace(result.model, metadata=metadata))


def _load_runs(model: TrainedModel, folder: Path) -> list[Recording]:
    """Return recordings of a session's runs, without frames."""
    session = load(folder)
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


def _median_rest(ohm: Float) -> Float | None:
    """Return the median (c,) in ohm of samples (n, c) at rest; None if there are too few."""
    known = ohm[np.isfinite(ohm).all(axis=1)]
    return np.median(known, axis=0) if len(known) >= _MIN_REST_SAMPLES else None
