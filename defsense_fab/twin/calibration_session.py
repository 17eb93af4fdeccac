"""Simulated calibration sessions, written at once, with the same files as recorded sessions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..calibration import session as sessions
from ..calibration.protocol import check_settling
from ..calibration.readings import Geometry
from ..calibration.session import CalibrationSession
from ..capture.readout.recording import Recorder
from ..capture.readout.source import Event, StampedSample
from ..core.arrays import Float
from ..core.response import JIG_RADII_MM
from ..core.storage.session_manifest import Criterion
from ..sensing.serial_frames import PROTOCOL, Info, Sample
from ..sensing.voltage_divider import Dividers
from .electronics.cords import CordTraits, SpecimenTwin
from .electronics.readout_board import ReadoutTwin

AVERAGES = 64  # of a ten-bit converter, whose steps would show in single readings
CHECK_INTERVAL_S = 1.0  # between checks whether the readings have settled
REFERENCE_OHM = 2200.0


def record_twin(
    folder: Path,
    traits: CordTraits,
    *,
    seed: int,
    length: float = 150.0,
    geometry: Geometry | None = None,
    radii: Sequence[float] = JIG_RADII_MM,
    rounds: int = 3,
    faces: Sequence[str] = ("a", "b"),
    rate: int = 10,
    misplaced: float = 0.0,
    criterion: Criterion | None = None,
) -> CalibrationSession:
    """Record a whole calibration session on a simulated specimen.

    Args:
        folder: Folder of the session.
        traits: Properties of the cord.
        seed: Seed of the pieces of cord and their noise.
        length: Length of the specimen, mm.
        geometry: Geometry of the specimen.
        radii: Surface radii of the jigs, mm.
        rounds: Number of rounds through the jigs.
        faces: Faces of the specimen that are placed down.
        rate: Sample rate, Hz.
        misplaced: Standard deviation of the cords' heights, mm.
        criterion: When readings have settled.

    Returns:
        The session.
    """
    geometry = geometry or Geometry()
    rng = np.random.default_rng(seed)
    twin = SpecimenTwin(traits, rng, length, geometry.thickness, geometry.offset, misplaced)
    session = sessions.create_session(
        folder,
        name=f"{length:g}",
        geometry=geometry,
        length=length,
        radii=radii,
        rounds=rounds,
        faces=faces,
        seed=seed,
        reference=[REFERENCE_OHM] * 3,
        criterion=criterion or Criterion(),
        rate=rate,
        average=AVERAGES,
    )
    dividers = Dividers(np.array(session.reference), ReadoutTwin.full_scale)
    with Recorder(session.frames, 3) as recorder:
        board = _Board(twin, dividers, recorder, rate)
        info = Info(PROTOCOL, (1, 0), 0, 3, AVERAGES, rate, 0, 3, ReadoutTwin.full_scale)
        board.note("start", **vars(info))
        for n, step in enumerate(session.steps):
            twin.place(step.radius, step.face)
            board.note("hold", step=n)
            times, ohms = np.zeros(0), np.zeros((0, 3))
            while True:
                time, ohm = board.measure(CHECK_INTERVAL_S)
                times, ohms = np.append(times, time), np.append(ohms, ohm, axis=0)
                hold = check_settling(times - times[0], ohms, session.criterion)
                if hold is not None and (hold.is_settled or hold.is_timed_out):
                    break
            board.note("point", step=n, settled=hold.is_settled)
    return session


class _Board:
    """Records the readings of a specimen's cords by their own time."""

    def __init__(
        self, specimen: SpecimenTwin, dividers: Dividers, recorder: Recorder, rate: int
    ) -> None:
        self._cords, self._dividers, self._recorder = specimen.cords, dividers, recorder
        self._rate, self._counter = rate, 0

    def note(self, kind: str, **data: object) -> None:
        """Record an event."""
        self._recorder.add(Event(int(self._cords.time * 1e9), kind, data))

    def measure(self, duration: float) -> tuple[Float, Float]:
        """Record samples for a duration, s; return times (t,) s and resistances (t, 3) ohm."""
        start = self._cords.time
        time, ohm = self._cords.measure(duration, self._rate)
        times = start + time
        sums = np.round(self._dividers.counts(ohm) * AVERAGES).astype(int)
        for t, row in zip(times, sums, strict=True):
            us = int(t * 1e6)
            values = tuple(map(int, row))
            sample = Sample(self._counter, us % (1 << 32), False, False, AVERAGES, values)
            self._recorder.add(StampedSample(int(t * 1e9), us, sample))
            self._counter += 1
        return times, self._dividers.resistance(sums / AVERAGES)
