"""A capture session: a folder with a file for each of what the cameras and the read-out board saw.

`session.json` states what was to be recorded; `cameras.toml` and `markers.json` are copies of what
it was recorded with. Each run of the command has a folder `run-1`, `run-2`, ... with `frames.csv`
(the read-out board), `<camera>.csv` (tags: corners and their variances), `<camera>-frames.csv`
(when each image was taken, and how bright the LED was) and `log.jsonl` (events). Lines are only
appended to these files; a line that was cut by the end of the program is left out when reading.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ...core.markers import Markers, read_markers, write_markers_file
from ...core.storage import typed_json
from ...core.storage.append_log import AppendLog, LogLines
from ...core.storage.files import storage_errors, write_text
from ...core.storage.session_manifest import FILE, CaptureManifest, load_capture, manifest_path
from ..cameras.rig_file import Rig, read_rig
from ..readout.recording import parse_event
from ..tags.detection import TagView

SETTLING_SHARE = 0.3  # of a rest, left out at its start


def step_starts(events: Sequence[Mapping[str, Any]], start: int = 0) -> list[tuple[float, str]]:
    """Return when each step started and its name, in order.

    Args:
        events: Events of a run.
        start: Time zero of the computer's clock, ns.

    Returns:
        Seconds after `start`, and names.
    """
    starts = [
        ((event["host_ns"] - start) / 1e9, str(event["name"]))
        for event in events
        if event.get("event") == "step" and {"host_ns", "name"} <= set(event)
    ]
    return sorted(starts)


def rest_frames(events: Sequence[Mapping[str, Any]], time: Float, start: int = 0) -> Bool:
    """Return the frames (t,) of finished rests, without their starts.

    Args:
        events: Events of a run.
        time: Times of the frames (t,), s after `start`.
        start: Time zero of the computer's clock, ns.
    """
    is_resting = np.zeros(len(time), bool)
    rests: dict[int, float] = {}
    for event in events:
        now, step = (event.get("host_ns", 0) - start) / 1e9, event.get("step", -1)
        if event.get("event") == "step" and event.get("name") == REST:
            rests[step] = now
        elif event.get("event") == "done" and step in rests:
            is_resting |= (time > rests[step] + SETTLING_SHARE * (now - rests[step])) & (time < now)
    return is_resting


CAMERAS, MARKERS, BOARD, LOG = "cameras.toml", "markers.json", "frames.csv", "log.jsonl"
REST, FREE = "rest", "free"
_CORNERS = [f"{a}{k}" for k in range(4) for a in "xy"]
_VARIANCES = [
    f"{a}{k}" for k in (0, 1, 2, 3, "m") for a in ("xx", "xy", "yy")
]  # m: of the mean of the corners
TAG_COLUMNS = ("frame", "host_ns", "id", *_CORNERS, *_VARIANCES)
FRAME_COLUMNS = ("frame", "host_ns", "lamp")  # lamp: the LED, by its name in existing files


@dataclass(frozen=True)
class PoseStep:
    """A step of a recording.

    Attributes:
        name: Name of the pose to show, `rest`, or `free`.
        seconds: Duration of the step, s.
    """

    name: str
    seconds: float


@dataclass(frozen=True)
class CaptureSession:
    """What is to be recorded, with which cameras and tags.

    Attributes:
        folder: Folder of the session.
        device: Name of the device.
        steps: Steps to show.
        channels: Names of the channels (c,).
        reference: Reference resistors (c,), ohm.
        rig: Cameras; none for a session without calibration.
        markers: Markers of the device.
        started_at: When the session was created (ISO 8601).
        unit: Name of the unit; empty if not known.
        layout: Hash of the layout of the cords; empty if not known.
    """

    folder: Path
    device: str
    steps: tuple[PoseStep, ...]
    channels: tuple[str, ...]
    reference: tuple[float, ...]
    rig: Rig
    markers: Markers
    started_at: str
    unit: str = ""
    layout: str = ""

    @property
    def runs(self) -> list[Path]:
        """Folders of the runs so far, in their order."""
        folders = [p for p in self.folder.glob("run-*") if p.name[4:].isdigit()]
        return sorted(folders, key=lambda p: int(p.name[4:]))


def create(
    folder: Path,
    *,
    device: str,
    steps: Sequence[PoseStep],
    channels: Sequence[str],
    reference: Sequence[float],
    calibration: Path | None,
    markers: Markers,
    unit: str = "",
    layout: str = "",
) -> CaptureSession:
    """Create a session.

    Args:
        folder: Folder of the session.
        device: Name of the device.
        steps: Steps to show.
        channels: Names of the channels (c,).
        reference: Reference resistors (c,), ohm.
        calibration: File of the cameras; None for a session without cameras.
        markers: Markers of the device.
        unit: Name of the unit.
        layout: Hash of the layout of the cords.

    Raises:
        CaptureError: If the folder holds a session already.
        StorageError: If it cannot be written.
    """
    if manifest_path(folder):
        raise CaptureError(
            "holds a session already",
            code="session-exists",
            where=folder,
            action="Choose another folder (out)",
        )
    if calibration is not None:
        read_rig(calibration)
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if calibration is not None:
            write_text(folder / CAMERAS, calibration.read_text(encoding="utf-8"))
        write_markers_file(markers, folder / MARKERS)
        manifest = CaptureManifest(
            device,
            time.strftime("%Y-%m-%dT%H:%M:%S%z"),
            tuple(channels),
            tuple(float(r) for r in reference),
            tuple((s.name, float(s.seconds)) for s in steps),
            unit,
            layout,
        )
        typed_json.save(folder / FILE, manifest)
    return load(folder)


def load(folder: Path) -> CaptureSession:
    """Load a session.

    Raises:
        CaptureError: If the folder holds no session, or an invalid one.
    """
    manifest = load_capture(folder)
    if len(manifest.channels) != len(manifest.reference):
        raise CaptureError(
            f"has {len(manifest.channels)} channels but {len(manifest.reference)} reference"
            " resistors",
            code="resistors-differ",
            where=folder / FILE,
            action="Give one reference resistor for each channel",
        )
    rig = read_rig(folder / CAMERAS) if (folder / CAMERAS).exists() else Rig(())
    return CaptureSession(
        folder,
        manifest.device,
        tuple(PoseStep(*s) for s in manifest.steps),
        manifest.channels,
        manifest.reference,
        rig,
        read_markers(folder / MARKERS),
        manifest.begun,
        manifest.unit,
        manifest.layout,
    )


class Stream(AppendLog):
    """A CSV file to which lines are only appended."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        super().__init__(path, ",".join(columns))


