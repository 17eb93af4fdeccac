"""Calibration sessions of a twin, without waiting for them: the same files as recorded ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..calibration import session as sessions
from ..core.storage.session_manifest import Criterion
from ..calibration.protocol import settled
from ..calibration.readings import Geometry
from ..calibration.session import CalibrationSession
from ..capture.readout.recording import Recorder
from ..capture.readout.source import Event, StampedSample
from ..core.response import JIG_RADII_MM
from ..sensing.serial_frames import PROTOCOL, Info, Sample
from ..sensing.voltage_divider import Dividers
from .electronics.cords import CordTraits, SpecimenTwin
from .electronics.readout_board import ReadoutTwin

#: Averages of a converter of ten bits; its steps show in single readings.
_AVERAGE = 64
_LOOK = 1.0  # s between looks whether a hold has settled
_REFERENCE = 2200.0


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
    """A whole session on a new specimen of `length` mm with new pieces of a cord of these traits,
    at `rate` Hz; `misplaced` mm is the standard deviation of the cords' heights."""
    geometry = geometry or Geometry()
    rng = np.random.default_rng(seed)
    twin = SpecimenTwin(traits, rng, length, geometry.thickness, geometry.offset, misplaced)
    session = sessions.create(
        folder,
        name=f"{length:g}",
        geometry=geometry,
        length=length,
        radii=radii,
        rounds=rounds,
        faces=faces,
        seed=seed,
        reference=[_REFERENCE] * 3,
        criterion=criterion or Criterion(),
        rate=rate,
        average=_AVERAGE,
    )
    dividers = Dividers(np.array(session.reference), ReadoutTwin.full_scale)
    counter, cords = 0, twin.cords
    with Recorder(session.frames, 3) as recorder:

        def note(kind: str, **data: object) -> None:
            recorder.add(Event(int(cords.time * 1e9), kind, data))

        about = Info(PROTOCOL, (1, 0), 0, 3, _AVERAGE, rate, 0, 3, ReadoutTwin.full_scale)
        note("start", **vars(about))
        for n, step in enumerate(session.steps):
            twin.place(step.radius, step.face)
            note("hold", step=n)
            times, ohms = np.zeros(0), np.zeros((0, 3))
            while True:
                begun = cords.time
                time, ohm = cords.measure(_LOOK, rate)
                sums = np.round(dividers.counts(ohm) * _AVERAGE).astype(int)
                for t, row in zip(begun + time, sums, strict=True):
                    micros = int(t * 1e6)
                    sample = Sample(
                        counter, micros % (1 << 32), False, False, _AVERAGE, tuple(map(int, row))
                    )
                    recorder.add(StampedSample(int(t * 1e9), micros, sample))
                    counter += 1
                times = np.append(times, begun + time)
                ohms = np.append(ohms, dividers.resistance(sums / _AVERAGE), axis=0)
                at = settled(times - times[0], ohms, session.criterion)
                if at is not None and (at.still or at.over):
                    break
            note("point", step=n, settled=at.still)
    return session
