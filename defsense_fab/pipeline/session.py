"""A calibration session: a folder with what was to be measured, and every frame that came.

`session.json` holds the specimen and the plan, `frames.csv` the frames and, between them, when each
hold began and ended. Readings are taken from the frames anew each time.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.memory import Memory
from ..calibration.plan import Step, plan
from ..calibration.readings import Geometry, Piece, Readings
from ..calibration.settling import Creep, Criterion, creep, settled
from ..capture.recording import Recording, read_recording
from ..core.arrays import Float
from ..core.errors import CalibrationError
from ..core.files import load_json, storage_errors, write_json
from ..sensing.readout import Dividers

FILE, FRAMES = "session.json", "frames.csv"
#: Cords of a specimen in the order of the board's channels, and their side of the neutral plane
#: with face a on the jig.
CHANNELS = {"bottom": -1, "neutral": 0, "top": 1}
#: Between creeps' fits, at most so many frames.
_FITTED = 400
_COLUMNS = ("piece", "strain", "memory", "radius", "turn", "resistance")


@dataclass(frozen=True)
class Session:
    """What `session.json` says. `reference` (c,) ohm, of the dividers."""

    folder: Path
    name: str
    geometry: Geometry
    length: float
    steps: tuple[Step, ...]
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
) -> Session:
    """Begin a session in a folder that holds none. Raises CalibrationError if it does."""
    if (folder / FILE).exists():
        raise CalibrationError(f"{folder}: holds a session already; choose another folder")
    steps = plan(radii, rounds, faces, np.random.default_rng(seed))
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_json(
            folder / FILE,
            {
                "schema": 1,
                "specimen": {"name": name, "length": length, **asdict(geometry)},
                "channels": list(CHANNELS),
                "steps": [[s.turn, s.radius, s.face] for s in steps],
                "seed": seed,
                "reference": list(reference),
                "criterion": asdict(criterion),
                "rate": rate,
                "average": average,
                "begun": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
            },
        )
    return load(folder)


def load(folder: Path) -> Session:
    """The session in a folder. Raises CalibrationError where there is none, or it is broken."""
    path = folder / FILE
    data = load_json(path, CalibrationError, "'defsense calibrate record' makes sessions")
    try:
        specimen = dict(data["specimen"])
        name, length = str(specimen.pop("name")), float(specimen.pop("length"))
        steps = tuple(Step(int(t), None if r is None else float(r), f) for t, r, f in data["steps"])
        if data["schema"] != 1 or data["channels"] != list(CHANNELS):
            raise CalibrationError(f"{path}: was written by another version")
        return Session(
            folder, name, Geometry(**specimen), length, steps, tuple(data["reference"]),
            Criterion(**data["criterion"]), int(data["rate"]), data["average"],
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"{path}: not a session: {error!r}") from None


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


def holds(session: Session, recording: Recording) -> dict[int, Hold]:
    """The finished steps by index, each as it was measured last; skipped ones are left out."""
    about = next((e for _, e in recording.events if "full_scale" in e), None)
    out: dict[int, Hold] = {}
    begun: dict[int, int] = {}
    for at, event in recording.events:
        kind, step = event.get("event"), int(event.get("step", -1))
        if kind == "hold":
            begun[step] = at
        elif kind in ("skip", "redo"):
            out.pop(step, None)
        elif kind == "point" and step in begun and about is not None:
            part = slice(begun[step], at)
            if at - begun[step] < 2:
                continue
            device = recording.device_us[part]
            dividers = Dividers(np.array(session.reference), float(about["full_scale"]))
            ohm = dividers.resistance(recording.counts[part])
            still = bool(event.get("settled", True))
            out[step] = Hold(step, device[0] / 1e6, (device - device[0]) / 1e6, ohm, still)
    return out


def finished(session: Session, recording: Recording | None) -> set[int]:
    """Steps that need nothing more: measured, or skipped."""
    out: set[int] = set()
    for _, event in recording.events if recording else ():
        if event.get("event") in ("point", "skip"):
            out.add(event["step"])
        elif event.get("event") == "redo":
            out.discard(event["step"])
    return out


def unfinished(session: Session) -> list[int]:
    """Steps that are still to be measured."""
    recording = read_recording(session.frames) if session.frames.exists() else None
    done = finished(session, recording)
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
        inner = float(data["channels"]["inner"])
        return {
            "length": float(data["length"]),
            "geometry": Geometry(float(data["thickness"]), inner),
            "radii": radii,
        }
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"{file}: describes no specimen: {error!r}") from None
