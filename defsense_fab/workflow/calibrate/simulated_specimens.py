"""Simulate calibration sessions on bending specimens."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...calibration.readings import BendingSpecimen
from ...core.errors import CalibrationError
from ...core.progress import Progress, silent
from ...core.response import JIG_RADII_MM, ResponseSpec
from ...sensing.response import build_response
from ...twin.calibration_session import record_twin
from ...twin.electronics.cords import CordTraits
from .options import MeasureOptions, SimulatedSpecimenOptions

_DEFAULTS = SimulatedSpecimenOptions()
_MAX_STRAIN = 0.1  # of the response that the options describe
_SEED_STEP = 1000  # between the seeds of two calls: each specimen has its own seed


def simulate_specimens(
    folder: Path,
    options: SimulatedSpecimenOptions = _DEFAULTS,
    *,
    response: ResponseSpec | None = None,
    radii: Sequence[float] = JIG_RADII_MM,
    prefix: str = "session",
    progress: Progress = silent,
) -> list[Path]:
    """Record calibration sessions of simulated specimens of different lengths.

    Args:
        folder: Folder of the sessions.
        options: The specimens and the cord.
        response: Response of the cord; None for that of `options`.
        radii: Radii of the jigs, mm.
        prefix: Start of the names of the sessions, which the length in mm follows.
        progress: Called with the progress.

    Returns:
        Folders of the sessions.

    Raises:
        CalibrationError: A session exists already (`session-exists`); nothing is written then.
        StorageError: A session cannot be written.
    """
    o = options
    folders = [folder / f"{prefix}-{length:g}" for length in o.lengths]
    existing = next((f for f in folders if f.exists()), None)
    if existing is not None:
        raise CalibrationError(
            "exists already",
            code="session-exists",
            where=existing,
            action="Choose another folder, or delete it",
            path=existing,
        )
    if response is None:
        coefficients = {"k": o.k, "q": o.q}
        response = ResponseSpec("quadratic", coefficients, (-_MAX_STRAIN, _MAX_STRAIN))
    traits = CordTraits(
        build_response(response), o.noise, o.play, o.healing, o.time, o.spread, drift=o.drift
    )
    for n, (length, session) in enumerate(zip(o.lengths, folders, strict=True)):
        progress("specimen", n / len(folders), f"{length:g} mm long")
        readings = MeasureOptions(rounds=o.rounds, seed=_SEED_STEP * o.seed + n)
        specimen = BendingSpecimen(length, radii=tuple(radii))
        record_twin(session, traits, readings, specimen, misplaced=o.misplaced)
    progress("specimen", 1.0, "done")
    return folders
