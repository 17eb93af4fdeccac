"""Tracks as a table with a row per visible marker, and that table as CSV.

Columns are `frame, time, id, x, y, z, sx, sy, sz` (s, mm). A frame without visible markers has one
row. A marker that is never visible has one row in the first frame. Unknown values are `nan`.

A table may leave out markers that were not visible. So a damaged or hostile file of some kB, each
row of which names another frame and another marker, would fill all memory. Reading may therefore
take at most 64 MB and a hundred times the size of the file: in CSV, a marker must then be visible
in about every hundredth frame.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.storage.delimited_text import MAX_ROWS_BEFORE_CUT, cut_note, is_cut_off
from ...core.storage.files import replace_file
from ...core.storage.text import decode_text, split_lines

COLUMNS = ("frame", "time", "id", "x", "y", "z", "sx", "sy", "sz")
BYTES_PER_MARKER = 48  # in a frame: position and standard deviations
FREE_BYTES, MAX_EXPANSION = 64_000_000, 100
_HEADER = ",".join(COLUMNS)
#: Starts of tables that programs of motion capture export.
_PROGRAMS = {
    "Motive": ("Format Version", "Format version"),
    "Nexus": ("Trajectories", "Model Outputs", "Devices", "Joints", "Segments", "Events"),
    "Qualisys Track Manager": ("NO_OF_FRAMES",),
}
_ROW_FORMAT = "%d,%.9f,%d,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n"
_BLOCK_FRAMES = 1000  # written at once


def unreadable_error(path: Path, error: OSError) -> CaptureError:
    """Return the error for a file that the system refuses to read."""
    return CaptureError(
        f"cannot be read: {error.strerror or error}",
        code="file-unreadable",
        where=path,
        action="Check the file's name",
    )


def check_size(path: Path, needed: int) -> None:
    """Check that the memory that a file of tracks needs is in proportion to its size.

    Args:
        path: File of tracks.
        needed: Memory that its tracks need, bytes.

    Raises:
        CaptureError: If it needs too much.
    """
    size = path.stat().st_size
    if needed > FREE_BYTES + MAX_EXPANSION * size:
        raise CaptureError(
            f"its tracks need {needed / 1e6:.0f} MB of memory, out of proportion to a file of"
            f" {size / 1e6:.3g} MB",
            code="tracks-too-large",
            where=path,
            action="Check its numbers of frames and markers",
        )


def to_rows(tracks: Tracks, never_visible: Bool | None = None) -> Float:
    """Return the table (r, 9), sorted by frame and then in the order of the tracks' markers.

    Args:
        tracks: Tracks of m markers.
        never_visible: Markers (m,) that get a row in the first frame; by default those that are
            never visible.
    """
    rows = tracks.visible
    if rows.size:
        rows[0] |= never_visible_markers(tracks) if never_visible is None else never_visible
        rows[~rows.any(axis=1), 0] = True
    t, m = np.nonzero(rows)
    return np.column_stack(
        [tracks.frame[t], tracks.time[t], tracks.ids[m], tracks.points[t, m], tracks.sigma[t, m]]
    ).astype(float)


def never_visible_markers(tracks: Tracks) -> Bool:
    """Return which markers (m,) are never visible."""
    return np.asarray(~tracks.visible.any(axis=0))


def from_rows(path: Path, rows: Float, where: Callable[[int], str]) -> Tracks:
    """Return the tracks of a table.

    Args:
        path: File of the table.
        rows: Table (r, 9), in any order.
        where: Names the place of a row in messages.

    Returns:
        Tracks with markers sorted by number.

    Raises:
        CaptureError: If a row is invalid, or frames and markers are out of proportion to the file.
    """

    def check(is_wrong: Bool, code: str, problem: Callable[[int], str], action: str) -> None:
        if is_wrong.any():
            row = int(np.argmax(is_wrong))
            raise CaptureError(
                problem(row), code=code, where=where(row), action=action, row=row + 1
            )

    _check_cells(rows, check)
    order = np.lexsort((rows[:, 2], rows[:, 0]))
    sorted_rows = rows[order]
    frame, first, position = np.unique(sorted_rows[:, 0], return_index=True, return_inverse=True)
    ids, column = np.unique(sorted_rows[:, 2], return_inverse=True)
    time = sorted_rows[first, 1]

    is_repeated = np.zeros(len(rows), bool)
    is_repeated[order[1:]] = (np.diff(sorted_rows[:, [0, 2]], axis=0) == 0).all(1)
    check(
        is_repeated,
        "marker-repeated",
        lambda r: f"frame {rows[r, 0]:.0f} has marker {rows[r, 2]:.0f} twice",
        "Delete one of the rows",
    )
    differs = np.zeros(len(rows), bool)
    differs[order] = sorted_rows[:, 1] != time[position]
    check(
        differs,
        "times-differ",
        lambda r: f"frame {rows[r, 0]:.0f} has two times",
        "Give all rows of a frame the same time",
    )
    goes_back = np.zeros(len(rows), bool)
    goes_back[order[first[1:]]] = np.diff(time) <= 0
    check(
        goes_back,
        "times-not-increasing",
        lambda r: f"the time {rows[r, 1]:g} s is not later than that of the previous frame",
        "Number the frames in the order of their times",
    )

    check_size(path, len(frame) * len(ids) * BYTES_PER_MARKER)
    points = np.full((len(frame), len(ids), 3), np.nan)
    sigma = points.copy()
    points[position, column] = sorted_rows[:, 3:6]
    sigma[position, column] = sorted_rows[:, 6:]
    return Tracks(time, _as_int(ids), points, sigma, _as_int(frame))


def _check_cells(
    rows: Float, check: Callable[[Bool, str, Callable[[int], str], str], None]
) -> None:
    """Check that the cells of a table (r, 9) are numbers of the right kind."""
    is_absent = np.isnan(rows[:, 3:]).all(1)
    for i, name in enumerate(COLUMNS[:6]):
        is_wrong = ~np.isfinite(rows[:, i]) & ~(is_absent & (i >= 3))
        check(
            is_wrong,
            "not-a-number",
            lambda _, name=name: f"{name} is not a finite number",  # type: ignore[misc]
            "Write a number",
        )
    for i in (0, 2):
        values = rows[:, i]
        is_wrong = np.asarray((values != np.rint(values)) | (np.abs(values) >= 2.0**53))
        check(
            is_wrong,
            "not-a-whole-number",
            lambda r, i=i: f"{COLUMNS[i]} {rows[r, i]:g} is not a whole number",  # type: ignore[misc]
            "Write a whole number",
        )
    is_known = np.isfinite(rows[:, 6:]).all(1) & (rows[:, 6:] >= 0).all(1)
    check(
        np.asarray(~(is_known | np.isnan(rows[:, 6:]).all(1))),
        "sigma-invalid",
        lambda _: "sx, sy, sz are not valid standard deviations",
        "Write three numbers of at least 0, or three nan",
    )


def _as_int(values: Float) -> Int:
    return values.astype(np.int64)


def write_csv(path: Path, tracks: Tracks) -> None:
    """Write tracks as CSV: times to 1 ns, positions to 1 nm, `nan` for unknown values.

    Raises:
        StorageError: If the file cannot be written.
    """
    never_visible = never_visible_markers(tracks)
    with replace_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(_HEADER + "\n")
        for k in range(0, len(tracks.time), _BLOCK_FRAMES):
            part = tracks.select(slice(k, k + _BLOCK_FRAMES))
            rows = to_rows(part, never_visible & (k == 0))
            file.write((_ROW_FORMAT * len(rows)) % tuple(rows.ravel().tolist()))


def read_csv(path: Path, notes: list[str] | None = None) -> Tracks:
    """Read tracks from CSV as `write_csv` writes it.

    Args:
        path: The file. A last line that is cut off is left out.
        notes: Gets a note on that.

    Raises:
        CaptureError: If the file cannot be read, or one of its lines is invalid.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise unreadable_error(path, error) from None
    lines = split_lines(decode_text(content))
    if {"\0", "\ufffd"} & set(lines[0]):
        raise CaptureError(
            "is not a table of tracks, because it is not text",
            code="not-a-tracks-file",
            where=path,
            action="Choose another file",
        )
    if lines[0].strip() != _HEADER:
        raise _header_error(path, lines[0].strip())
    numbers = [i for i, line in enumerate(lines[1:], 2) if line.strip()]
    if numbers and numbers[-1] == len(lines):  # the last line has no end
        earlier = [lines[i - 1].split(",") for i in numbers[-1 - MAX_ROWS_BEFORE_CUT : -1]]
        if is_cut_off(lines[-1].split(","), earlier, len(COLUMNS)):
            number = numbers.pop()
            if notes is not None:
                notes.append(cut_note(path, number))
    rows = _parse(path, numbers, [lines[i - 1] for i in numbers])
    return from_rows(path, rows, lambda row: f"{path}:{numbers[row]}")


