"""TRC, the text of Motion Analysis and OpenSim: five lines of head, then a row a frame."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.storage.files import replacing
from .track_conversion import Labelled, frame_grid, labels_of, numbers_of
from .tracks_csv import CELL, check_size

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_NAMES = (
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
    "\tOrigNumFrames"
)
_HEAD = 5


def write_trc(path: Path, tracks: Tracks) -> None:
    """Markers `tag_7` in mm, empty cells where they were not seen, the times as they are; the rate
    is theirs, or where they are uneven that of the median step. Raises CaptureError for tracks
    without markers or frames."""
    n, m = tracks.points.shape[:2]
    if not (n and m):
        raise CaptureError(f"{path}: there are no markers to write", code="markers-missing")
    grid = frame_grid(tracks.time)
    rate = 0.0
    if grid is not None:
        rate = 1 / (grid.period if grid.even else float(np.median(np.diff(tracks.time))))
    start = tracks.frame[0]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        _NAMES,
        f"{rate:.6f}\t{rate:.6f}\t{n}\t{m}\tmm\t{rate:.6f}\t{start}\t{n}",
        "Frame#\tTime\t" + "\t\t\t".join(labels_of(tracks.ids)) + "\t\t",
        "\t\t" + "\t".join(f"{a}{i}" for i in range(1, m + 1) for a in "XYZ"),
        "",
    ]
    cells = tracks.points.reshape(n, -1).tolist()
    for frame, time, row in zip(tracks.frame.tolist(), tracks.time.tolist(), cells, strict=True):
        values = "\t".join("" if math.isnan(x) else f"{x:.6f}" for x in row)
        lines.append(f"{frame}\t{time:.9f}\t{values}")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def read_trc(path: Path) -> Labelled:
    """Markers in mm, missing where the cells are empty or nan; sigma unknown, numbers from the
    labels. Raises CaptureError with the line for what is not TRC, a unit other than m, cm and mm,
    fewer rows than the head says, times that do not increase."""
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None
    if len(lines) < _HEAD or not lines[0].startswith("PathFileType"):
        raise CaptureError(
            f"{path}:1: is no TRC file (it does not begin with PathFileType)",
            code="not-a-trc-file",
            line=1,
        )
    head = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    unit = head.get("Units", "").strip()
    if unit.lower() not in _MM:
        raise CaptureError(
            f"{path}:3: the unit (Units) is {unit!r}; it must be mm, cm or m",
            code="unknown-unit",
            line=3,
            unit=unit,
        )
    try:
        frames, markers = int(head["NumFrames"]), int(head["NumMarkers"])
    except (KeyError, ValueError):
        raise CaptureError(
            f"{path}:3: NumFrames and NumMarkers must be whole numbers", code="not-a-number", line=3
        ) from None
    names = lines[3].split("\t")
    labels = tuple(label.strip() for label in names[2::3] if label.strip())
    if len(labels) != markers or not markers:
        raise CaptureError(
            f"{path}:4: {len(labels)} labels of markers, each over three columns, and NumMarkers is"
            f" {markers}",
            code="labels-differ",
            line=4,
            count=len(labels),
        )
    check_size(path, len(lines) * markers * CELL)
    rows = [
        _row(path, number, line, markers)
        for number, line in enumerate(lines[_HEAD:], _HEAD + 1)
        if line.strip()
    ]
    if len(rows) < frames or not rows:
        raise CaptureError(
            f"{path}: is cut short: {len(rows)} of {frames} frames; copy it again",
            code="file-truncated",
            count=len(rows),
            frames=frames,
        )
    table = np.array(rows)
    time = table[:, 1]
    if (np.diff(time) <= 0).any():
        at = int(np.argmax(np.diff(time) <= 0)) + 1
        raise CaptureError(
            f"{path}: frame {table[at, 0]:.0f}: its time is not later than the last",
            code="times-not-increasing",
            frame=int(table[at, 0]),
        )
    points = table[:, 2:].reshape(len(rows), markers, 3) * _MM[unit.lower()]
    ids, frame = numbers_of(labels), table[:, 0].astype(np.int64)
    return Labelled(Tracks(time, ids, points, np.full_like(points, np.nan), frame), labels)


def _row(path: Path, line_number: int, line: str, markers: int) -> list[float]:
    """Frame, time and places (2 + 3 m), NaN for what is missing."""
    where = f"{path}:{line_number}"
    cells = [cell.strip() for cell in line.split("\t")]
    width = 2 + 3 * markers
    if any(cells[width:]):
        raise CaptureError(
            f"{where}: {len(cells)} cells for {markers} markers ({width} are due)",
            code="cell-count-differs",
            line=line_number,
            count=len(cells),
        )
    cells = (cells + [""] * width)[:width]
    try:
        values = [float(cell) if cell else math.nan for cell in cells]
    except ValueError as error:
        raise CaptureError(f"{where}: {error}", code="not-a-number", line=line_number) from None
    if not (math.isfinite(values[0]) and math.isfinite(values[1])):
        raise CaptureError(
            f"{where}: the frame and its time must be numbers",
            code="not-a-number",
            line=line_number,
        )
    for i in range(markers):
        missing = [math.isnan(x) for x in values[2 + 3 * i : 5 + 3 * i]]
        if any(missing) and not all(missing):
            raise CaptureError(
                f"{where}: of marker {i + 1} a part of its place is missing",
                code="marker-incomplete",
                line=line_number,
                marker=i + 1,
            )
    if any(map(math.isinf, values)):
        raise CaptureError(
            f"{where}: a place must be finite", code="not-a-number", line=line_number
        )
    return values
