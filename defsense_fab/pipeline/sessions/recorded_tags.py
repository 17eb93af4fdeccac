"""The tags that a camera recorded in a run, read some thousand lines at a time.

An hour of one camera is a file of 400 MB: its tags go to a store as they are read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...capture.tags.tag_detection import TagView
from ...capture.tracking.tag_store import FrameTags, TagStore
from ...core.append_log import is_damaged, was_cut
from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from .session import FRAME_COLUMNS, TAG_COLUMNS

_BLOCK = 1 << 22  # bytes read at once


@dataclass(frozen=True)
class CameraRecording:
    """What one camera recorded in a run: of f pictures when they were taken, `time` (f,) ns, and
    how bright the LED was, `led` (f,), NaN where not known; the tags in each; lines that were
    cut."""

    time: Int
    led: Float
    tags: FrameTags
    cut: int


def read_camera_tags(run: Path, name: str, ids: Int) -> CameraRecording:
    """Of the tags `ids` (m,) alone. Raises CaptureError with file and line for what cannot be read,
    StorageError where the tags cannot be kept in the run's folder."""
    frames, cut = [np.zeros((0, len(FRAME_COLUMNS)))], 0
    for rows, lost in _blocks(run / f"{name}-frames.csv", FRAME_COLUMNS):
        frames.append(rows)
        cut += lost
    table = np.concatenate(frames)
    store, numbers = TagStore(run), [np.zeros(0)]
    for rows, lost in _blocks(run / f"{name}.csv", TAG_COLUMNS):
        rows = rows[np.isin(rows[:, 2], ids)]
        store.add(_view(rows))
        numbers.append(rows[:, 0].copy())
        cut += lost
    of = np.concatenate(numbers)
    if (np.diff(of) < 0).any():  # as where a digit of a frame's number is damaged
        order = np.argsort(of, kind="stable")
        store, of = _sorted(store, order, run), of[order]
    first, last = (np.searchsorted(of, table[:, 0], side) for side in ("left", "right"))
    tags = FrameTags(store, np.asarray(first), np.asarray(last))
    return CameraRecording(table[:, 1].astype(np.int64), table[:, 2], tags, cut)


def _view(rows: Float) -> TagView:
    """Of rows (n, columns)."""
    corners = rows[:, 3:11].reshape(-1, 4, 2)
    covariance = rows[:, 11:].reshape(-1, 4, 3)[..., [[0, 1], [1, 2]]]
    return TagView(rows[:, 2].astype(np.int64), corners, covariance, corners)


def _sorted(store: TagStore, order: Int, folder: Path) -> TagStore:
    """Another one with the tags in this order (n,)."""
    out = TagStore(folder)
    for part in np.array_split(order, len(order) // 20_000 + 1):
        rows = store.read(part)
        out.add(TagView(rows["id"], rows["corners"], rows["covariance"], rows["corners"]))
    return out


def _blocks(path: Path, columns: Sequence[str]) -> Iterator[tuple[Float, int]]:
    """Numbers (n, columns) of a stream, and how many lines were cut or damaged, block by block."""
    try:
        with path.open("rb") as file:
            head = file.readline()
            if not head.endswith(b"\n"):
                yield np.zeros((0, len(columns))), int(bool(head))
                return
            if head.rstrip(b"\r\n").decode(errors="replace") != ",".join(columns):
                raise CaptureError(f"{path}:1: the columns must be {','.join(columns)}")
            number, left = 2, b""
            while data := file.read(_BLOCK):
                whole, end, left = (left + data).rpartition(b"\n")
                if end:
                    lines = whole.decode(errors="replace").replace("\r\n", "\n").split("\n")
                    yield _numbers(path, number, lines, len(columns))
                    number += len(lines)
            yield np.zeros((0, len(columns))), int(bool(left))
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror}") from None


def _numbers(path: Path, first: int, lines: list[str], width: int) -> tuple[Float, int]:
    """The cells of lines, of which the first has the number `first`, and how many were damaged."""
    good = [
        (k, line) for k, line in enumerate(lines, first) if not (was_cut(line) or is_damaged(line))
    ]
    cut = len(lines) - len(good)
    if not good:
        return np.zeros((0, width)), cut
    try:
        if all(line for _, line in good):
            table = np.loadtxt((line for _, line in good), delimiter=",", ndmin=2, comments=None)
            if table.shape[1] == width and np.isfinite(table[:, :2]).all():
                return table, cut
    except ValueError:
        pass
    out = np.empty((len(good), width))
    for row, (number, line) in enumerate(good):
        try:
            cells = np.array(line.split(","), float)
            if cells.shape != (width,) or not np.isfinite(cells[:2]).all():
                raise ValueError
        except ValueError:
            raise CaptureError(f"{path}:{number}: not {width} numbers: {line[:50]!r}") from None
        out[row] = cells
    return out, cut
