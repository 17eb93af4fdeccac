"""What one camera saw of each tag over time, and at times between its frames."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.storage.files import storage_errors
from ..tags.detection import TagView

# The tags that a camera saw in all its frames, on disk where they are many.
#
# Six cameras that watch twenty tags for an hour see thirteen million of them: 1.8 GB, of which any
# step of the work needs some seconds at a time.

_IN_MEMORY = 8_000_000  # bytes of a camera's tags that are kept without a file
_TAGS = 20_000  # that are looked at together
_ROW = np.dtype(
    [("id", np.int64), ("corners", np.float64, (4, 2)), ("covariance", np.float32, (5, 2, 2))]
)


class TagStore:
    """Tags one after the other, in a temporary file of `folder` (None: where the system has them)
    that is gone with this object. Covariances are kept in single precision."""

    def __init__(self, folder: Path | None = None) -> None:
        self._where = folder or Path(tempfile.gettempdir())
        self._file = tempfile.SpooledTemporaryFile(  # noqa: SIM115 - open as long as the store
            _IN_MEMORY, dir=str(self._where)
        )
        self._count = 0
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return self._count

    def add(self, view: TagView) -> None:
        """Tags after those before. Raises StorageError, as when the disk is full."""
        rows = np.empty(len(view.ids), _ROW)
        rows["id"], rows["corners"], rows["covariance"] = view.ids, view.corners, view.covariance
        with storage_errors(self._where):
            self._file.seek(0, 2)
            self._file.write(rows.tobytes())
        self._count += len(rows)

    def read(self, which: Int) -> NDArray[Any]:
        """Of the tags `which` (n,), rows (n,) with `id`, `corners` (4, 2) px without distortion,
        and the `covariance` (5, 2, 2) px^2 of each and of their mean. Those that follow each other
        are read at once."""
        out = np.empty(len(which), _ROW)
        ends = np.append(np.flatnonzero(np.diff(which) != 1) + 1, len(which))
        begin = 0
        for end in ends[ends > 0]:
            with storage_errors(self._where):
                self._file.seek(int(which[begin]) * _ROW.itemsize)
                data = self._file.read(int(end - begin) * _ROW.itemsize)
            out[begin:end] = np.frombuffer(data, _ROW)
            begin = int(end)
        return out


@dataclass(frozen=True)
class FrameTags:
    """The tags in t frames of one camera: those of frame k are the ones from `first` (t,) up to
    `last` (t,) of a store."""

    store: TagStore
    first: Int
    last: Int

    @property
    def count(self) -> Int:
        """How many tags each frame shows (t,)."""
        return np.asarray(self.last - self.first)

    def only(self, frames: Bool | Int) -> FrameTags:
        """Some of the frames."""
        return FrameTags(self.store, self.first[frames], self.last[frames])

    def without(self, frames: Bool) -> FrameTags:
        """The same frames, some of which (t,) show nothing."""
        return FrameTags(self.store, self.first, np.where(frames, self.first, self.last))

    def find(self, frames: Int) -> tuple[Int, Int]:
        """Of all tags (n,) in the frames (k,): which of the store they are, and in which of those
        frames, 0 to k - 1."""
        first, count = self.first[frames], self.count[frames]
        position = np.repeat(np.arange(len(frames)), count)
        before = np.repeat(np.cumsum(count) - count, count)
        return first[position] + np.arange(len(position)) - before, position

    def survey(self) -> tuple[Int, Int]:
        """The numbers of all tags, and of those that some frame shows twice."""
        numbers, twice = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for frames in blocks(len(self.first), int(self.count.max(initial=1))):
            which, position = self.find(frames)
            ids = self.store.read(which)["id"]
            order = np.lexsort((ids, position))
            again = (np.diff(ids[order]) == 0) & (np.diff(position[order]) == 0)
            numbers.append(np.unique(ids))
            twice.append(np.unique(ids[order][1:][again]))
        return np.unique(np.concatenate(numbers)), np.unique(np.concatenate(twice))


def stored(views: Iterable[TagView], folder: Path | None = None) -> FrameTags:
    """Of frames, one after the other. Raises StorageError."""
    store, last = TagStore(folder), [0]
    for view in views:
        store.add(view)
        last.append(len(store))
    ends = np.array(last, np.int64)
    return FrameTags(store, ends[:-1], ends[1:])


def blocks(frames: int, tags: int, most: int = _TAGS) -> Iterator[Int]:
    """Numbers of so many frames, as many at a time as can be looked at together: in which there are
    at `most` so many tags."""
    step = max(most // max(tags, 1), 1)
    for begin in range(0, frames, step):
        yield np.arange(begin, min(begin + step, frames))


_SAME = 5e-4  # s: frames this near in time are taken as simultaneous
_FAR = 2.5  # periods, between frames that are interpolated


class Observed(Protocol):
    """t frames of one camera, m tags: `time` (t,) s, increasing; numbers `ids` (m,)."""

    @property
    def time(self) -> Float: ...

    @property
    def ids(self) -> Int: ...

    def part(self, frames: Int) -> Observations:
        """What the frames (k,) show."""
        ...


@dataclass(frozen=True)
class Observations:
    """t frames of one camera, m tags: `time` (t,) s, increasing; numbers `ids` (m,); `corners`
    (t, m, 4, 2) px without distortion, NaN where not seen, and the `covariance` (t, m, 5, 2, 2)
    px^2 of each, and last of their mean."""

    time: Float
    ids: Int
    corners: Float
    covariance: Float

    def part(self, frames: Int) -> Observations:
        """Some of the frames (k,)."""
        return Observations(
            self.time[frames], self.ids, self.corners[frames], self.covariance[frames]
        )


@dataclass(frozen=True)
class StoredObservations:
    """As `Observations`, of `tags` in t frames that are read as they are needed; `chosen` (n,) of
    the store's tags are those that count."""

    time: Float
    ids: Int
    tags: FrameTags
    chosen: Bool

    def part(self, frames: Int) -> Observations:
        """What some of the frames (k,) show."""
        which, position = self.tags.find(frames)
        good = self.chosen[which]
        rows, position = self.tags.store.read(which)[good], position[good]
        k, m = len(frames), len(self.ids)
        corners, covariance = np.full((k, m, 4, 2), np.nan), np.full((k, m, 5, 2, 2), np.nan)
        column = _columns(self.ids, rows["id"])
        corners[position, column] = rows["corners"]
        covariance[position, column] = rows["covariance"]
        return Observations(self.time[frames], self.ids, corners, covariance)

    def only(self, frames: Bool) -> StoredObservations:
        """Some of the frames, by a mask (t,)."""
        return replace(self, time=self.time[frames], tags=self.tags.only(frames))

    def without(self, frames: Bool) -> StoredObservations:
        """The same frames, some of which (t,) show nothing."""
        return replace(self, tags=self.tags.without(frames))


