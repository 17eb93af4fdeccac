"""Read and write tracks in any format, chosen by the file's suffix."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import CaptureError
from ...core.machine.optional_libraries import optional
from ...core.markers import Tracks
from ...core.storage.files import replace_file
from .absent_markers import hide_absent
from .c3d import read_c3d, write_c3d
from .length_units import LengthUnit, require_mm
from .marker_labels import marker_labels
from .track_conversion import WrittenFrames, frame_grid, on_even_frames
from .track_file import TrackFile
from .tracks_csv import (
    COLUMNS,
    check_size,
    from_rows,
    read_csv,
    to_rows,
    unreadable_error,
    write_csv,
)
from .trc import read_trc, write_trc

_Reader = Callable[[Path, LengthUnit | None], TrackFile]
_ARRAYS = {"time": float, "ids": np.int64, "points": float, "sigma": float, "frame": np.int64}


def check_suffix(path: Path) -> None:
    """Check that a file's suffix belongs to a format.

    Raises:
        CaptureError: If it does not.
    """
    _format(path)


def write_tracks(path: Path, tracks: Tracks) -> WrittenFrames:
    """Write tracks as .csv, .npz, .parquet, .c3d or .trc.

    All formats get the same frames, those of `on_even_frames`.

    Returns:
        The frames that were written.

    Raises:
        CaptureError: If the suffix is unknown, the format cannot hold the tracks, or a library is
            missing.
        StorageError: If the file cannot be written.
    """
    write = _format(path)[1]
    even_tracks, written = on_even_frames(tracks)
    write(path, even_tracks)
    if path.suffix.lower() == ".c3d":  # its times follow from its rate
        grid = frame_grid(even_tracks.time)
        assert grid is not None  # tracks without a rate were refused
        written = replace(written, max_time_shift=float(grid.deviation.max() * grid.period))
    return written


def read_tracks(path: Path) -> Tracks:
    """Read tracks from .csv, .npz, .parquet, .c3d or .trc.

    Raises:
        CaptureError: If the suffix is unknown, the file is invalid, or a library is missing.
    """
    return read_track_file(path).tracks


def read_track_file(path: Path, unit: LengthUnit | None = None) -> TrackFile:
    """Read tracks from .csv, .npz, .parquet, .c3d or .trc, and what was left out or assumed.

    Args:
        path: The file.
        unit: Unit of the positions in files that do not state it.

    Raises:
        CaptureError: If the suffix is unknown, the file is invalid, a library is missing, or the
            file states another unit (`unit-conflict`).
    """
    return _format(path)[0](path, unit)


def _numbered(read: Callable[[Path], Tracks], *, is_own: bool = False) -> _Reader:
    """Return a reader of a format that has numbered markers in mm.

    Args:
        read: Reads the format.
        is_own: Whether only this package writes the format, so that 0, 0, 0 is a position.
    """

    def read_file(path: Path, unit: LengthUnit | None) -> TrackFile:
        require_mm(path, unit)
        tracks = read(path)
        labels = marker_labels(tracks.ids)
        points, notes = hide_absent(tracks.points, labels, tracks.sigma, is_own=is_own)
        return TrackFile(replace(tracks, points=points), notes=tuple(notes))

    return read_file


def _read_csv_file(path: Path, unit: LengthUnit | None) -> TrackFile:
    notes = list[str]()
    file = _numbered(lambda csv: read_csv(csv, notes))(path, unit)
    return replace(file, notes=(*notes, *file.notes))


def write_npz(path: Path, tracks: Tracks) -> None:
    """Write all arrays of the tracks by name, compressed."""
    arrays = {name: np.asarray(getattr(tracks, name), kind) for name, kind in _ARRAYS.items()}
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_npz(path: Path) -> Tracks:
    """Read tracks as `write_npz` writes them.

    Raises:
        CaptureError: If the file is not such a file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            check_size(path, sum(entry.file_size for entry in archive.infolist()))
        with path.open("rb") as content, np.load(content, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in _ARRAYS}
    except KeyError as error:
        raise CaptureError(
            f"is not an NPZ file of tracks: {error.args[0]}",
            code="array-missing",
            where=path,
            action="Choose another file",
            name=error.args[0],
        ) from None
    except FileNotFoundError as error:
        raise unreadable_error(path, error) from None
    except (OSError, EOFError, ValueError, TypeError, MemoryError, zipfile.BadZipFile):
        raise _damaged(path, "NPZ") from None
    for name, kind in _ARRAYS.items():
        if not np.can_cast(arrays[name].dtype, kind, "same_kind"):
            raise CaptureError(
                f"the array {name} does not hold numbers of the right kind",
                code="not-a-number",
                where=path,
                action="Write the file again",
                name=name,
            )
        if name in ("time", "ids", "frame") and arrays[name].ndim != 1:
            raise CaptureError(
                f"the array {name} must have one dimension",
                code="wrong-shape",
                where=path,
                action="Write the file again",
                name=name,
            )
    try:
        return Tracks(**{name: arrays[name].astype(kind) for name, kind in _ARRAYS.items()})
    except CaptureError as error:
        raise CaptureError(
            error.problem, code=error.code, where=path, action=error.action, **error.data
        ) from None


