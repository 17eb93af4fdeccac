"""Tags that cameras saw over time: their storage on disk, and positions between frames.

Six cameras that watch twenty tags for an hour see thirteen million of them, 1.8 GB. Each step of
the work needs only some seconds of them at a time, so they are stored in a temporary file.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.storage.files import storage_errors
from ..tags.detection import TagView

MAX_MEMORY_BYTES = 8_000_000  # of a camera's tags that are stored without a file
BLOCK_TAGS = 20_000  # processed together
ROW_TYPE = np.dtype(
    [("id", np.int64), ("corners", np.float64, (4, 2)), ("covariance", np.float32, (5, 2, 2))]
)


class TagStore:
    """Tags in sequence, in a temporary file that is deleted with this object.

    Covariances are stored in single precision.

    Args:
        folder: Folder of the file; the system's folder for temporary files by default.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._where = folder or Path(tempfile.gettempdir())
        self._file = tempfile.SpooledTemporaryFile(  # noqa: SIM115 - open as long as the store
            MAX_MEMORY_BYTES, dir=str(self._where)
        )
        self._count = 0
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return self._count

    def add(self, view: TagView) -> None:
        """Append the tags of a view.

        Raises:
            StorageError: If they cannot be written, for example because the disk is full.
        """
        rows = np.empty(len(view.ids), ROW_TYPE)
        rows["id"], rows["corners"], rows["covariance"] = view.ids, view.corners, view.covariance
        with storage_errors(self._where):
            self._file.seek(0, 2)
            self._file.write(rows.tobytes())
        self._count += len(rows)

    def read(self, indices: Int) -> NDArray[Any]:
        """Read tags; consecutive ones are read at once.

        Args:
            indices: Indices of the tags (n,).

        Returns:
            Rows (n,) with `id`, `corners` (4, 2), px without distortion, and `covariance` (5, 2,
            2), px^2, of each corner and last of their mean.
        """
        rows = np.empty(len(indices), ROW_TYPE)
        ends = np.append(np.flatnonzero(np.diff(indices) != 1) + 1, len(indices))
        start = 0
        for end in ends[ends > 0]:
            with storage_errors(self._where):
                self._file.seek(int(indices[start]) * ROW_TYPE.itemsize)
                data = self._file.read(int(end - start) * ROW_TYPE.itemsize)
            rows[start:end] = np.frombuffer(data, ROW_TYPE)
            start = int(end)
        return rows


@dataclass(frozen=True)
class FrameTags:
    """The tags in t frames of one camera.

    Attributes:
        store: Store of the tags.
        first: Index of each frame's first tag (t,).
        last: Index after each frame's last tag (t,).
    """

    store: TagStore
    first: Int
    last: Int

    @property
    def count(self) -> Int:
        """Number of tags in each frame (t,)."""
        return np.asarray(self.last - self.first)

    def only(self, frames: Bool | Int) -> FrameTags:
        """Return some of the frames."""
        return FrameTags(self.store, self.first[frames], self.last[frames])

    def without(self, frames: Bool) -> FrameTags:
        """Return the same frames, where those of a mask (t,) have no tags."""
        return FrameTags(self.store, self.first, np.where(frames, self.first, self.last))

    def find(self, frames: Int) -> tuple[Int, Int]:
        """Find all tags in frames.

        Args:
            frames: Indices of the frames (k,).

        Returns:
            Indices of the tags in the store (n,), and for each tag the position of its frame, 0 to
            k - 1.
        """
        first, count = self.first[frames], self.count[frames]
        position = np.repeat(np.arange(len(frames)), count)
        before = np.repeat(np.cumsum(count) - count, count)
        return first[position] + np.arange(len(position)) - before, position

    def survey(self) -> tuple[Int, Int]:
        """Return the numbers of all tags, and of those that some frame shows twice."""
        numbers, repeated = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for frames in frame_blocks(len(self.first), int(self.count.max(initial=1))):
            indices, position = self.find(frames)
            ids = self.store.read(indices)["id"]
            order = np.lexsort((ids, position))
            is_repeated = (np.diff(ids[order]) == 0) & (np.diff(position[order]) == 0)
            numbers.append(np.unique(ids))
            repeated.append(np.unique(ids[order][1:][is_repeated]))
        return np.unique(np.concatenate(numbers)), np.unique(np.concatenate(repeated))