def observe(time: Float, tags: FrameTags, ids: Int) -> StoredObservations:
    """Tags of frames at times (t,) s by number, others than `ids` (m,) left out. Of a number that
    is twice in an image, the one nearer to where the tag was last is taken; neither where it was
    not seen before."""
    chosen = np.zeros(len(tags.store), bool)
    last = np.full((len(ids), 2), np.nan)
    for frames in blocks(len(time), int(tags.count.max(initial=1))):
        which, position = tags.find(frames)
        rows = tags.store.read(which)
        column = _columns(ids, rows["id"])
        middle = rows["corners"].mean(axis=1)
        there = column >= 0
        place = position * len(ids) + column
        order = np.argsort(np.where(there, place, -1), kind="stable")
        again = order[1:][(np.diff(place[order]) == 0) & there[order[1:]]]
        doubtful = np.unique(column[again])
        single = there & ~np.isin(column, doubtful)
        chosen[which[single]] = True
        last[column[single]] = middle[single]  # of several the last one stays
        for k in doubtful:
            mine = np.flatnonzero(column == k)
            for found in np.split(mine, np.flatnonzero(np.diff(position[mine])) + 1):
                if len(found) > 1 and np.isnan(last[k]).any():
                    continue
                away = np.linalg.norm(middle[found] - last[k], axis=1)
                nearest = found[int(away.argmin()) if len(found) > 1 else 0]
                chosen[which[nearest]] = True
                last[k] = middle[nearest]
    return StoredObservations(time, ids, tags, chosen)


