"""Read and write TRC, the text files of Motion Analysis and OpenSim.

A file has five header lines and then a row per frame.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.storage.files import replace_file
from .track_conversion import frame_grid, marker_labels, marker_numbers
from .tracks_csv import BYTES_PER_MARKER, check_size, unreadable_error

HEADER_LINES = 5
_MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_NAMES = (
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
    "\tOrigNumFrames"
)


def write_trc(path: Path, tracks: Tracks) -> None:
    """Write markers in mm, labeled such as `tag_7`; missing markers have empty cells.

    Times are written as they are. The rate in the header is theirs, or that of the median step if
    they are uneven.

    Raises:
        CaptureError: If there are no markers or no frames.
        StorageError: If the file cannot be written.
    """
    n, m = tracks.points.shape[:2]
    if not (n and m):
        raise CaptureError(
            "there are no markers to write",
            code="markers-missing",
            where=path,
            action="Choose tracks that have markers",
        )
    grid = frame_grid(tracks.time)
    rate = 0.0
    if grid is not None:
        rate = 1 / (grid.period if grid.is_even else float(np.median(np.diff(tracks.time))))
    start = tracks.frame[0]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        _NAMES,
        f"{rate:.6f}\t{rate:.6f}\t{n}\t{m}\tmm\t{rate:.6f}\t{start}\t{n}",
        "Frame#\tTime\t" + "\t\t\t".join(marker_labels(tracks.ids)) + "\t\t",
        "\t\t" + "\t".join(f"{a}{i}" for i in range(1, m + 1) for a in "XYZ"),
        "",
    ]
    cells = tracks.points.reshape(n, -1).tolist()
    for frame, time, row in zip(tracks.frame.tolist(), tracks.time.tolist(), cells, strict=True):
        values = "\t".join("" if math.isnan(x) else f"{x:.6f}" for x in row)
        lines.append(f"{frame}\t{time:.9f}\t{values}")
    with replace_file(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def read_trc(path: Path) -> Tracks:
    """Read markers in mm, missing where cells are empty or nan.

    Standard deviations are unknown; marker numbers come from the labels.

    Raises:
        CaptureError: If the file is not TRC, has a unit other than m, cm and mm, has fewer rows
            than its header states, or its times do not increase.
    """
    lines = _read_lines(path)
    scale, frames, markers = _parse_header(path, lines)
    labels = tuple(label.strip() for label in lines[3].split("\t")[2::3] if label.strip())
    if len(labels) != markers or not markers:
        raise CaptureError(
            f"there are {len(labels)} marker labels, each over three columns, but NumMarkers is"
            f" {markers}",
            code="labels-differ",
            where=f"{path}:4",
            action="Export the file again",
            line=4,
            count=len(labels),
        )
    check_size(path, len(lines) * markers * BYTES_PER_MARKER)
    rows = [
        _parse_row(path, number, line, markers)
        for number, line in enumerate(lines[HEADER_LINES:], HEADER_LINES + 1)
        if line.strip()
    ]
    if len(rows) < frames or not rows:
        raise CaptureError(
            f"is truncated: it has {len(rows)} of {frames} frames",
            code="file-truncated",
            where=path,
            action="Copy it again",
            count=len(rows),
            frames=frames,
        )
    table = np.array(rows)
    time = table[:, 1]
    if (np.diff(time) <= 0).any():
        row = int(np.argmax(np.diff(time) <= 0)) + 1
        raise CaptureError(
            f"the time of frame {table[row, 0]:.0f} is not later than that of the previous frame",
            code="times-not-increasing",
            where=path,
            action="Export the file again",
            frame=int(table[row, 0]),
        )
    points = table[:, 2:].reshape(len(rows), markers, 3) * scale
    ids, frame = marker_numbers(labels), table[:, 0].astype(np.int64)
    return Tracks(time, ids, points, np.full_like(points, np.nan), frame)


def _read_lines(path: Path) -> list[str]:
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise unreadable_error(path, error) from None
    if len(lines) < HEADER_LINES or not lines[0].startswith("PathFileType"):
        raise CaptureError(
            "is not a TRC file (it does not start with PathFileType)",
            code="not-a-trc-file",
            where=f"{path}:1",
            action="Choose another file",
            line=1,
        )
    return lines


def _parse_header(path: Path, lines: list[str]) -> tuple[float, int, int]:
    """Return mm per unit, and the stated numbers of frames and markers."""
    head = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    unit = head.get("Units", "").strip()
    if unit.lower() not in _MM_PER_UNIT:
        raise CaptureError(
            f"the unit (Units) is {unit!r}",
            code="unknown-unit",
            where=f"{path}:3",
            action="Export the file in mm, cm or m",
            line=3,
            unit=unit,
        )
    try:
        frames, markers = int(head["NumFrames"]), int(head["NumMarkers"])
    except (KeyError, ValueError):
        raise CaptureError(
            "NumFrames and NumMarkers must be whole numbers",
            code="not-a-number",
            where=f"{path}:3",
            action="Export the file again",
            line=3,
        ) from None
    return _MM_PER_UNIT[unit.lower()], frames, markers


def _parse_row(path: Path, number: int, line: str, markers: int) -> list[float]:
    """Return frame, time and positions (2 + 3 m), NaN for missing cells."""

    def error(problem: str, code: str, **data: object) -> CaptureError:
        return CaptureError(
            problem,
            code=code,
            where=f"{path}:{number}",
            action="Export the file again",
            line=number,
            **data,
        )

    cells = [cell.strip() for cell in line.split("\t")]
    width = 2 + 3 * markers
    if any(cells[width:]):
        raise error(
            f"has {len(cells)} cells, but {markers} markers need {width}",
            code="cell-count-differs",
            count=len(cells),
        )
    cells = (cells + [""] * width)[:width]
    try:
        values = [float(cell) if cell else math.nan for cell in cells]
    except ValueError as problem:
        raise error(str(problem), code="not-a-number") from None
    if not (math.isfinite(values[0]) and math.isfinite(values[1])):
        raise error("the frame and its time must be numbers", code="not-a-number")
    for i in range(markers):
        is_missing = [math.isnan(x) for x in values[2 + 3 * i : 5 + 3 * i]]
        if any(is_missing) and not all(is_missing):
            raise error(
                f"a coordinate of marker {i + 1} is missing",
                code="marker-incomplete",
                marker=i + 1,
            )
    if any(map(math.isinf, values)):
        raise error("a coordinate is infinite", code="not-a-number")
    return values
