"""Simulated calibration sessions, written at once, with the same files as recorded sessions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..calibration.options import BoardOptions, MeasureOptions
from ..calibration.protocol import check_settling
from ..calibration.readings import BendingSpecimen
from ..calibration.session import CHANNELS, CalibrationSession, create_session
from ..capture.readout.recording import Recorder
from ..capture.readout.source import Event, StampedSample
from ..core.arrays import Float
from ..sensing.serial_frames import PROTOCOL, Info, Sample
from ..sensing.voltage_divider import Dividers
from .electronics.cords import CordTraits, SpecimenTwin
from .electronics.readout_board import ReadoutTwin

AVERAGES = 64  # of a ten-bit converter, whose steps would show in single readings
CHECK_INTERVAL_S = 1.0  # between checks whether the readings have settled
RATE_HZ = 10
_DEFAULT_READINGS, _PAPER_SPECIMEN = MeasureOptions(), BendingSpecimen()


def record_twin(
    folder: Path,
    traits: CordTraits,
    options: MeasureOptions = _DEFAULT_READINGS,
    specimen: BendingSpecimen = _PAPER_SPECIMEN,
    *,
    misplaced: float = 0.0,
) -> CalibrationSession:
    """Record a whole calibration session on a simulated specimen.

    Args:
        folder: Folder of the session.
        traits: Properties of the cord.
        options: Which readings are taken. The seed is that of the pieces of cord and their noise,
            too.
        specimen: The specimen and its jigs.
        misplaced: Standard deviation of the cords' heights, mm.

    Returns:
        The session.

    Raises:
        CalibrationError: The folder has a session, or the radii are not valid.
        StorageError: The session cannot be written.
    """
    rng, geometry = np.random.default_rng(options.seed), specimen.geometry
    twin = SpecimenTwin(
        traits, rng, specimen.length, geometry.thickness, geometry.offset, misplaced
    )
    board_options = BoardOptions(rate=RATE_HZ, average=AVERAGES)
    session = create_session(folder, specimen, options, board_options)
    dividers = Dividers(np.array(session.reference), ReadoutTwin.full_scale)
    count = len(CHANNELS)
    with Recorder(session.frames, count) as recorder:
        board = _Board(twin, dividers, recorder)
        info = Info(PROTOCOL, (1, 0), 0, count, AVERAGES, RATE_HZ, 0, count, ReadoutTwin.full_scale)
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

    def __init__(self, specimen: SpecimenTwin, dividers: Dividers, recorder: Recorder) -> None:
        self._cords, self._dividers, self._recorder = specimen.cords, dividers, recorder
        self._counter = 0

    def note(self, kind: str, **data: object) -> None:
        """Record an event."""
        self._recorder.add(Event(int(self._cords.time * 1e9), kind, data))

    def measure(self, duration: float) -> tuple[Float, Float]:
        """Record samples for a duration, s; return times (t,) s and resistances (t, 3) ohm."""
        start = self._cords.time
        time, ohm = self._cords.measure(duration, RATE_HZ)
        times = start + time
        sums = np.round(self._dividers.counts(ohm) * AVERAGES).astype(int)
        for t, row in zip(times, sums, strict=True):
            us = int(t * 1e6)
            values = tuple(map(int, row))
            sample = Sample(self._counter, us % (1 << 32), False, False, AVERAGES, values)
            self._recorder.add(StampedSample(int(t * 1e9), us, sample))
            self._counter += 1
        return times, self._dividers.resistance(sums / AVERAGES)
