"""A calibration session: a folder with what was to be measured, and every frame that came.

`session.json` holds the specimen and the plan, `frames.csv` the frames and, between them, when each
hold began and ended. Readings are taken from the frames anew each time.
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
    SpecimenRecord,
    load_calibration,
    manifest_path,
)
from .protocol import creep, Creep, FACES, JigStep, plan, settled
from ..core.storage.session_manifest import Criterion
from .readings import Geometry, Memory, Piece, Readings

FRAMES = "frames.csv"
REFERENCE = 2200.0  # ohm, of dividers that nothing tells
#: Cords of a specimen in the order of the read-out board's channels, and their side of the neutral
#: plane with face a on the jig.
CHANNELS = {"bottom": -1, "neutral": 0, "top": 1}
#: Between creeps' fits, at most so many frames.
_FITTED = 400
_COLUMNS = ("piece", "strain", "memory", "radius", "turn", "resistance")


@dataclass(frozen=True)
class CalibrationSession:
    """What `session.json` says. `reference` (c,) ohm, of the dividers."""

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
        return self.folder / FRAMES


def create(
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
    """Begin a session in a folder that holds none. Raises CalibrationError if it does."""
    if (folder / FILE).exists():
        raise CalibrationError(f"{folder}: holds a session already; choose another folder")
    steps = plan(radii, rounds, faces, np.random.default_rng(seed))
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
    return load(folder)


def agree(session: CalibrationSession, wanted: Mapping[str, Any]) -> None:
    """Raises CalibrationError where a session that goes on was begun with something else."""
    steps = session.steps
    begun = {
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
    for name, value in wanted.items():
        is_ = begun[name]
        if (sorted(value) if name in ("radii", "faces") else value) != is_:
            raise CalibrationError(
                f"{session.folder}: this session was begun with {name} {is_}, and goes on so; leave"
                " the option out, or begin another session with --out"
            )


def begin_or_go_on(
    folder: Path, wanted: Mapping[str, Any], named: Collection[str] = ()
) -> tuple[CalibrationSession, bool]:
    """The session in a folder, and whether it was there before: what was `named` of what is
    `wanted` of a new one must then be so. Raises CalibrationError for one that is finished or
    differs."""
    if manifest_path(folder) is None:
        return create(folder, **wanted), False
    session = load(folder)
    if not unfinished(session):
        raise CalibrationError(
            f"{folder}: this session is finished; fit it (defsense calibrate fit {folder}), or"
            " begin another with --out"
        )
    agree(session, {name: wanted[name] for name in named})
    return session, True


def usual(about: Mapping[str, Any]) -> dict[str, Any]:
    """What is wanted of a session on a specimen (`specimen_of`) where nothing else is said."""
    return {
        "name": f"{about['length']:g}",
        "geometry": about["geometry"],
        "length": about["length"],
        "radii": about["radii"],
        "rounds": 3,
        "faces": ["a", "b"],
        "seed": 1,
        "reference": [REFERENCE] * len(CHANNELS),
        "criterion": Criterion(),
        "rate": 20,
        "average": None,
    }


def discard_empty(session: CalibrationSession) -> None:
    """Remove a session that never saw a frame: it could not begin, and must not bind the next."""
    if session.frames.exists() and has_frames(session.frames):
        return
    session.frames.unlink(missing_ok=True)
    (session.folder / FILE).unlink(missing_ok=True)


def load(folder: Path) -> CalibrationSession:
    """The session in a folder. Raises CalibrationError where there is none, or it is broken."""
    path, found = folder / FILE, load_calibration(folder)
    if found.channels != tuple(CHANNELS):
        raise CalibrationError(f"{path}: its channels must be {', '.join(CHANNELS)}")
    if any(f not in FACES or not (r is None or 0 < r < 1e5) for _, r, f in found.steps):
        raise CalibrationError(
            f"{path}: a step is a round, a radius in mm or null, and a face of {', '.join(FACES)}"
        )
    if len(found.reference) != len(CHANNELS) or not all(0 < r < 1e9 for r in found.reference):
        raise CalibrationError(f"{path}: reference: {len(CHANNELS)} resistances in ohm are needed")
    specimen = found.specimen
    return CalibrationSession(
        folder, specimen.name, Geometry(specimen.thickness, specimen.offset), specimen.length,
        tuple(JigStep(*s) for s in found.steps), found.reference, found.criterion, found.rate,
        found.average,
    )  # fmt: skip


@dataclass(frozen=True)
class Hold:
    """One finished step: its index in the plan, when it was `begun`, s on the device's clock, times
    (t,) s since then, and resistances (t, c) ohm; whether the reading had `settled` when it was
    taken."""

    step: int
    begun: float
    time: Float
    ohm: Float
    settled: bool


def holds(session: CalibrationSession, recording: Recording) -> dict[int, Hold]:
    """The finished steps by index, each as it was measured last. Raises CalibrationError for events
    that the session cannot have, CaptureError where none tells the read-out board's full scale."""
    out: dict[int, Hold] = {}
    begun: dict[int, int] = {}
    time, reference = _time(recording), np.array(session.reference)
    for at, event in recording.events:
        kind, step = event.get("event"), event.get("step", -1)
        try:
            if kind in ("hold", "point", "redo") and not 0 <= step < len(session.steps):
                raise ValueError
        except (TypeError, ValueError):
            raise CalibrationError(
                f"{session.frames}: the event {event} does not belong to {FILE} beside it"
            ) from None
        if kind == "hold":
            begun[step] = at
        elif kind == "redo":
            out.pop(step, None)
        elif kind == "point" and step in begun and at - begun[step] > 1:
            part = slice(begun[step], at)
            ohm = recording.resistances(reference, part)
            start = float(time[begun[step]])
            still = bool(event.get("settled", True))
            out[step] = Hold(step, start, time[part] - start, ohm, still)
    return out


