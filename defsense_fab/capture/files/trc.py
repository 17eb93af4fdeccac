"""Read and write TRC, the text files of Motion Analysis and OpenSim.

A file has five header lines and then a row per frame. Cells are separated by tabs, and in files of
some programs by commas, semicolons or spaces; each part of a file may have its own separator.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.storage.delimited_text import MAX_ROWS_BEFORE_CUT, cut_note, is_cut_off
from ...core.storage.files import replace_file
from ...core.storage.text import decode_text, parse_numbers, split_lines
from .length_units import LengthUnit, resolve_unit
from .marker_labels import marker_labels
from .track_conversion import frame_grid
from .track_file import TrackFile, labeled_tracks
from .tracks_csv import BYTES_PER_MARKER, check_size, unreadable_error

HEADER_LINES = 5
_WRITER = "defsense-fab"  # last cell of the first line of own files
_NAMES = (
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
    "\tOrigNumFrames"
)
#: A comma that separates, in a line without tabs and semicolons.
_COMMA = re.compile(r",[ ,]|,\S*,|^[^ ]*,[^ ]*$")
_DECIMAL_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?")
_WINDOWS_NAN = re.compile(r"[-+]?1\.#(IND|QNAN|SNAN)0*")
_MAX_FRAME = 2**53  # whole numbers that a float holds
_MAX_SHOWN = 40  # characters of a cell in a message


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
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}\t{_WRITER}",
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


def read_trc(path: Path, unit: LengthUnit | None = None) -> TrackFile:
    """Read markers, without standard deviations.

    Markers are absent where their cells are empty or nan, and by the rule of `absent_markers`.
    Columns after the labeled ones are left out.

    Args:
        path: The file.
        unit: Unit of files that do not state a unit that is known.

    Raises:
        CaptureError: If the file is not TRC, has no unit, has fewer rows than its header states, or
            a cell that is not a number, or its times do not increase.
    """
    lines = _read_lines(path)
    head = _parse_header(path, lines)
    scale = resolve_unit(head.get("Units", ""), unit, f"{path}:3", "Units", line=3)
    frames, markers = (_count(path, head, name) for name in ("NumFrames", "NumMarkers"))
    labels = _parse_labels(path, lines[3], markers)
    check_size(path, len(lines) * len(labels) * BYTES_PER_MARKER)
    table, unnamed, cut_notes = _parse_rows(path, lines, labels)
    if len(table) < frames - len(cut_notes) or not len(table):
        raise CaptureError(
            f"is truncated: it has {len(table)} of {frames} frames",
            code="file-truncated",
            where=path,
            action="Copy it again",
            count=len(table),
            frames=frames,
        )
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
    is_named = np.array([bool(label) for label in labels])
    points = table[:, 2:].reshape(len(table), len(labels), 3)[:, is_named] * scale
    named = [label for label in labels if label]
    return labeled_tracks(
        path,
        time,
        table[:, 0].astype(np.int64),
        named,
        points,
        is_own=lines[0].split("\t")[-1] == _WRITER,
        notes=[
            *_notes(len(named), markers, unnamed + len(labels) - len(named)),
            *cut_notes,
        ],
    )


def _notes(named: int, markers: int, unnamed: int) -> list[str]:
    """Return notes on the numbers of labels, markers of the header, and columns without label."""
    notes = []
    if unnamed:
        are = " is" if unnamed == 1 else "s are"
        notes.append(f"{unnamed} marker{are} left out, in columns without a label")
    if markers not in (named, named + unnamed):
        notes.append(f"NumMarkers is {markers}, but {named} markers have labels and are read")
    return notes


def _read_lines(path: Path) -> list[str]:
    try:
        lines = split_lines(decode_text(path.read_bytes()))
    except OSError as error:
        raise unreadable_error(path, error) from None
    if not lines[0].lstrip().startswith("PathFileType"):
        raise CaptureError(
            "is not a TRC file (it does not start with PathFileType)",
            code="not-a-trc-file",
            where=f"{path}:1",
            action="Choose another file",
            line=1,
        )
    if len(lines) < HEADER_LINES:
        raise CaptureError(
            f"is truncated: it ends in line {len(lines)}, within its header",
            code="file-truncated",
            where=path,
            action="Copy it again",
        )
    return lines


def _find_separator(line: str) -> str | None:
    """Return the separator of a line's cells; None for spaces."""
    line = line.strip(" ")
    return next((mark for mark in "\t;" if mark in line), "," if _COMMA.search(line) else None)


def _split(line: str, separator: str | None) -> list[str]:
    return [cell.strip() for cell in (line.split(separator) if separator else line.split())]


def _parse_header(path: Path, lines: list[str]) -> dict[str, str]:
    """Return the values of the header by their names."""
    names, values = (_split(line, _find_separator(line)) for line in lines[1:3])
    if _find_separator(lines[2]) is None and len(names) != len(values):
        raise CaptureError(
            f"has {len(values)} values, separated by spaces, for the {len(names)} names of line 2",
            code="header-wrong",
            where=f"{path}:3",
            action="Export the file again, with tabs",
            line=3,
            count=len(values),
        )
    return dict(zip(names, values, strict=False))


def _count(path: Path, head: dict[str, str], name: str) -> int:
    """Return a number of frames or markers of the header."""
    try:
        number = float(head[name])
        if number < 0 or number != int(number):
            raise ValueError
        return int(number)
    except (KeyError, ValueError, OverflowError):
        value = head.get(name)
        raise CaptureError(
            f"{name} is missing" if value is None else f"{name} is {value!r}, not a whole number",
            code="not-a-number",
            where=f"{path}:3",
            action="Export the file again",
            line=3,
            name=name,
        ) from None


