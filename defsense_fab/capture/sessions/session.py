"""A capture session: a folder with what the cameras and the read-out board saw, a file for each of
them.

`session.json` says what was to be recorded, `cameras.toml` and `markers.json` are copies of what it
was recorded with. Each run of the command has a folder `run-1`, `run-2`, ... with `frames.csv` (the
read-out board), `<camera>.csv` (tags: corners and their variances), `<camera>-frames.csv` (when
each picture was taken, how bright the LED was) and `log.jsonl` (what happened). All of them are
only appended to, line by line; a line that was cut by the end of the program is left out when it is
read."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.errors import CaptureError
from ...core.markers import Markers, read_markers, write_markers_file
from ...core.storage import typed_json
from ...core.storage.append_log import AppendLog, LogLines
from ...core.storage.files import storage_errors, write_text
from ...core.storage.session_manifest import FILE, CaptureManifest, load_capture, manifest_path
from ..cameras.rig_file import Rig, read_rig
from ..tags.detection import TagView

CAMERAS, MARKERS, BOARD, LOG = "cameras.toml", "markers.json", "frames.csv", "log.jsonl"
REST, FREE = "rest", "free"
_CORNERS = [f"{a}{k}" for k in range(4) for a in "xy"]
_SPREAD = [f"{a}{k}" for k in (0, 1, 2, 3, "m") for a in ("xx", "xy", "yy")]  # m: of the mean
TAG_COLUMNS = ("frame", "host_ns", "id", *_CORNERS, *_SPREAD)
FRAME_COLUMNS = ("frame", "host_ns", "lamp")  # the LED, in files that are out there


@dataclass(frozen=True)
class PoseStep:
    """A pose to show for so many `seconds`: its name, `rest`, or `free`."""

    name: str
    seconds: float


@dataclass(frozen=True)
class CaptureSession:
    """What `session.json` says, with the cameras and tags beside it; `reference` (c,) ohm; `unit`
    and the hash of the cords' `layout`, empty where not known."""

    folder: Path
    device: str
    steps: tuple[PoseStep, ...]
    channels: tuple[str, ...]
    reference: tuple[float, ...]
    rig: Rig
    markers: Markers
    begun: str
    unit: str = ""
    layout: str = ""

    @property
    def runs(self) -> list[Path]:
        """Folders of the runs so far, in their order."""
        found = [p for p in self.folder.glob("run-*") if p.name[4:].isdigit()]
        return sorted(found, key=lambda p: int(p.name[4:]))


def create(
    folder: Path, *, device: str, steps: Sequence[PoseStep], channels: Sequence[str],
    reference: Sequence[float], calibration: Path | None, markers: Markers, unit: str = "",
    layout: str = "",
) -> CaptureSession:  # fmt: skip
    """Begin a session, without cameras where there is no calibration. Raises CaptureError where the
    folder holds one, StorageError."""
    if manifest_path(folder):
        raise CaptureError(f"{folder}: holds a session already; choose another folder with --out")
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
    """Raises CaptureError for a folder that holds none, or a broken one."""
    found = load_capture(folder)
    if len(found.channels) != len(found.reference):
        raise CaptureError(
            f"{folder / FILE}: has {len(found.channels)} channels and {len(found.reference)}"
            " reference resistors; give one for each"
        )
    rig = read_rig(folder / CAMERAS) if (folder / CAMERAS).exists() else Rig(())
    return CaptureSession(
        folder, found.device, tuple(PoseStep(*s) for s in found.steps), found.channels,
        found.reference, rig, read_markers(folder / MARKERS), found.begun, found.unit, found.layout,
    )  # fmt: skip


class Stream(AppendLog):
    """A CSV file that is only appended to."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        super().__init__(path, ",".join(columns))


class Log(AppendLog):
    """What happened, as JSON lines with the monotonic clock."""

    def event(self, kind: str, **data: Any) -> None:
        """One event, now."""
        told = {"event": kind, "host_ns": time.monotonic_ns(), "at": round(time.time(), 3), **data}
        self.line(json.dumps(told))


def tag_lines(frame: int, host_ns: int, view: TagView) -> str:
    """The rows of a picture's tags, without a line's end after the last; empty for none."""
    rows = []
    for number, corners, covariance in zip(view.ids, view.corners, view.covariance, strict=True):
        spread = covariance[:, [0, 0, 1], [0, 1, 1]].ravel()
        cells = [f"{x:.4f}" for x in corners.ravel()] + [f"{s:.3e}" for s in spread]
        rows.append(f"{frame},{host_ns},{number},{','.join(cells)}")
    return "\n".join(rows)


def read_log(run: Path) -> list[dict[str, Any]]:
    """Events of a run; lines that were cut or damaged are left out."""
    path = run / LOG
    out = []
    for number, line in LogLines(path):
        try:
            event = json.loads(line)
            if not isinstance(event, dict):
                raise ValueError
        except ValueError:
            raise CaptureError(f"{path}:{number}: not an event: {line[:60]!r}") from None
        out.append(event)
    return out


def finished(session: CaptureSession) -> list[int]:
    """Steps that were shown to their end, in any run."""
    done = set()
    for run in session.runs:
        if (run / LOG).exists():
            done |= {int(e["step"]) for e in read_log(run) if e.get("event") == "done"}
    return sorted(k for k in done if 0 <= k < len(session.steps))


def covered(session: CaptureSession) -> list[tuple[str, int]]:
    """Poses, and parts of the way to each, that were seen in any run."""
    logs = [read_log(run) for run in session.runs if (run / LOG).exists()]
    return [
        (str(e["pose"]), int(e["part"])) for log in logs for e in log if e.get("event") == "covered"
    ]


def ending(run: Path) -> str:
    """How a run ended, in words."""
    events = read_log(run) if (run / LOG).exists() else []
    last = next((e for e in reversed(events) if e.get("event") == "end"), None)
    if last is None:
        return "was cut off: the program was killed, or the power went"
    return str(last.get("why", "ended"))


def plan(
    poses: Sequence[str], rounds: int, seconds: float, free: float, still: float
) -> tuple[PoseStep, ...]:
    """Rest, the poses in turns, mixtures at the end of each round, rest."""
    steps = [PoseStep(REST, still)]
    for _ in range(rounds):
        steps += [PoseStep(p, seconds) for p in poses]
        if free > 0:
            steps.append(PoseStep(FREE, free))
    return (*steps, PoseStep(REST, still))


def as_mapping(session: CaptureSession) -> Mapping[str, Any]:
    """For `--json`."""
    return {
        "session": str(session.folder), "device": session.device, "steps": len(session.steps),
        "finished": len(finished(session)),
        "runs": [{"run": r.name, "ended": ending(r)} for r in session.runs],
    }  # fmt: skip


def discard_empty(session: CaptureSession) -> None:
    """Remove a session that never saw a picture or a sample: it could not begin, and must not bind
    the next."""
    if any(_has_rows(path) for run in session.runs for path in run.glob("*.csv")):
        return
    for run in session.runs:
        for path in run.iterdir():
            path.unlink()
        run.rmdir()
    for name in (FILE, CAMERAS, MARKERS):
        (session.folder / name).unlink(missing_ok=True)


def _has_rows(path: Path) -> bool:
    """Whether a stream has a line of numbers."""
    with path.open("rb") as file:
        return any(line[:1].isdigit() for line in file)
