"""The tags that a camera recorded in a run, read some thousand lines at a time.

An hour of one camera is a file of 400 MB: its tags go to a store as they are read.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import CaptureError
from ...core.storage.append_log import is_damaged, was_cut
from ..tags.detection import TagView
from ..tracking.observations import FrameTags, TagStore
from .session import FRAME_COLUMNS, TAG_COLUMNS

_WITHOUT_MEAN = len(TAG_COLUMNS) - 3  # columns of older files
_FAR = 1e5  # px, and px^2: no image is as large
_BLOCK = 1 << 20  # bytes read at once
#: Times of a file that tell what is far from the others; ns, and usual steps, that are.
_FEWEST, _ALONE, _STEPS = 5, 60e9, 30.0


@dataclass(frozen=True)
class CameraRecording:
    """What one camera recorded in a run: of f pictures their numbers `frame` (f,), when they were
    taken, `time` (f,) ns, and how bright the LED was, `led` (f,), NaN where not known; the tags in
    each; lines that were cut."""

    frame: Int
    time: Int
    led: Float
    tags: FrameTags
    cut: int


def read_camera_tags(run: Path, name: str, ids: Int) -> CameraRecording:
    """Of the tags `ids` (m,) alone; lines with what is no number, and frames whose times go back,
    are left out. Raises CaptureError for a file that cannot be read, StorageError where the tags
    cannot be kept in the run's folder."""
    frames, cut = [np.zeros((0, len(FRAME_COLUMNS)))], 0
    for rows, lost in _blocks(run / f"{name}-frames.csv", FRAME_COLUMNS):
        frames.append(rows)
        cut += lost
    table = np.concatenate(frames)
    forward = _forward(table[:, 1])
    table, cut = table[forward], cut + int((~forward).sum())
    store, numbers = TagStore(run), [np.zeros(0)]
    for rows, lost in _blocks(run / f"{name}.csv", TAG_COLUMNS, older=_WITHOUT_MEAN):
        rows = rows[np.isin(rows[:, 2], ids)]
        good = _plausible(rows)
        rows, lost = rows[good], lost + int((~good).sum())
        store.add(_view(rows))
        numbers.append(rows[:, 0].copy())
        cut += lost
    of = np.concatenate(numbers)
    if (np.diff(of) < 0).any():  # as where a digit of a frame's number is damaged
        order = np.argsort(of, kind="stable")
        store, of = _sorted(store, order, run), of[order]
    first, last = (np.searchsorted(of, table[:, 0], side) for side in ("left", "right"))
    tags = FrameTags(store, np.asarray(first), np.asarray(last))
    frame = np.where(np.isfinite(table[:, 0]), table[:, 0], -1).astype(np.int64)
    return CameraRecording(frame, table[:, 1].astype(np.int64), table[:, 2], tags, cut)


def _forward(time: Float) -> Bool:
    """Which times (n,) are kept so that those increase: as many as can be of those that are not far
    from all near them, as a damaged one is, which the first and the last may be and increase."""
    keep = _in_company(time)
    keep[keep] = _increasing(time[keep])
    return keep


def _in_company(time: Float) -> Bool:
    """Which times (n,) have another close by among the two before and the two after them."""
    steps = np.diff(time)
    if len(time) < _FEWEST or not (steps > 0).any():
        return np.ones(len(time), bool)
    # Cameras may stall for seconds; a digit too many or too few is hours.
    far = max(_STEPS * float(np.median(steps[steps > 0])), _ALONE)
    near = np.zeros(len(time), bool)
    for apart in (1, 2):
        close = np.abs(time[apart:] - time[:-apart]) <= far
        near[apart:] |= close
        near[:-apart] |= close
    return near