def _parse_labels(path: Path, line: str, markers: int) -> list[str]:
    """Return the label of each marker's three columns; empty for columns without one.

    A label is in the first of three columns, or there are only labels, one for each marker.
    """
    separator = _find_separator(line)
    cells = _split(line, separator)[2:]
    if len(cells) == 1 < markers:  # spaces between the labels, and no blank cells after them
        words = cells[0].split()
        cells = words if len(words) == markers else re.split(r" {2,}", cells[0])
    while cells and not cells[-1]:
        cells.pop()
    is_dense = separator is None or (all(cells) and len(cells) > 1)
    labels = cells if is_dense else cells[::3]
    count = sum(map(bool, labels))
    is_misplaced = not is_dense and count < sum(map(bool, cells))
    if is_misplaced or not count or count > markers:
        where = ", some of them not in the first of three columns" if is_misplaced else ""
        raise CaptureError(
            f"there are {sum(map(bool, cells))} marker labels{where}, but NumMarkers is {markers}",
            code="labels-differ",
            where=f"{path}:4",
            action="Export the file again",
            line=4,
            count=count,
        )
    return labels


def _parse_rows(
    path: Path, lines: list[str], labels: Sequence[str]
) -> tuple[Float, int, list[str]]:
    """Return frame, time and positions (t, 2 + 3 m), NaN where absent.

    Also return the number of markers in the columns after these, and a note on a last row that is
    left out because it is cut off.
    """
    numbered = [
        (number, line)
        for number, line in enumerate(lines[HEADER_LINES:], HEADER_LINES + 1)
        if line.strip()
    ]
    width = 2 + 3 * len(labels)
    if not numbered:
        return np.empty((0, width)), 0, []
    separator = _find_separator(numbered[0][1])
    rows = [(number, _split(line, separator)) for number, line in numbered]
    columns = Counter(_column_count(cells) for _, cells in rows).most_common(1)[0][0]
    unnamed, notes = 0, list[str]()
    if numbered[-1][0] == len(lines):  # the last line has no end
        earlier = [cells for _, cells in rows[-1 - MAX_ROWS_BEFORE_CUT : -1]]
        if is_cut_off(rows[-1][1], earlier, columns):
            notes.append(cut_note(path, rows.pop()[0]))
    for number, cells in rows:
        is_complete = _column_count(cells) == columns >= width
        has_blanks = separator is not None and not any(cells[width:])
        if not (is_complete or (has_blanks and all(labels))):
            raise _row_error(
                path,
                number,
                f"has {len(cells)} cells, but {len(labels)} markers need {width}"
                + (f", and most rows have {columns}" if columns != width else ""),
                "cell-count-differs",
                count=len(cells),
            )
        if any(cells[width:]):
            unnamed = -(-(columns - width) // 3)
    values = [_parse_row(path, n, cells, labels) for n, cells in rows]
    return np.array(values).reshape(-1, width), unnamed, notes


def _column_count(cells: Sequence[str]) -> int:
    """Return the number of cells of a row, without a blank that a separator at the end makes."""
    return len(cells) - (len(cells) % 3 == 0 and not cells[-1])


def _parse_row(path: Path, number: int, cells: Sequence[str], labels: Sequence[str]) -> list[float]:
    """Return the numbers of a row (2 + 3 m), NaN for empty cells."""
    width = 2 + 3 * len(labels)
    texts = [*cells[:width], *[""] * (width - len(cells))]
    try:
        values = list[float](parse_numbers(texts))
    except ValueError:
        values = [_parse_cell(path, number, text) for text in texts]
    if not (values[0] % 1 == 0 and abs(values[0]) < _MAX_FRAME and math.isfinite(values[1])):
        problem = "the frame must be a whole number, and its time a number"
        raise _row_error(path, number, problem, "not-a-number")
    for i, label in enumerate(labels):
        missing = sum(map(math.isnan, values[2 + 3 * i : 5 + 3 * i]))
        if 0 < missing < 3 and label:
            raise _row_error(
                path,
                number,
                f"{missing} of 3 coordinates of the marker {label} are missing",
                "marker-incomplete",
                marker=label,
            )
    if any(map(math.isinf, values)):
        raise _row_error(path, number, "a coordinate is infinite", "not-a-number")
    return values


def _parse_cell(path: Path, number: int, text: str) -> float:
    """Return the number of a cell, or raise CaptureError."""
    if not text or _WINDOWS_NAN.fullmatch(text):
        return math.nan
    try:
        return float(parse_numbers([text])[0])
    except ValueError:
        pass
    if _DECIMAL_COMMA.fullmatch(text):
        raise _row_error(
            path,
            number,
            f"{text[:_MAX_SHOWN]!r} has a decimal comma",
            "decimal-comma",
            "Export the file with decimal points",
        )
    raise _row_error(path, number, f"{text[:_MAX_SHOWN]!r} is not a number", "not-a-number")


def _row_error(
    path: Path,
    number: int,
    problem: str,
    code: str,
    action: str = "Export the file again",
    **data: object,
) -> CaptureError:
    """Return the error for a row in the line `number`."""
    return CaptureError(
        problem, code=code, where=f"{path}:{number}", action=action, line=number, **data
    )
