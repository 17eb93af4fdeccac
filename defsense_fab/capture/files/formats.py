"""Tracks in the files of others, by the suffix of the name."""

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
from ...core.storage.files import replacing
from .c3d import read_c3d, write_c3d
from .track_conversion import WrittenFrames, frame_grid, on_even_frames
from .tracks_csv import COLUMNS, check_size, from_rows, read_tracks, to_rows, write_tracks
from .trc import read_trc, write_trc

_ARRAYS = {"time": float, "ids": np.int64, "points": float, "sigma": float, "frame": np.int64}


def check_suffix(path: Path) -> None:
    """Raises CaptureError for a name whose suffix is of no format."""
    _format(path)


def write_any(path: Path, tracks: Tracks) -> WrittenFrames:
    """As .csv, .npz, .parquet, .c3d or .trc, with the frames of `on_even_frames`: the same ones in
    all formats. Raises CaptureError for other suffixes, tracks that the format cannot hold and
    libraries that are missing; StorageError."""
    write = _format(path)[1]
    whole, written = on_even_frames(tracks)
    write(path, whole)
    if path.suffix.lower() == ".c3d":  # its times follow from its rate
        grid = frame_grid(whole.time)
        assert grid is not None  # what has no rate was refused
        written = replace(written, moved=float(grid.off.max() * grid.period))
    return written


def read_any(path: Path) -> Tracks:
    """From .csv, .npz, .parquet, .c3d or .trc. Raises CaptureError for other suffixes, files that
    are wrong and libraries that are missing."""
    return _format(path)[0](path)


def write_npz(path: Path, tracks: Tracks) -> None:
    """All of the record, by its names, compressed."""
    arrays = {name: np.asarray(getattr(tracks, name), kind) for name, kind in _ARRAYS.items()}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_npz(path: Path) -> Tracks:
    """As `write_npz` writes it. Raises CaptureError for what is not."""
    try:
        with zipfile.ZipFile(path) as archive:
            check_size(path, sum(entry.file_size for entry in archive.infolist()))
        with path.open("rb") as whole, np.load(whole, allow_pickle=False) as file:
            found = {name: np.asarray(file[name]) for name in _ARRAYS}
    except KeyError as error:
        raise CaptureError(
            f"{path}: is no NPZ of tracks: {error.args[0]}",
            code="array-missing",
            name=error.args[0],
        ) from None
    except FileNotFoundError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None
    except (OSError, EOFError, ValueError, TypeError, MemoryError, zipfile.BadZipFile):
        raise CaptureError(
            f"{path}: is no whole NPZ file; copy or write it again", code="file-damaged"
        ) from None
    for name, kind in _ARRAYS.items():
        if not np.can_cast(found[name].dtype, kind, "same_kind"):
            raise CaptureError(
                f"{path}: {name} has no numbers of the right kind", code="not-a-number", name=name
            )
        if name in ("time", "ids", "frame") and found[name].ndim != 1:
            raise CaptureError(f"{path}: {name} must be a list", code="shape-wrong", name=name)
    try:
        return Tracks(**{name: found[name].astype(kind) for name, kind in _ARRAYS.items()})
    except CaptureError as error:
        raise CaptureError(f"{path}: {error}", code=error.code, **error.data) from None


def write_parquet(path: Path, tracks: Tracks) -> None:
    """The columns of the CSV, in full precision."""
    arrow, parquet = _libraries(path)
    rows = to_rows(tracks)
    columns = {
        name: rows[:, i].astype(np.int64) if name in ("frame", "id") else rows[:, i]
        for i, name in enumerate(COLUMNS)
    }
    with replacing(path) as temporary:
        parquet.write_table(arrow.table(columns), temporary)


def read_parquet(path: Path) -> Tracks:
    """A table with the columns of the CSV, others ignored. Raises CaptureError for what is not."""
    arrow, parquet = _libraries(path)
    try:
        with path.open("rb") as file:
            whole = parquet.ParquetFile(file)
            names = whole.schema_arrow.names
            missing = [name for name in COLUMNS if name not in names]
            if missing:
                raise CaptureError(
                    f"{path}: has no column {missing[0]}; it needs {', '.join(COLUMNS)}",
                    code="column-missing",
                    column=missing[0],
                )
            check_size(path, whole.metadata.num_rows * len(COLUMNS) * 8)
            table = whole.read(columns=list(COLUMNS))
    except (arrow.ArrowException, EOFError):
        raise CaptureError(
            f"{path}: is no whole Parquet file; copy or write it again", code="file-damaged"
        ) from None
    except OSError as error:
        raise CaptureError(
            f"{path}: cannot be read: {error.strerror or error}", code="file-unreadable"
        ) from None
    try:
        columns = [np.asarray(table[name].to_numpy(), float) for name in COLUMNS]
    except (ValueError, TypeError):
        raise CaptureError(f"{path}: its columns must be numbers", code="not-a-number") from None
    return from_rows(path, np.column_stack(columns), lambda row: f"{path}: row {row + 1}")


def _libraries(path: Path) -> tuple[Any, Any]:
    with optional(CaptureError, path, "exchange"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow, pyarrow.parquet


_Format = tuple[Callable[[Path], Tracks], Callable[[Path, Tracks], None]]
_FORMATS: dict[str, _Format] = {
    ".csv": (read_tracks, write_tracks),
    ".npz": (read_npz, write_npz),
    ".parquet": (read_parquet, write_parquet),
    ".c3d": (lambda path: read_c3d(path).tracks, write_c3d),
    ".trc": (lambda path: read_trc(path).tracks, write_trc),
}


def _format(path: Path) -> _Format:
    if path.suffix.lower() not in _FORMATS:
        raise CaptureError(
            f"{path}: tracks are files named {', '.join(_FORMATS)}; choose one of these suffixes",
            code="unknown-file-format",
            suffixes=tuple(_FORMATS),
        )
    return _FORMATS[path.suffix.lower()]