class Log(AppendLog):
    """Events as JSON lines, with the monotonic clock."""

    def event(self, kind: str, **data: Any) -> None:
        """Write an event that happens now."""
        record = {
            "event": kind,
            "host_ns": time.monotonic_ns(),
            "at": round(time.time(), 3),
            **data,
        }
        self.line(json.dumps(record))


def format_tags(frame: int, host_ns: int, view: TagView) -> str:
    """Return the rows of an image's tags, without a final line break; empty for none."""
    rows = []
    for number, corners, covariance in zip(view.ids, view.corners, view.covariance, strict=True):
        variances = covariance[:, [0, 0, 1], [0, 1, 1]].ravel()
        cells = [f"{x:.4f}" for x in corners.ravel()] + [f"{s:.3e}" for s in variances]
        rows.append(f"{frame},{host_ns},{number},{','.join(cells)}")
    return "\n".join(rows)


def read_log(run: Path) -> list[dict[str, Any]]:
    """Read the events of a run; cut and damaged lines are left out.

    Raises:
        CaptureError: If a line is not an event.
    """
    path = run / LOG
    return [parse_event(path, number, line) for number, line in LogLines(path)]


def finished_steps(session: CaptureSession) -> list[int]:
    """Return the steps that were shown to their end, in any run."""
    steps = set()
    for run in session.runs:
        if (run / LOG).exists():
            steps |= {int(e["step"]) for e in read_log(run) if e.get("event") == "done"}
    return sorted(k for k in steps if 0 <= k < len(session.steps))


def covered_parts(session: CaptureSession) -> list[tuple[str, int]]:
    """Return the poses, and the parts of the way to each, that were seen in any run."""
    logs = [read_log(run) for run in session.runs if (run / LOG).exists()]
    return [
        (str(e["pose"]), int(e["part"])) for log in logs for e in log if e.get("event") == "covered"
    ]


def run_ending(run: Path) -> str:
    """Describe how a run ended."""
    events = read_log(run) if (run / LOG).exists() else []
    end = next((e for e in reversed(events) if e.get("event") == "end"), None)
    if end is None:
        return "was cut off: the program was killed, or the power went"
    return str(end.get("why", "ended"))


def plan_steps(
    poses: Sequence[str], rounds: int, seconds: float, free_seconds: float, rest_seconds: float
) -> tuple[PoseStep, ...]:
    """Plan the steps of a session: rest, the poses in turn, mixtures at the end of each round,
    rest.

    Args:
        poses: Names of the poses.
        rounds: Number of rounds.
        seconds: Duration of each pose, s.
        free_seconds: Duration of the free motion at the end of each round, s; 0 for none.
        rest_seconds: Duration of each rest, s.
    """
    steps = [PoseStep(REST, rest_seconds)]
    for _ in range(rounds):
        steps += [PoseStep(p, seconds) for p in poses]
        if free_seconds > 0:
            steps.append(PoseStep(FREE, free_seconds))
    return (*steps, PoseStep(REST, rest_seconds))


def session_summary(session: CaptureSession) -> Mapping[str, Any]:
    """Return plain values that describe a session."""
    return {
        "session": str(session.folder),
        "device": session.device,
        "steps": len(session.steps),
        "finished": len(finished_steps(session)),
        "runs": [{"run": r.name, "ended": run_ending(r)} for r in session.runs],
    }


def discard_empty(session: CaptureSession) -> None:
    """Remove a session that never recorded an image or a sample.

    It could not start, and must not bind the next one.
    """
    if any(_has_rows(path) for run in session.runs for path in run.glob("*.csv")):
        return
    for run in session.runs:
        for path in run.iterdir():
            path.unlink()
        run.rmdir()
    for name in (FILE, CAMERAS, MARKERS):
        (session.folder / name).unlink(missing_ok=True)


def _has_rows(path: Path) -> bool:
    """Return whether a stream has a line of numbers."""
    with path.open("rb") as file:
        return any(line[:1].isdigit() for line in file)
