"""A re-calibration's recordings: sessions of poses, with or without cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ...capture.readout.recording import read_recording
from ...capture.sessions.run_steps import begun, resting
from ...capture.sessions.session import BOARD, load, read_log
from ...capture.sessions.signals import resistances
from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Recording
from ..fitting.recalibration import Recalibration, recalibrate

_FEW = 5  # samples at rest that tell nothing yet


def recalibrate_from(model: TrainedModel, folders: Sequence[Path]) -> Recalibration:
    """With all runs of the sessions in `folders`, as they were recorded: no marker is looked at.
    Raises TrainingError for sessions of other devices or channels, and without poses or rest."""
    found = recalibrate(model, [r for folder in folders for r in _recordings(model, folder)])
    about = {
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "by": [str(folder) for folder in folders],
        **found.to_json(),
    }
    before = model.told.get("recalibrated", [])
    told = {**model.told, "recalibrated": [*before, about]}
    return replace(found, model=replace(found.model, told=told))


def _recordings(model: TrainedModel, folder: Path) -> list[Recording]:
    session = load(folder)
    if session.device != model.device:
        raise TrainingError(
            f"{folder}: is a session of {session.device}, and the model one of {model.device};"
            " give a session of that device"
        )
    if set(session.channels) != set(model.channels):
        raise TrainingError(
            f"{folder}: has the channels {', '.join(session.channels)}, and the model"
            f" {', '.join(model.channels)}; they are of different cords"
        )
    order = [session.channels.index(name) for name in model.channels]
    m, out = len(model.ids), []
    for run in session.runs:
        if not (run / BOARD).exists():
            continue
        board = read_recording(run / BOARD)
        if len(board.counter) < 2:
            continue
        begin = int(board.host_ns[0])
        time, kept = np.unique((board.host_ns - begin) / 1e9, return_index=True)
        ohm = resistances(session, board)[kept][:, order]
        events = read_log(run)
        poses = tuple(begun(events, begin))
        none = np.zeros((0, m, 3))
        rest = _rest(ohm[resting(events, time, begin)])
        if rest is None:
            raise TrainingError(
                f"{run}: has no rest, from which the cords' resistances at rest are known; record"
                " the routine from its beginning"
            )
        out.append(
            Recording(f"{folder.name}/{run.name}", folder.name, "", time, ohm, rest,
                      np.zeros(0), none, none, None, poses)
        )  # fmt: skip
    if not out:
        raise TrainingError(f"{folder}: the read-out board recorded nothing; record the routine")
    return out


def _rest(ohm: Float) -> Float | None:
    """The median (c,) ohm of samples (n, c) at rest; None of too few."""
    known = ohm[np.isfinite(ohm).all(axis=1)]
    return np.median(known, axis=0) if len(known) > _FEW else None
