"""Calibration sessions: a folder with the plan of the readings and every frame that was recorded.

`session.json` holds the specimen and the plan. `frames.csv` holds the frames and, between them, the
events at which each hold started and ended. Readings are always computed from the frames.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.readout.recording import Recording, has_frames, read_recording
from ..core.arrays import Float
from ..core.errors import CalibrationError
from ..core.storage import typed_json
from ..core.storage.files import load_json, storage_errors
from ..core.storage.session_manifest import (
    FILE,
    CalibrationManifest,
    Criterion,
    SpecimenRecord,
    load_calibration,
    manifest_path,
)
from .protocol import FACES, JigStep, plan_readings
from .readings import Geometry

FRAMES = "frames.csv"
DEFAULT_REFERENCE_OHM = 2200.0
DEFAULT_ROUNDS, DEFAULT_RATE_HZ = 3, 20
#: Cords of a specimen in the order of the read-out board's channels, and their side of the neutral
#: plane with face a on the jig.
CHANNELS = {"bottom": -1, "neutral": 0, "top": 1}
_MAX_RADIUS_MM = 1e5
_MAX_REFERENCE_OHM = 1e9


@dataclass(frozen=True)
class CalibrationSession:
    """A calibration session, as in `session.json`.

    Attributes:
        folder: Folder of the session.
        name: Name of the specimen.
        geometry: Geometry of the specimen.
        length: Length of the specimen, mm.
        steps: Steps of the protocol.
        reference: Reference resistors (c,), ohm.
        criterion: When a reading has settled.
        rate: Samples per second, Hz.
        average: Conversions per sample; None for the read-out board's own number.
    """

    folder: Path
    name: str
    geometry: Geometry
    length: float
    steps: tuple[JigStep, ...]
    reference: tuple[float, ...]
    criterion: Criterion
    rate: int
    average: int | None

    @property
    def frames(self) -> Path:
        """File of the frames."""
        return self.folder / FRAMES


def create_session(
    folder: Path,
    *,
    name: str,
    geometry: Geometry,
    length: float,
    radii: Sequence[float],
    rounds: int,
    faces: Sequence[str],
    seed: int,
    reference: Sequence[float],
    criterion: Criterion,
    rate: int,
    average: int | None,
) -> CalibrationSession:
    """Create a session in a folder that has none.

    Args:
        folder: Folder, which need not exist.
        name: Name of the specimen.
        geometry: Geometry of the specimen.
        length: Length of the specimen, mm.
        radii: Radii of the jigs, mm.
        rounds: Number of rounds.
        faces: Faces of the specimen to measure.
        seed: Seed of the order of the jigs.
        reference: Reference resistors (c,), ohm.
        criterion: When a reading has settled.
        rate: Samples per second, Hz.
        average: Conversions per sample; None for the read-out board's own number.

    Returns:
        The session.

    Raises:
        CalibrationError: The folder has a session.
        StorageError: The folder cannot be written.
    """
    if (folder / FILE).exists():
        raise CalibrationError(
            "already has a session",
            code="session-exists",
            where=folder,
            action="Choose another folder",
        )
    steps = plan_readings(radii, rounds, faces, np.random.default_rng(seed))
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        manifest = CalibrationManifest(
            specimen=SpecimenRecord(name, length, geometry.thickness, geometry.offset),
            channels=tuple(CHANNELS),
            steps=tuple((s.turn, s.radius, s.face) for s in steps),
            seed=seed,
            reference=tuple(reference),
            criterion=criterion,
            rate=rate,
            average=average,
            begun=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        )
        typed_json.save(folder / FILE, manifest)
    return load_session(folder)


def require_same_settings(session: CalibrationSession, settings: Mapping[str, Any]) -> None:
    """Check that a session that is resumed has the requested settings.

    Args:
        session: The session.
        settings: Requested settings by the names of `create_session`'s arguments.

    Raises:
        CalibrationError: A setting differs.
    """
    steps = session.steps
    current = {
        "name": session.name,
        "radii": sorted({s.radius for s in steps if s.radius is not None}),
        "rounds": 1 + max(s.turn for s in steps),
        "faces": sorted({s.face for s in steps}),
        "seed": load_calibration(session.folder).seed,
        "reference": list(session.reference),
        "criterion": session.criterion,
        "rate": session.rate,
        "average": session.average,
    }
    for name, value in settings.items():
        if (sorted(value) if name in ("radii", "faces") else value) != current[name]:
            raise CalibrationError(
                f"this session was started with {name} = {current[name]}",
                code="session-differs",
                where=session.folder,
                action=f"Omit {name} to resume it, or start another session in another folder",
                setting=name,
                value=current[name],
            )


def create_or_resume(
    folder: Path, settings: Mapping[str, Any], named: Collection[str] = ()
) -> tuple[CalibrationSession, bool]:
    """Resume the session in a folder, or create one.

    Args:
        folder: Folder of the session.
        settings: Settings of a new session, by the names of `create_session`'s arguments.
        named: Names of settings that a resumed session must have, too.

    Returns:
        The session, and whether it is resumed.

    Raises:
        CalibrationError: The session is finished or differs.
    """
    if manifest_path(folder) is None:
        return create_session(folder, **settings), False
    session = load_session(folder)
    if not unfinished_steps(session):
        raise CalibrationError(
            "this session is finished",
            code="session-finished",
            where=folder,
            action=(
                f"Fit it with 'defsense calibrate fit {folder}', or start another session in"
                " another folder"
            ),
        )
    require_same_settings(session, {name: settings[name] for name in named})
    return session, True


def default_settings(specimen: Mapping[str, Any]) -> dict[str, Any]:
    """Return the default settings of a session on a specimen, as `read_specimen` returns it."""
    return {
        "name": f"{specimen['length']:g}",
        "geometry": specimen["geometry"],
        "length": specimen["length"],
        "radii": specimen["radii"],
        "rounds": DEFAULT_ROUNDS,
        "faces": ["a", "b"],
        "seed": 1,
        "reference": [DEFAULT_REFERENCE_OHM] * len(CHANNELS),
        "criterion": Criterion(),
        "rate": DEFAULT_RATE_HZ,
        "average": None,
    }


def discard_empty(session: CalibrationSession) -> None:
    """Remove a session without frames: it could not start, and must not determine the next."""
    if session.frames.exists() and has_frames(session.frames):
        return
    session.frames.unlink(missing_ok=True)
    (session.folder / FILE).unlink(missing_ok=True)


def load_session(folder: Path) -> CalibrationSession:
    """Load the session in a folder.

    Raises:
        CalibrationError: There is none, or it is invalid.
    """
    path, manifest = folder / FILE, load_calibration(folder)
    if manifest.channels != tuple(CHANNELS):
        raise CalibrationError(
            f"its channels are {', '.join(manifest.channels)}",
            code="wrong-channels",
            where=path,
            action=f"Name them {', '.join(CHANNELS)}",
        )
    for _, radius, face in manifest.steps:
        if face not in FACES or not (radius is None or 0 < radius < _MAX_RADIUS_MM):
            raise CalibrationError(
                f"the step with the radius {radius} and the face {face!r} is not valid",
                code="bad-step",
                where=path,
                action=f"Give a radius in mm or null, and a face of {', '.join(FACES)}",
            )
    if len(manifest.reference) != len(CHANNELS) or not all(
        0 < r < _MAX_REFERENCE_OHM for r in manifest.reference
    ):
        raise CalibrationError(
            f"reference is {list(manifest.reference)}",
            code="bad-reference",
            where=path,
            action=f"Give {len(CHANNELS)} resistances in ohm",
        )
    specimen = manifest.specimen
    return CalibrationSession(
        folder=folder,
        name=specimen.name,
        geometry=Geometry(specimen.thickness, specimen.offset),
        length=specimen.length,
        steps=tuple(JigStep(*s) for s in manifest.steps),
        reference=manifest.reference,
        criterion=manifest.criterion,
        rate=manifest.rate,
        average=manifest.average,
    )


@dataclass(frozen=True)
class Hold:
    """Frames of one finished step.

    Attributes:
        step: Index of the step in the plan.
        started_at: Start of the hold by the device's clock, s.
        time: Times of the frames since then (t,), s.
        ohm: Resistances (t, c), ohm.
        settled: Whether the reading had settled when it was taken.
    """

    step: int
    started_at: float
    time: Float
    ohm: Float
    settled: bool


def find_holds(session: CalibrationSession, recording: Recording) -> dict[int, Hold]:
    """Find the finished steps in a recording.

    Args:
        session: The session.
        recording: Its frames.

    Returns:
        The hold of each finished step by its index, as it was measured last.

    Raises:
        CalibrationError: An event does not belong to the session.
        CaptureError: No event gives the read-out board's full scale.
    """
    out: dict[int, Hold] = {}
    starts: dict[int, int] = {}
    time, reference = _frame_times(recording), np.array(session.reference)
    for at, event in recording.events:
        kind, step = event.get("event"), event.get("step", -1)
        try:
            if kind in ("hold", "point", "redo") and not 0 <= step < len(session.steps):
                raise ValueError
        except (TypeError, ValueError):
            raise CalibrationError(
                f"the event {event} does not belong to the session in {FILE}",
                code="event-mismatch",
                where=session.frames,
                action="Restore both files from the same session",
            ) from None
        if kind == "hold":
            starts[step] = at
        elif kind == "redo":
            out.pop(step, None)
        elif kind == "point" and step in starts and at - starts[step] > 1:
            part = slice(starts[step], at)
            ohm = recording.resistances(reference, part)
            start = float(time[starts[step]])
            is_settled = bool(event.get("settled", True))
            out[step] = Hold(step, start, time[part] - start, ohm, is_settled)
    return out


def _frame_times(recording: Recording) -> Float:
    """Return the time of each frame (t,), s.

    It is the device's clock, continued over the pauses between runs by the time of day in their
    events.
    """
    out = recording.device_us / 1e6
    last, shift = None, 0.0
    for at, event in recording.events:
        day = event.get("at")
        if event.get("event") == "start" and 0 < at < len(out):
            pause = max(day - last, 0.0) if day is not None and last is not None else 0.0
            shift = out[at - 1] + pause - recording.device_us[at] / 1e6
            out[at:] = recording.device_us[at:] / 1e6 + shift
        last = day if day is not None else last
    return np.asarray(out)


def unfinished_steps(session: CalibrationSession) -> list[int]:
    """Return the steps that are still to be measured, skipped ones included."""
    frames = session.frames
    done = find_holds(session, read_recording(frames)) if frames.exists() else {}
    return [n for n in range(len(session.steps)) if n not in done]


def read_specimen(path: Path) -> dict[str, Any]:
    """Read `specimen.json`.

    Args:
        path: The file, or the folder that holds it.

    Returns:
        The specimen's "length" (mm), "geometry" and "radii" of its jigs (mm).

    Raises:
        CalibrationError: The file cannot be read or is invalid.
    """
    action = "Write it with 'defsense calibrate specimen'"
    file = path / "specimen.json" if path.is_dir() else path
    data = load_json(file, CalibrationError, action)
    try:
        radii = [float(j["radius"]) for j in data["jigs"] if j["radius"] is not None]
        if not all(0 < r < _MAX_RADIUS_MM for r in radii) or len(set(radii)) < len(radii):
            raise ValueError(f"radii {radii}")
        inner = float(data["channels"]["inner"])
        return {
            "length": float(data["length"]),
            "geometry": Geometry(float(data["thickness"]), inner),
            "radii": radii,
        }
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f"does not describe a specimen ({error!r})",
            code="bad-specimen-file",
            where=file,
            action=action,
        ) from None
