"""The tags that a camera saw in all its frames, on disk where they are many.

Six cameras that watch twenty tags for an hour see thirteen million of them: 1.8 GB, of which any
step of the work needs some seconds at a time.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Int
from ...core.storage.files import storage_errors
from ..tags.tag_detection import TagView

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
