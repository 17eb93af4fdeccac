"""Read the tags that a camera recorded in a run, some thousand lines at a time.

An hour of one camera is a file of 400 MB, so its tags go to a store as they are read.
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

MAX_PIXEL = 1e5  # px, and px^2 for variances; no image is as large
BLOCK_BYTES = 1 << 20
#: A time is isolated if it is farther than both limits from its neighbors: in ns, and in usual
#: steps. At least this many times are needed to judge that.
MIN_TIMES, MIN_ISOLATION_NS, ISOLATION_STEPS = 5, 60e9, 30.0


@dataclass(frozen=True)
class CameraRecording:
    """What one camera recorded in a run.

    Attributes:
        frame: Numbers of the images (f,).
        time: When they were taken (f,), ns.
        led: Brightness of the LED (f,), NaN where not known.
        tags: Tags in each image.
        cut: Number of lines that were cut or damaged.
    """

    frame: Int
    time: Int
    led: Float
    tags: FrameTags
    cut: int


def read_camera_tags(run: Path, name: str, ids: Int) -> CameraRecording:
    """Read the tags that a camera recorded.

    Lines with invalid numbers, and frames whose times go back, are left out.

    Args:
        run: Folder of the run.
        name: Name of the camera.
        ids: Numbers of the tags to read (m,).

    Raises:
        CaptureError: If a file cannot be read.
        StorageError: If the tags cannot be stored in the run's folder.
    """
    frames, cut = [np.zeros((0, len(FRAME_COLUMNS)))], 0
    for rows, damaged in _read_blocks(run / f"{name}-frames.csv", FRAME_COLUMNS):
        frames.append(rows)
        cut += damaged
    table = np.concatenate(frames)
    is_kept = _keep_increasing(table[:, 1])
    table, cut = table[is_kept], cut + int((~is_kept).sum())
    store, numbers = TagStore(run), [np.zeros(0)]
    for rows, damaged in _read_blocks(run / f"{name}.csv", TAG_COLUMNS):
        rows = rows[np.isin(rows[:, 2], ids)]
        is_good = _is_plausible(rows)
        rows, damaged = rows[is_good], damaged + int((~is_good).sum())
        store.add(_to_view(rows))
        numbers.append(rows[:, 0].copy())
        cut += damaged
    frame_of_tag = np.concatenate(numbers)
    if (np.diff(frame_of_tag) < 0).any():  # for example by a damaged digit of a frame's number
        order = np.argsort(frame_of_tag, kind="stable")
        store, frame_of_tag = _reorder(store, order, run), frame_of_tag[order]
    first, last = (np.searchsorted(frame_of_tag, table[:, 0], side) for side in ("left", "right"))
    tags = FrameTags(store, np.asarray(first), np.asarray(last))
    frame = np.where(np.isfinite(table[:, 0]), table[:, 0], -1).astype(np.int64)
    return CameraRecording(frame, table[:, 1].astype(np.int64), table[:, 2], tags, cut)


def _keep_increasing(time: Float) -> Bool:
    """Return which times (n,) are kept so that they increase: as many as possible.

    Times far from all their neighbors are damaged and are dropped first, because a damaged first or
    last time may be in order.
    """
    kept = _not_isolated(time)
    kept[kept] = _longest_increasing(time[kept])
    return kept


def _not_isolated(time: Float) -> Bool:
    """Return which times (n,) are close to one of the two before or after them."""
    steps = np.diff(time)
    if len(time) < MIN_TIMES or not (steps > 0).any():
        return np.ones(len(time), bool)
    # Cameras may stall for seconds; a digit too many or too few is hours.
    limit = max(ISOLATION_STEPS * float(np.median(steps[steps > 0])), MIN_ISOLATION_NS)
    has_neighbor = np.zeros(len(time), bool)
    for distance in (1, 2):
        close = np.abs(time[distance:] - time[:-distance]) <= limit
        has_neighbor[distance:] |= close
        has_neighbor[:-distance] |= close
    return has_neighbor


def _longest_increasing(time: Float) -> Bool:
    """Return which times (n,) are kept so that they increase: as many as possible."""
    if (np.diff(time) > 0).all():
        return np.ones(len(time), bool)
    ends: list[float] = []  # smallest last time of a chain of each length
    chain_ends: list[int] = []
    previous = np.full(len(time), -1)
    for k, t in enumerate(time.tolist()):
        length = bisect_left(ends, t)
        previous[k] = chain_ends[length - 1] if length else -1
        ends[length : length + 1], chain_ends[length : length + 1] = [t], [k]
    kept = np.zeros(len(time), bool)
    k = chain_ends[-1]
    while k >= 0:
        kept[k] = True
        k = int(previous[k])
    return kept


def _is_plausible(rows: Float) -> Bool:
    """Return which rows (n, columns) have possible corners and variances."""
    variances = rows[:, 11:].reshape(-1, 5, 3)
    xx, xy, yy = variances[..., 0], variances[..., 1], variances[..., 2]
    with np.errstate(invalid="ignore"):
        positive = (xx > 0) & (yy > 0) & (xx * yy > xy * xy) & (xx + yy < MAX_PIXEL)
        return np.asarray((np.abs(rows[:, 3:11]) < MAX_PIXEL).all(axis=1) & positive.all(axis=1))


def _to_view(rows: Float) -> TagView:
    """Return rows (n, columns) as a view."""
    corners = rows[:, 3:11].reshape(-1, 4, 2)
    covariance = rows[:, 11:].reshape(-1, 5, 3)[..., [[0, 1], [1, 2]]]
    return TagView(rows[:, 2].astype(np.int64), corners, covariance, corners)


def _reorder(store: TagStore, order: Int, folder: Path) -> TagStore:
    """Return a store with the tags in another order (n,)."""
    reordered = TagStore(folder)
    for part in np.array_split(order, len(order) // 20_000 + 1):
        rows = store.read(part)
        reordered.add(TagView(rows["id"], rows["corners"], rows["covariance"], rows["corners"]))
    return reordered


def _read_blocks(path: Path, columns: Sequence[str]) -> Iterator[tuple[Float, int]]:
    """Read the numbers of a stream in blocks.

    Args:
        path: File of the stream.
        columns: Names of the columns.

    Yields: Numbers (n, columns), and how many lines were cut or damaged.
    """
    try:
        with path.open("rb") as file:
            head = file.readline()
            if not head.endswith(b"\n"):
                yield np.zeros((0, len(columns))), int(bool(head))
                return
            names = tuple(head.rstrip(b"\r\n").decode(errors="replace").split(","))
            if names != tuple(columns):
                raise CaptureError(
                    f"the columns must be {','.join(columns)}",
                    code="header-wrong",
                    where=f"{path}:1",
                    action="Record again",
                    line=1,
                )
            rest = b""
            while data := file.read(BLOCK_BYTES):
                complete, end, rest = (rest + data).rpartition(b"\n")
                if end:
                    lines = complete.decode(errors="replace").replace("\r\n", "\n").split("\n")
                    rows, cut = _parse_lines(lines, len(names))
                    yield rows, cut
            yield np.zeros((0, len(columns))), int(bool(rest))
    except OSError as error:
        raise CaptureError(
            f"cannot be read: {error.strerror}",
            code="file-unreadable",
            where=path,
            action="Check that the file exists",
        ) from None


def _parse_lines(lines: Sequence[str], width: int) -> tuple[Float, int]:
    """Return the cells of intact lines (n, width), and how many lines were left out."""
    intact = [line for line in lines if not (was_cut(line) or is_damaged(line))]
    try:
        if intact and all(intact):
            table = np.loadtxt(intact, delimiter=",", ndmin=2, comments=None)
            if table.shape[1] == width and np.isfinite(table[:, :2]).all():
                return table, len(lines) - len(intact)
    except ValueError:
        pass
    rows = [cells for line in intact if (cells := _parse_line(line, width)) is not None]
    return np.array(rows).reshape(-1, width), len(lines) - len(rows)


def _parse_line(line: str, width: int) -> Float | None:
    """Return the numbers of a line (width,); None if it is invalid."""
    try:
        cells = np.array(line.split(","), float)
    except ValueError:
        return None
    return cells if cells.shape == (width,) and np.isfinite(cells[:2]).all() else None