def _increasing(time: Float) -> Bool:
    """Which times (n,) are kept so that those increase: as many as can be."""
    if (np.diff(time) > 0).all():
        return np.ones(len(time), bool)
    ends: list[float] = []  # the least time that a chain of each length ends with
    last: list[int] = []
    before = np.full(len(time), -1)
    for k, t in enumerate(time.tolist()):
        at = bisect_left(ends, t)
        before[k] = last[at - 1] if at else -1
        ends[at : at + 1], last[at : at + 1] = [t], [k]
    keep = np.zeros(len(time), bool)
    k = last[-1]
    while k >= 0:
        keep[k] = True
        k = int(before[k])
    return keep


def _plausible(rows: Float) -> Bool:
    """Which rows (n, columns) have corners that an image may hold, and variances."""
    spread = rows[:, 11:].reshape(-1, 5, 3)
    xx, xy, yy = spread[..., 0], spread[..., 1], spread[..., 2]
    with np.errstate(invalid="ignore"):
        positive = (xx > 0) & (yy > 0) & (xx * yy > xy * xy) & (xx + yy < _FAR)
        positive[:, 4] |= np.isnan(xx[:, 4])  # which older files do not have
        return np.asarray((np.abs(rows[:, 3:11]) < _FAR).all(axis=1) & positive.all(axis=1))


def _view(rows: Float) -> TagView:
    """Of rows (n, columns)."""
    corners = rows[:, 3:11].reshape(-1, 4, 2)
    covariance = rows[:, 11:].reshape(-1, 5, 3)[..., [[0, 1], [1, 2]]]
    old = np.isnan(covariance[:, 4, 0, 0])
    covariance[old, 4] = covariance[old, :4].mean(axis=1) / 4
    return TagView(rows[:, 2].astype(np.int64), corners, covariance, corners)


def _sorted(store: TagStore, order: Int, folder: Path) -> TagStore:
    """Another one with the tags in this order (n,)."""
    out = TagStore(folder)
    for part in np.array_split(order, len(order) // 20_000 + 1):
        rows = store.read(part)
        out.add(TagView(rows["id"], rows["corners"], rows["covariance"], rows["corners"]))
    return out


def _blocks(
    path: Path, columns: Sequence[str], older: int | None = None
) -> Iterator[tuple[Float, int]]:
    """Numbers (n, columns) of a stream, and how many lines were cut or damaged, block by block. A
    file may have the first `older` columns alone; the others are then NaN."""
    try:
        with path.open("rb") as file:
            head = file.readline()
            if not head.endswith(b"\n"):
                yield np.zeros((0, len(columns))), int(bool(head))
                return
            told = tuple(head.rstrip(b"\r\n").decode(errors="replace").split(","))
            if told not in (tuple(columns), tuple(columns[:older])):
                raise CaptureError(f"{path}:1: the columns must be {','.join(columns)}")
            left = b""
            while data := file.read(_BLOCK):
                whole, end, left = (left + data).rpartition(b"\n")
                if end:
                    lines = whole.decode(errors="replace").replace("\r\n", "\n").split("\n")
                    rows, cut = _numbers(lines, len(told))
                    lacking = np.full((len(rows), len(columns) - len(told)), np.nan)
                    yield np.hstack([rows, lacking]), cut
            yield np.zeros((0, len(columns))), int(bool(left))
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror}") from None


def _numbers(lines: Sequence[str], width: int) -> tuple[Float, int]:
    """The cells of lines (n, width), and how many lines were cut or damaged: they are left out."""
    good = [line for line in lines if not (was_cut(line) or is_damaged(line))]
    try:
        if good and all(good):
            table = np.loadtxt(good, delimiter=",", ndmin=2, comments=None)
            if table.shape[1] == width and np.isfinite(table[:, :2]).all():
                return table, len(lines) - len(good)
    except ValueError:
        pass
    rows = [cells for line in good if (cells := _cells(line, width)) is not None]
    return np.array(rows).reshape(-1, width), len(lines) - len(rows)


def _cells(line: str, width: int) -> Float | None:
    """The numbers of a line (width,), the first two of which must be finite."""
    try:
        cells = np.array(line.split(","), float)
    except ValueError:
        return None
    return cells if cells.shape == (width,) and np.isfinite(cells[:2]).all() else None
