"""Calibration sessions: a folder with the plan of the readings and every frame that was recorded.

`session.json` holds the specimen and the plan. `frames.csv` holds the frames and, between them, the
events at which each hold started and ended. Readings are always computed from the frames.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..capture.readout.recording import Recording, has_frames, read_recording
from ..core.arrays import Float
from ..core.errors import CalibrationError
from ..core.schema.options import options_of
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
from ..sensing.voltage_divider import reference_resistors
from .options import BoardOptions, MeasureOptions
from .protocol import FACES, JigStep, plan_readings
from .readings import MIN_RADII, BendingSpecimen, Geometry

FRAMES = "frames.csv"
#: Cords of a specimen in the order of the read-out board's channels, and their side of the neutral
#: plane with face a on the jig.
CHANNELS = {"bottom": -1, "neutral": 0, "top": 1}
_MAX_RADIUS_MM = 1e5
_MAX_REFERENCE_OHM = 1e9
_DEFAULT_READINGS, _DEFAULT_BOARD = MeasureOptions(), BoardOptions()


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
    specimen: BendingSpecimen,
    options: MeasureOptions = _DEFAULT_READINGS,
    board: BoardOptions = _DEFAULT_BOARD,
) -> CalibrationSession:
    """Create a session in a folder that has none.

    Args:
        folder: Folder, which need not exist.
        specimen: The specimen and its jigs.
        options: Which readings are taken.
        board: How the read-out board measures.

    Returns:
        The session.

    Raises:
        CalibrationError: The folder has a session, or the radii are not valid.
        CaptureError: The reference resistors are neither one nor one per channel.
        StorageError: The folder cannot be written.
    """
    if (folder / FILE).exists():
        raise CalibrationError(
            "already has a session",
            code="session-exists",
            where=folder,
            action="Choose another folder",
            path=folder,
        )
    radii = _choose_radii(specimen, options)
    rng = np.random.default_rng(options.seed)
    steps = plan_readings(radii, options.rounds, list(options.faces), rng)
    geometry, name = specimen.geometry, options.name or f"{specimen.length:g}"
    manifest = CalibrationManifest(
        specimen=SpecimenRecord(name, specimen.length, geometry.thickness, geometry.offset),
        channels=tuple(CHANNELS),
        steps=tuple((s.turn, s.radius, s.face) for s in steps),
        seed=options.seed,
        reference=tuple(reference_resistors(board.reference, len(CHANNELS))),
        criterion=options.criterion,
        rate=board.rate,
        average=board.average,
        begun=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    )
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        typed_json.save(folder / FILE, manifest)
    return load_session(folder)


def _choose_radii(specimen: BendingSpecimen, options: MeasureOptions) -> tuple[float, ...]:
    """Return the radii of the jigs to use, mm."""
    radii = specimen.radii if options.radii is None else options.radii
    unknown = [r for r in radii if r not in specimen.radii]
    if unknown:
        available = ", ".join(f"{r:g}" for r in specimen.radii)
        raise CalibrationError(
            f"{unknown[0]:g} is not the radius of one of the specimen's jigs",
            code="unknown-radius",
            where="radii",
            action=f"Choose from {available}",
            radius=unknown[0],
        )
    count = len(set(radii))
    if count < max(len(radii), MIN_RADII):
        raise CalibrationError(
            f"{count} different radii are too few",
            code="too-few-radii",
            where="radii",
            action=f"Give {MIN_RADII} different radii or more",
            count=count,
        )
    return radii


def require_same_options(
    session: CalibrationSession, options: MeasureOptions, board: BoardOptions
) -> None:
    """Check that a session that is resumed has the requested options.

    Options with their default value are not compared.

    Args:
        session: The session.
        options: Requested readings.
        board: Requested settings of the read-out board.

    Raises:
        CalibrationError: An option differs.
    """
    steps = session.steps
    present = {
        "name": session.name,
        "rounds": 1 + max(s.turn for s in steps),
        "radii": tuple(sorted({s.radius for s in steps if s.radius is not None})),
        "faces": "".join(sorted({s.face for s in steps})),
        "tolerance": round(100 * session.criterion.tolerance, 9),
        "longest": session.criterion.most,
        "seed": load_calibration(session.folder).seed,
        "reference": session.reference,
        "rate": session.rate,
        "average": session.average,
    }
    for record in (options, board):
        kind: type = type(record)
        for name, option in options_of(kind).items():
            value = getattr(record, name)
            if value == option.default:
                continue
            if name == "radii":
                value = tuple(sorted(value))
            elif name == "reference":
                value = tuple(reference_resistors(value, len(CHANNELS)))
            if value != present[name]:
                raise CalibrationError(
                    f"this session was started with {name} = {present[name]}",
                    code="session-differs",
                    where=session.folder,
                    action=f"Omit {name} to resume it, or start another session in another folder",
                    setting=name,
                    value=present[name],
                )


def create_or_resume(
    folder: Path, specimen: BendingSpecimen, options: MeasureOptions, board: BoardOptions
) -> tuple[CalibrationSession, bool]:
    """Resume the session in a folder, or create one.

    Args:
        folder: Folder of the session.
        specimen: The specimen and its jigs.
        options: Which readings are taken.
        board: How the read-out board measures.

    Returns:
        The session, and whether it is resumed.

    Raises:
        CalibrationError: The session is finished or differs, or the radii are not valid.
    """
    if manifest_path(folder) is None:
        return create_session(folder, specimen, options, board), False
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
    require_same_options(session, options, board)
    return session, True


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
                code="step-invalid",
                where=path,
                action=f"Give a radius in mm or null, and a face of {', '.join(FACES)}",
            )
    if len(manifest.reference) != len(CHANNELS) or not all(
        0 < r < _MAX_REFERENCE_OHM for r in manifest.reference
    ):
        raise CalibrationError(
            f"reference is {list(manifest.reference)}",
            code="reference-invalid",
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


def read_specimen(path: Path) -> BendingSpecimen:
    """Read `specimen.json`.

    Args:
        path: The file, or the folder that holds it.

    Returns:
        The specimen and its jigs.

    Raises:
        CalibrationError: The file cannot be read or is invalid.
    """
    action = "Write it with 'defsense calibrate specimen'"
    file = path / "specimen.json" if path.is_dir() else path
    data = load_json(file, CalibrationError, action)
    try:
        radii = tuple(float(j["radius"]) for j in data["jigs"] if j["radius"] is not None)
        if not all(0 < r < _MAX_RADIUS_MM for r in radii) or len(set(radii)) < len(radii):
            raise ValueError(f"radii {radii}")
        geometry = Geometry(float(data["thickness"]), float(data["channels"]["inner"]))
        return BendingSpecimen(float(data["length"]), geometry, radii)
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f"does not describe a specimen ({error!r})",
            code="specimen-file-invalid",
            where=file,
            action=action,
        ) from None
