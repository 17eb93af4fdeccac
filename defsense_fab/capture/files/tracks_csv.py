"""Tracks as a table with a row per marker seen, and that table as CSV.

Columns `frame, time, id, x, y, z, sx, sy, sz` (s, mm). A frame in which nothing was seen has one
row, and a marker that was never seen one in the first frame, with `nan` for what is not known.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.storage.files import replacing

# How much memory a file of tracks may ask for.
#
# Tracks are a table of frames by markers, in which a file may leave out what was not seen: a damaged
# or hostile one of some kB, every row of which names another frame and another marker, would fill all
# memory there is. So what is read may take at most 64 MB and a hundred times the size of the file: in
# CSV a marker then has to be seen in about every hundredth frame.

_FREE, _TIMES = 64_000_000, 100  # bytes; the size of the file
#: Bytes of a marker in a frame: its place and its standard deviations.
CELL = 48


def check_size(path: Path, needed: int) -> None:
    """Raises CaptureError where so many bytes of memory are out of all proportion to the file."""
    size = path.stat().st_size
    if needed > _FREE + _TIMES * size:
        raise CaptureError(
            f"{path}: its tracks would take {needed / 1e6:.0f} MB of memory, out of all proportion"
            f" to a file of {size / 1e6:.3g} MB; check its numbers of frames and markers",
            code="tracks-too-large",
        )


COLUMNS = ("frame", "time", "id", "x", "y", "z", "sx", "sy", "sz")
_HEADER = ",".join(COLUMNS)
_ROW = "%d,%.9f,%d,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n"
_BLOCK = 1000  # frames written at once


def to_rows(tracks: Tracks, never: Bool | None = None) -> Float:
    """The table (r, 9), by frame and in it by marker as the tracks have them; with rows in the
    first frame for the markers (m,) that are `never` seen."""
    rows = tracks.seen
    if rows.size:
        rows[0] |= never_seen(tracks) if never is None else never
        rows[~rows.any(axis=1), 0] = True
    t, m = np.nonzero(rows)
    return np.column_stack(
        [tracks.frame[t], tracks.time[t], tracks.ids[m], tracks.points[t, m], tracks.sigma[t, m]]
    ).astype(float)


def never_seen(tracks: Tracks) -> Bool:
    """Which markers (m,)."""
    return np.asarray(~tracks.seen.any(axis=0))


def from_rows(path: Path, rows: Float, where: Callable[[int], str]) -> Tracks:
    """Tracks of a file's table (r, 9) in any order, markers by number. Raises CaptureError that
    begins with `where(row)` for what cannot be, and for frames and markers out of all proportion to
    the file."""

    def refuse(wrong: Bool, code: str, why: Callable[[int], str]) -> None:
        if wrong.any():
            row = int(np.argmax(wrong))
            raise CaptureError(f"{where(row)}: {why(row)}", code=code, row=row + 1)

    absent = np.isnan(rows[:, 3:]).all(1)
    for i, name in enumerate(COLUMNS[:6]):
        wrong = ~np.isfinite(rows[:, i]) & ~(absent & (i >= 3))
        refuse(wrong, "not-a-number", lambda _, name=name: f"{name} is not a finite number")  # type: ignore[misc]
    for i in (0, 2):
        wrong = np.asarray((rows[:, i] != np.rint(rows[:, i])) | (np.abs(rows[:, i]) >= 2.0**53))
        refuse(
            wrong,
            "not-a-whole-number",
            lambda r, i=i: f"{COLUMNS[i]} {rows[r, i]:g} is not a whole number",
        )  # type: ignore[misc]
    known = np.isfinite(rows[:, 6:]).all(1) & (rows[:, 6:] >= 0).all(1)
    refuse(
        np.asarray(~(known | np.isnan(rows[:, 6:]).all(1))),
        "sigma-invalid",
        lambda _: "sx, sy, sz are standard deviations: three numbers of at least 0, or three nan",
    )
    order = np.lexsort((rows[:, 2], rows[:, 0]))
    sorted_ = rows[order]
    frame, first, at = np.unique(sorted_[:, 0], return_index=True, return_inverse=True)
    ids, column = np.unique(sorted_[:, 2], return_inverse=True)
    time = sorted_[first, 1]

    twice = np.zeros(len(rows), bool)
    twice[order[1:]] = (np.diff(sorted_[:, [0, 2]], axis=0) == 0).all(1)
    refuse(
        twice,
        "marker-repeated",
        lambda r: f"frame {rows[r, 0]:.0f} has marker {rows[r, 2]:.0f} twice",
    )
    other = np.zeros(len(rows), bool)
    other[order] = sorted_[:, 1] != time[at]
    refuse(other, "times-differ", lambda r: f"frame {rows[r, 0]:.0f} has two times; it needs one")
    back = np.zeros(len(rows), bool)
    back[order[first[1:]]] = np.diff(time) <= 0
    refuse(
        back,
        "times-not-increasing",
        lambda r: f"the time {rows[r, 1]:g} s is not later than that of the frame before",
    )

    check_size(path, len(frame) * len(ids) * CELL)
    points = np.full((len(frame), len(ids), 3), np.nan)
    sigma = points.copy()
    points[at, column], sigma[at, column] = sorted_[:, 3:6], sorted_[:, 6:]
    return Tracks(time, _whole(ids), points, sigma, _whole(frame))


def _whole(values: Float) -> Int:
    return values.astype(np.int64)


def write_tracks(path: Path, tracks: Tracks) -> None:
    """The table as CSV: times to 1 ns, places to 1 nm, `nan` where not known. Raises StorageError
    where it cannot be written."""
    never = never_seen(tracks)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(_HEADER + "\n")
        for k in range(0, len(tracks.time), _BLOCK):
            rows = to_rows(tracks.part(slice(k, k + _BLOCK)), never & (k == 0))
            file.write((_ROW * len(rows)) % tuple(rows.ravel().tolist()))


def read_tracks(path: Path) -> Tracks:
    """From CSV as `write_tracks` writes it. Raises CaptureError with the line for what is not."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None
    except UnicodeDecodeError:
        raise CaptureError(
            f"{path}: is no table of tracks (not text)", code="not-a-tracks-file"
        ) from None
    if not lines or lines[0].strip() != _HEADER:
        found = repr(lines[0][:60]) if lines else "nothing"
        raise CaptureError(
            f"{path}:1: the first line must be {_HEADER}, not {found}", code="header-wrong", line=1
        )
    numbers = [i for i, line in enumerate(lines[1:], 2) if line.strip()]
    rows = _table(path, numbers, [lines[i - 1] for i in numbers])
    return from_rows(path, rows, lambda row: f"{path}:{numbers[row]}")


def _table(path: Path, numbers: list[int], lines: list[str]) -> Float:
    """The cells (r, 9)."""
    if not lines:
        return np.empty((0, len(COLUMNS)))
    try:
        table = np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
        if table.shape[1] == len(COLUMNS):
            return table
    except ValueError:
        pass
    for number, line in zip(numbers, lines, strict=True):
        cells = line.split(",")
        if len(cells) != len(COLUMNS):
            raise CaptureError(
                f"{path}:{number}: {len(cells)} cells under {len(COLUMNS)} columns; a row is"
                f" {_HEADER}",
                code="cell-count-differs",
                line=number,
                count=len(cells),
            )
        for name, cell in zip(COLUMNS, cells, strict=True):
            try:
                float(cell)
            except ValueError:
                raise CaptureError(
                    f"{path}:{number}: {name} is not a number: {cell[:40]!r}",
                    code="not-a-number",
                    line=number,
                    column=name,
                    value=cell[:40],
                ) from None
    raise CaptureError(f"{path}: is no table of numbers", code="not-a-tracks-file")
