"""Readings of a calibration session, computed from its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.readout.recording import read_recording
from ..core.errors import CalibrationError
from .protocol import Creep, check_settling, fit_creep
from .readings import Memory, Piece, Readings
from .session import CHANNELS, find_holds, load_session

_MAX_CREEP_FRAMES = 400  # of a fit; longer holds are thinned
_COLUMNS = ("piece", "strain", "memory", "radius", "turn", "resistance")


@dataclass(frozen=True)
class SessionReadings:
    """Readings of a session.

    Attributes:
        readings: The readings.
        creeps: Creep of each outer cord in each hold.
        unsettled: Number of holds that had not settled when they were taken.
    """

    readings: Readings
    creeps: tuple[Creep, ...]
    unsettled: int


def read_session(folder: Path) -> SessionReadings:
    """Compute the readings that a session has so far.

    Args:
        folder: Folder of the session.

    Returns:
        The readings.

    Raises:
        CalibrationError: The session is invalid, or has no reading.
    """
    session = load_session(folder)
    if not session.frames.exists():
        raise CalibrationError(
            "nothing was recorded yet",
            code="nothing-recorded",
            where=folder,
            action="Record with 'defsense calibrate record'",
        )
    holds = find_holds(session, read_recording(session.frames))
    if not holds:
        raise CalibrationError(
            "no step was finished yet",
            code="no-step-finished",
            where=folder,
            action="Resume with 'defsense calibrate record'",
        )
    pieces = tuple(Piece(session.name, place, place == "neutral") for place in CHANNELS)
    rows, creeps, unsettled = [], [], 0
    memories = [Memory() for _ in CHANNELS]
    for n, hold in holds.items():  # in the order in which they were finished
        step = session.steps[n]
        state = check_settling(hold.time, hold.ohm, session.criterion)
        if state is None:
            unsettled += 1
            continue
        unsettled += not hold.settled
        radius = float("nan") if step.radius is None else step.radius
        face_sign = 1 if step.face == "a" else -1
        for c, side in enumerate(CHANNELS.values()):
            strain = session.geometry.strain(radius, side * face_sign)
            where = f"{folder.name}, round {step.turn + 1}, {step.jig}, face {step.face}"
            memory = memories[c].at(strain, hold.started_at, hold.started_at + hold.time[-1])
            rows.append((c, strain, memory, radius, step.turn, float(state.ohm[c]), where))
        if step.radius is not None:
            thinned = slice(None, None, max(len(hold.time) // _MAX_CREEP_FRAMES, 1))
            for c, place in enumerate(CHANNELS):
                if place != "neutral" and np.isfinite(hold.ohm[:, c]).all():
                    creeps.append(fit_creep(hold.time[thinned], hold.ohm[thinned, c]))
    return SessionReadings(_to_readings(pieces, rows), tuple(creeps), unsettled)


def _to_readings(pieces: tuple[Piece, ...], rows: Sequence[tuple[Any, ...]]) -> Readings:
    """Convert rows of piece, strain, memory, radius, turn, resistance and where."""
    columns = dict(zip((*_COLUMNS, "where"), zip(*rows, strict=True), strict=True))
    arrays = {name: np.array(columns[name]) for name in _COLUMNS}
    return Readings(pieces=pieces, where=columns["where"], **arrays)