def write_parquet(path: Path, tracks: Tracks) -> None:
    """Write the columns of the CSV in full precision."""
    arrow, parquet = _libraries(path)
    rows = to_rows(tracks)
    columns = {
        name: rows[:, i].astype(np.int64) if name in ("frame", "id") else rows[:, i]
        for i, name in enumerate(COLUMNS)
    }
    with replace_file(path) as temporary:
        parquet.write_table(arrow.table(columns), temporary)


def read_parquet(path: Path) -> Tracks:
    """Read a table with the columns of the CSV; other columns are ignored.

    Raises:
        CaptureError: If the file is not such a table.
    """
    arrow, parquet = _libraries(path)
    try:
        with path.open("rb") as content:
            file = parquet.ParquetFile(content)
            names = file.schema_arrow.names
            missing = [name for name in COLUMNS if name not in names]
            if missing:
                raise CaptureError(
                    f"has no column {missing[0]}",
                    code="column-missing",
                    where=path,
                    action=f"Write the columns {', '.join(COLUMNS)}",
                    column=missing[0],
                )
            check_size(path, file.metadata.num_rows * len(COLUMNS) * 8)
            table = file.read(columns=list(COLUMNS))
    except (arrow.ArrowException, EOFError):
        raise _damaged(path, "Parquet") from None
    except OSError as error:
        raise unreadable_error(path, error) from None
    try:
        columns = [np.asarray(table[name].to_numpy(), float) for name in COLUMNS]
    except (ValueError, TypeError):
        raise CaptureError(
            "its columns must be numbers",
            code="not-a-number",
            where=path,
            action="Write the file again",
        ) from None
    return from_rows(path, np.column_stack(columns), lambda row: f"{path}: row {row + 1}")


def _damaged(path: Path, kind: str) -> CaptureError:
    return CaptureError(
        f"is not a complete {kind} file",
        code="file-damaged",
        where=path,
        action="Copy or write it again",
    )


def _libraries(path: Path) -> tuple[Any, Any]:
    with optional(CaptureError, path, "exchange"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow, pyarrow.parquet


_FORMATS: dict[str, tuple[_Reader, Callable[[Path, Tracks], None]]] = {
    ".csv": (_read_csv_file, write_csv),
    ".npz": (_numbered(read_npz, is_own=True), write_npz),
    ".parquet": (_numbered(read_parquet), write_parquet),
    ".c3d": (read_c3d, write_c3d),
    ".trc": (read_trc, write_trc),
}


def _format(path: Path) -> tuple[_Reader, Callable[[Path, Tracks], None]]:
    if path.suffix.lower() not in _FORMATS:
        raise CaptureError(
            f"tracks are stored in files named {', '.join(_FORMATS)}",
            code="unknown-format",
            where=path,
            action="Choose one of these suffixes",
            suffixes=tuple(_FORMATS),
        )
    return _FORMATS[path.suffix.lower()]