def _time(recording: Recording) -> Float:
    """Of each frame (t,), s: the device's clock, carried on over the stops between runs by the time
    of day that their events tell."""
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


def unfinished(session: CalibrationSession) -> list[int]:
    """Steps that are still to be measured, those that were skipped among them."""
    done = holds(session, read_recording(session.frames)) if session.frames.exists() else {}
    return [n for n in range(len(session.steps)) if n not in done]


@dataclass(frozen=True)
class Measured:
    """A session's readings; the outer cords' creep in each hold, with the cord's place; how many
    holds had not settled when they were taken."""

    readings: Readings
    creeps: tuple[tuple[str, Creep], ...]
    unsettled: int


def measure(folder: Path) -> Measured:
    """What a session has measured so far. Raises CalibrationError if that is nothing."""
    session = load(folder)
    if not session.frames.exists():
        raise CalibrationError(f"{folder}: nothing was recorded yet")
    found = holds(session, read_recording(session.frames))
    if not found:
        raise CalibrationError(f"{folder}: no step was finished yet; go on with 'record'")
    pieces = tuple(Piece(session.name, place, place == "neutral") for place in CHANNELS)
    rows, creeps, unsettled = [], [], 0
    memories = [Memory() for _ in CHANNELS]
    for n, hold in found.items():  # in the order in which they were finished
        step = session.steps[n]
        at = settled(hold.time, hold.ohm, session.criterion)
        if at is None:
            unsettled += 1
            continue
        unsettled += not hold.settled
        radius = float("nan") if step.radius is None else step.radius
        turn_over = 1 if step.face == "a" else -1
        for c, side in enumerate(CHANNELS.values()):
            strain = session.geometry.strain(radius, side * turn_over)
            where = f"{folder.name}, round {step.turn + 1}, {step.jig}, face {step.face}"
            memory = memories[c].at(strain, hold.begun, hold.begun + hold.time[-1])
            rows.append((c, strain, memory, radius, step.turn, float(at.ohm[c]), where))
        if step.radius is not None:
            thin = slice(None, None, max(len(hold.time) // _FITTED, 1))
            for c, place in enumerate(CHANNELS):
                if place != "neutral" and np.isfinite(hold.ohm[:, c]).all():
                    creeps.append((place, creep(hold.time[thin], hold.ohm[thin, c])))
    readings = _readings(pieces, rows)
    return Measured(readings, tuple(creeps), unsettled)


def _readings(pieces: tuple[Piece, ...], rows: Sequence[tuple[Any, ...]]) -> Readings:
    """Rows of piece, strain, memory, radius, turn, resistance and where."""
    columns = dict(zip((*_COLUMNS, "where"), zip(*rows, strict=True), strict=True))
    arrays = {name: np.array(columns[name]) for name in _COLUMNS}
    return Readings(pieces=pieces, where=columns["where"], **arrays)


def specimen_of(path: Path) -> dict[str, Any]:
    """`specimen.json`, or that of a folder, as `defsense calibrate specimen` writes it."""
    file = path / "specimen.json" if path.is_dir() else path
    data = load_json(file, CalibrationError, "'defsense calibrate specimen' writes it")
    try:
        radii = [float(j["radius"]) for j in data["jigs"] if j["radius"] is not None]
        if not all(0 < r < 1e5 for r in radii) or len(set(radii)) < len(radii):
            raise ValueError(f"radii {radii}")
        inner = float(data["channels"]["inner"])
        return {
            "length": float(data["length"]),
            "geometry": Geometry(float(data["thickness"]), inner),
            "radii": radii,
        }
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"{file}: describes no specimen: {error!r}") from None
