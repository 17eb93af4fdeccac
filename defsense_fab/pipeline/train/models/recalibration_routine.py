"""A re-calibration's recordings: sessions of poses, with or without cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ....capture.readout.recording import read_recording
from ....core.arrays import Float
from ....core.errors import TrainingError
from ....decoding.trained_model import TrainedModel
from ....training.data.dataset import Recording
from ....training.fitting.recalibration import Recalibration, as_told, recalibrate
from ...sessions.session import BOARD, REST, load, read_log
from ...sessions.signals import resistances

_SETTLED = 0.3  # of a rest, before which the cords still settle


def recalibrate_from(model: TrainedModel, folders: Sequence[Path]) -> Recalibration:
    """With all runs of the sessions in `folders`, as they were recorded: no marker is looked at.
    Raises TrainingError for sessions of other devices or channels, and without poses or rest."""
    found = recalibrate(model, [r for folder in folders for r in _recordings(model, folder)])
    about = {
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        "by": [str(folder) for folder in folders],
        **as_told(found),
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
        poses = tuple(
            ((int(e["host_ns"]) - begin) / 1e9, str(e["name"]))
            for e in read_log(run)
            if e.get("event") == "step" and "name" in e
        )
        none = np.zeros((0, m, 3))
        rest = _rest(time, ohm, poses)
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


def _rest(time: Float, ohm: Float, poses: Sequence[tuple[float, str]]) -> Float | None:
    """The median (c,) ohm of the rests, but for their beginnings."""
    at_rest = np.zeros(len(time), bool)
    ends = [*(t for t, _ in poses[1:]), float(time[-1])]
    for (begin, name), end in zip(poses, ends, strict=False):
        if name == REST:
            at_rest |= (time > begin + _SETTLED * (end - begin)) & (time < end)
    at_rest &= np.isfinite(ohm).all(axis=1)
    return np.median(ohm[at_rest], axis=0) if at_rest.sum() > 5 else None