def _header_error(path: Path, line: str) -> CaptureError:
    """Return the error for a first line of another table."""
    program = next((name for name, start in _PROGRAMS.items() if line.startswith(start)), None)
    if program is None:
        problem = f"the first line must be {_HEADER}, not {line[:60]!r}"
        action = "Write these columns, or export C3D or TRC from the motion-capture program"
    else:
        problem = f"is a table of {program}, whose layout is not read"
        action = f"Export C3D or TRC from {program}"
    return CaptureError(
        problem, code="header-wrong", where=f"{path}:1", action=action, line=1, program=program
    )


def _parse(path: Path, numbers: list[int], lines: list[str]) -> Float:
    """Return the cells (r, 9) of numbered lines."""
    if not lines:
        return np.empty((0, len(COLUMNS)))
    try:
        table = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
        if table.shape[1] == len(COLUMNS):
            return table
    except ValueError:
        pass
    for number, line in zip(numbers, lines, strict=True):
        _check_line(f"{path}:{number}", number, line)
    raise CaptureError(
        "is not a table of numbers",
        code="not-a-tracks-file",
        where=path,
        action="Choose another file",
    )


def _check_line(where: str, number: int, line: str) -> None:
    """Raise CaptureError for a line whose cells are not nine numbers."""
    cells = line.split(",")
    if len(cells) != len(COLUMNS):
        raise CaptureError(
            f"has {len(cells)} cells, but there are {len(COLUMNS)} columns",
            code="cell-count-differs",
            where=where,
            action=f"Write {_HEADER}",
            line=number,
            count=len(cells),
        )
    for name, cell in zip(COLUMNS, cells, strict=True):
        try:
            float(cell)
        except ValueError:
            raise CaptureError(
                f"{name} is not a number: {cell[:40]!r}",
                code="not-a-number",
                where=where,
                action="Write a number, or nan",
                line=number,
                column=name,
                value=cell[:40],
            ) from None