def store_views(views: Iterable[TagView]) -> FrameTags:
    """Store the tags of consecutive frames.

    Raises:
        StorageError: If they cannot be written.
    """
    store, ends_list = TagStore(), [0]
    for view in views:
        store.add(view)
        ends_list.append(len(store))
    ends = np.array(ends_list, np.int64)
    return FrameTags(store, ends[:-1], ends[1:])


def frame_blocks(frames: int, tags: int, max_tags: int = BLOCK_TAGS) -> Iterator[Int]:
    """Divide frames into blocks that can be processed together.

    Args:
        frames: Number of frames.
        tags: Number of tags in a frame.
        max_tags: Largest number of tags in a block.

    Yields: Indices of the frames in each block.
    """
    step = max(max_tags // max(tags, 1), 1)
    for start in range(0, frames, step):
        yield np.arange(start, min(start + step, frames))


SIMULTANEOUS_S = 5e-4  # s: frames this near in time are taken as simultaneous
MAX_GAP_PERIODS = 2.5  # periods, between frames that are interpolated


@dataclass(frozen=True)
class Observations:
    """Observations of m tags in t frames of one camera.

    Attributes:
        time: Times of the frames (t,), s, increasing.
        ids: Numbers of the tags (m,).
        corners: Corners (t, m, 4, 2), px without distortion, NaN where not visible.
        covariance: Covariances (t, m, 5, 2, 2), px^2, of each corner and last of their mean.
    """

    time: Float
    ids: Int
    corners: Float
    covariance: Float


@dataclass(frozen=True)
class StoredObservations:
    """Observations that are read from a store when needed.

    Attributes:
        time: Times of the frames (t,), s, increasing.
        ids: Numbers of the tags (m,).
        tags: Tags in the frames.
        chosen: Whether each of the store's tags counts (n,).
    """

    time: Float
    ids: Int
    tags: FrameTags
    chosen: Bool

    def part(self, frames: Int) -> Observations:
        """Read the observations in some of the frames (k,)."""
        indices, position = self.tags.find(frames)
        is_chosen = self.chosen[indices]
        rows, position = self.tags.store.read(indices)[is_chosen], position[is_chosen]
        k, m = len(frames), len(self.ids)
        corners, covariance = np.full((k, m, 4, 2), np.nan), np.full((k, m, 5, 2, 2), np.nan)
        column = _columns(self.ids, rows["id"])
        corners[position, column] = rows["corners"]
        covariance[position, column] = rows["covariance"]
        return Observations(self.time[frames], self.ids, corners, covariance)

    def only(self, frames: Bool) -> StoredObservations:
        """Return the frames of a mask (t,)."""
        return replace(self, time=self.time[frames], tags=self.tags.only(frames))

    def without(self, frames: Bool) -> StoredObservations:
        """Return the same frames, where those of a mask (t,) show nothing."""
        return replace(self, tags=self.tags.without(frames))


def observe(time: Float, tags: FrameTags, ids: Int) -> StoredObservations:
    """Choose at most one tag of each number in each frame.

    If an image shows a number twice, the tag nearer to its last place is chosen; without a last
    place, none.

    Args:
        time: Times of the frames (t,), s.
        tags: Tags in the frames.
        ids: Numbers of the tags to observe (m,).
    """
    chosen = np.zeros(len(tags.store), bool)
    last = np.full((len(ids), 2), np.nan)
    for frames in frame_blocks(len(time), int(tags.count.max(initial=1))):
        indices, position = tags.find(frames)
        rows = tags.store.read(indices)
        column = _columns(ids, rows["id"])
        center = rows["corners"].mean(axis=1)
        is_requested = column >= 0
        cell = position * len(ids) + column
        order = np.argsort(np.where(is_requested, cell, -1), kind="stable")
        repeats = order[1:][(np.diff(cell[order]) == 0) & is_requested[order[1:]]]
        ambiguous = np.unique(column[repeats])
        is_single = is_requested & ~np.isin(column, ambiguous)
        chosen[indices[is_single]] = True
        last[column[is_single]] = center[is_single]  # of several the last one stays
        for k in ambiguous:
            candidates = np.flatnonzero(column == k)
            for group in np.split(candidates, np.flatnonzero(np.diff(position[candidates])) + 1):
                if len(group) > 1 and np.isnan(last[k]).any():
                    continue
                distance = np.linalg.norm(center[group] - last[k], axis=1)
                nearest = group[int(distance.argmin()) if len(group) > 1 else 0]
                chosen[indices[nearest]] = True
                last[k] = center[nearest]
    return StoredObservations(time, ids, tags, chosen)


def _columns(ids: Int, numbers: Int) -> Int:
    """Return the positions of numbers (n,) among the ids (m,); -1 for those that are not there."""
    if not len(ids):
        return np.full(len(numbers), -1)
    order = np.argsort(ids)
    column = order[np.clip(np.searchsorted(ids, numbers, sorter=order), 0, len(ids) - 1)]
    return np.asarray(np.where(ids[column] == numbers, column, -1))


def tag_centers(observations: StoredObservations) -> Float:
    """Return the centers of the tags (t, m, 2), px, NaN where not visible."""
    centers = np.empty((len(observations.time), len(observations.ids), 2))
    for frames in frame_blocks(len(observations.time), len(observations.ids)):
        centers[frames] = observations.part(frames).corners.mean(axis=2)
    return centers


def interpolate(
    observations: StoredObservations, time: Float, delay: float = 0.0
) -> tuple[Float, Float]:
    """Interpolate observations at other times.

    The path is a cubic through four frames, or a line if one of them lacks the tag.

    Args:
        observations: Observations of one camera.
        time: Times (n,), s.
        delay: Time that is added to the camera's times, s.

    Returns:
        Corners (n, m, 4, 2), px, and covariances (n, m, 5, 2, 2), px^2; NaN where neighboring
        frames lack the tag.
    """
    n, m = len(time), len(observations.ids)
    corners, covariance = np.full((n, m, 4, 2), np.nan), np.full((n, m, 5, 2, 2), np.nan)
    clock = observations.time + delay
    count = len(clock)
    if not count or not n:
        return corners, covariance
    nearest = np.clip(np.searchsorted(clock, time), 1, max(count - 1, 1))
    before = nearest - 1
    if count > 1:
        closer = np.abs(clock[nearest] - time) < np.abs(clock[before] - time)
        nearest = np.where(closer, nearest, before)
    else:
        nearest = before
    is_same = np.abs(clock[nearest] - time) <= SIMULTANEOUS_S
    is_inside = ~is_same & (time > clock[0]) & (time < clock[-1]) & (count > 1)
    previous = np.clip(np.searchsorted(clock, time[is_inside]) - 1, 0, max(count - 2, 0))
    neighbors = np.clip(previous[:, None] + np.arange(-1, 3), 0, count - 1)
    needed = np.unique(np.concatenate([nearest[is_same], neighbors.ravel()]))
    part = replace(observations.part(needed), time=clock[needed])

    k = np.searchsorted(needed, nearest[is_same])
    corners[is_same], covariance[is_same] = part.corners[k], part.covariance[k]
    if not is_inside.any():
        return corners, covariance
    max_gap = MAX_GAP_PERIODS * float(np.median(np.diff(clock)))
    step = clock[previous + 1] - clock[previous]
    share = (time[is_inside] - clock[previous]) / step
    share = np.where(step <= max_gap, share, np.nan)[:, None, None, None]
    k, following = np.searchsorted(needed, previous), np.searchsorted(needed, previous + 1)
    corners[is_inside] = (1 - share) * part.corners[k] + share * part.corners[following]
    share = share[..., None]
    covariance[is_inside] = (1 - share) ** 2 * part.covariance[k] + share**2 * part.covariance[
        following
    ]
    has_four = (previous >= 1) & (previous + 2 < count)
    _interpolate_cubic(
        part, time, np.flatnonzero(is_inside)[has_four], k[has_four], max_gap, corners
    )
    return corners, covariance


def _interpolate_cubic(
    observations: Observations,
    time: Float,
    rows: Int,
    previous: Int,
    max_gap: float,
    corners: Float,
) -> None:
    """Replace lines by cubic polynomials through four frames, in place.

    A hand's acceleration bends the path between two frames by some hundredths of a millimeter.
    """
    if not len(rows):
        return
    frames = previous[:, None] + np.arange(-1, 3)
    times = observations.time[frames]
    is_near = (np.diff(times, axis=1) <= max_gap).all(axis=1)
    rows, frames, times = rows[is_near], frames[is_near], times[is_near]
    values = np.zeros((len(rows), *corners.shape[1:]))
    for k in range(4):
        others = [n for n in range(4) if n != k]
        numerator = (time[rows, None] - times[:, others]).prod(axis=1)
        weight = numerator / (times[:, [k]] - times[:, others]).prod(axis=1)
        values += weight[:, None, None, None] * observations.corners[frames[:, k]]
    is_known = np.isfinite(values)
    corners[rows] = np.where(is_known, values, corners[rows])