def _columns(ids: Int, numbers: Int) -> Int:
    """Where the numbers (n,) are among the ids (m,), -1 for those that are not."""
    if not len(ids):
        return np.full(len(numbers), -1)
    order = np.argsort(ids)
    at = order[np.clip(np.searchsorted(ids, numbers, sorter=order), 0, len(ids) - 1)]
    return np.asarray(np.where(ids[at] == numbers, at, -1))


def middles(seen: Observed) -> Float:
    """Middles of the tags (t, m, 2) px, NaN where not seen."""
    out = np.empty((len(seen.time), len(seen.ids), 2))
    for frames in blocks(len(seen.time), len(seen.ids)):
        out[frames] = seen.part(frames).corners.mean(axis=2)
    return out


def at(seen: Observed, time: Float, late: float = 0.0) -> tuple[Float, Float]:
    """Corners (n, m, 4, 2) and covariances (n, m, 5, 2, 2) at other times (n,), s, of a camera to
    whose times `late` s are added: along a cubic through four frames, or a line where they lack the
    tag; NaN where the frames beside do."""
    n, m = len(time), len(seen.ids)
    corners, covariance = np.full((n, m, 4, 2), np.nan), np.full((n, m, 5, 2, 2), np.nan)
    clock = seen.time + late
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
    same = np.abs(clock[nearest] - time) <= _SAME
    inside = ~same & (time > clock[0]) & (time < clock[-1]) & (count > 1)
    a = np.clip(np.searchsorted(clock, time[inside]) - 1, 0, max(count - 2, 0))
    beside = np.clip(a[:, None] + np.arange(-1, 3), 0, count - 1)
    read = np.unique(np.concatenate([nearest[same], beside.ravel()]))
    part = replace(seen.part(read), time=clock[read])

    k = np.searchsorted(read, nearest[same])
    corners[same], covariance[same] = part.corners[k], part.covariance[k]
    if not inside.any():
        return corners, covariance
    far = _FAR * float(np.median(np.diff(clock)))
    step = clock[a + 1] - clock[a]
    w = (time[inside] - clock[a]) / step
    w = np.where(step <= far, w, np.nan)[:, None, None, None]
    k, after = np.searchsorted(read, a), np.searchsorted(read, a + 1)
    corners[inside] = (1 - w) * part.corners[k] + w * part.corners[after]
    w = w[..., None]
    covariance[inside] = (1 - w) ** 2 * part.covariance[k] + w**2 * part.covariance[after]
    four = (a >= 1) & (a + 2 < count)
    _curve(part, time, np.flatnonzero(inside)[four], k[four], far, corners)
    return corners, covariance


def _curve(seen: Observations, time: Float, rows: Int, a: Int, far: float, corners: Float) -> None:
    """Put cubic polynomials through four frames in place of lines, where there are four: a hand's
    acceleration bends the way between two frames by some hundredths of a millimetre."""
    if not len(rows):
        return
    four = a[:, None] + np.arange(-1, 3)
    at_ = seen.time[four]
    near = (np.diff(at_, axis=1) <= far).all(axis=1)
    rows, four, at_ = rows[near], four[near], at_[near]
    out = np.zeros((len(rows), *corners.shape[1:]))
    for k in range(4):
        others = [n for n in range(4) if n != k]
        above = (time[rows, None] - at_[:, others]).prod(axis=1)
        weight = above / (at_[:, [k]] - at_[:, others]).prod(axis=1)
        out += weight[:, None, None, None] * seen.corners[four[:, k]]
    there = np.isfinite(out)
    corners[rows] = np.where(there, out, corners[rows])
