"""The pictures of a dataset with what a decoder may see at their times, in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.decoders import FOLDS
from ...decoding.signal_history import Past, at_times
from ..data.dataset import Dataset

# Which pictures a model is trained on, and which it is tested on: always runs of neighbours.
#
# Pictures beside each other show nearly the same: a test among the training's neighbours tells how
# well a decoder remembers. (Roberts et al. 2017, Cross-validation strategies for data with temporal
# structure, Ecography 40.)

#: Of all pictures, those at the end that a model is tested on (DefSense, CHI 2016, section 6).
TEST_SHARE = 0.3


def first_and_last(frames: Frames, share: float = TEST_SHARE) -> tuple[Frames, Frames]:
    """The first pictures, and the last `share` of them. Raises TrainingError for no share."""
    if not 0 <= share < 1:
        raise TrainingError(
            f"the share of pictures to test on must be from 0 to below 1, not {share:g}",
            code="share-out-of-range",
            share=share,
        )
    cut = len(frames) - round(share * len(frames))
    return frames.part(slice(0, cut)), frames.part(slice(cut, len(frames)))


def fold_of(count: int, folds: int = FOLDS) -> Int:
    """The fold (t,) of each of `count` pictures: contiguous, of nearly equal sizes."""
    return np.repeat(np.arange(folds), [len(p) for p in np.array_split(np.arange(count), folds)])


#: Fewer pictures than this cannot be divided into folds that tell anything.
FEWEST = 50


@dataclass(frozen=True)
class Frames:
    """t pictures at which all channels are known and a marker or more was seen, in the order of the
    recordings: `of` (t,) the recording and `row` (t,) the picture in it; `points` and `sigma`
    (t, m, 3) mm, NaN in gaps."""

    dataset: Dataset
    of: Int
    row: Int
    points: Float
    sigma: Float

    @staticmethod
    def all_of(dataset: Dataset) -> Frames:
        """Raises TrainingError where there are too few."""
        every = range(len(dataset.recordings))
        count = [len(r.time) for r in dataset.recordings]
        whole = Frames(
            dataset,
            np.repeat(np.arange(len(count)), count),
            np.concatenate([np.arange(n) for n in count]),
            np.concatenate([r.points for r in dataset.recordings]),
            np.concatenate([r.sigma for r in dataset.recordings]),
        )
        channels = range(len(dataset.channels))
        known = np.isfinite(whole.inputs(Past(), channels)).all(axis=1)
        seen = np.isfinite(whole.points[..., 0]).any(axis=1)
        if (known & seen).sum() < FEWEST:
            names = ", ".join(dataset.recordings[k].name for k in every)
            raise TrainingError(
                f"{names}: {int((known & seen).sum())} of {known.size} pictures have both signals"
                f" of all channels ({int(known.sum())}) and markers ({int(seen.sum())}); training"
                f" needs {FEWEST} or more: record for longer, and see the report for what is missing",
                code="too-few-frames",
                count=int((known & seen).sum()),
                needed=FEWEST,
            )
        return whole.part(np.asarray(known & seen))

    @property
    def lasts(self) -> float:
        """s from the first picture to the last, of all recordings together."""
        time = self.time
        return float(sum(np.ptp(time[self.of == k]) for k in np.unique(self.of)))

    def part(self, frames: Bool | slice | Int) -> Frames:
        """Some of them."""
        return replace(
            self, of=self.of[frames], row=self.row[frames], points=self.points[frames],
            sigma=self.sigma[frames],
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.of)

    @property
    def time(self) -> Float:
        """(t,) s, on each recording's own clock."""
        out = np.empty(len(self))
        for k, recording in enumerate(self.dataset.recordings):
            mine = self.of == k
            out[mine] = recording.time[self.row[mine]]
        return out

    @property
    def visible(self) -> Bool:
        """(t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))

    def inputs(self, past: Past, channels: Sequence[int]) -> Float:
        """What a decoder sees (t, d) of the channels (k,), by index, and their past."""
        pick = list(channels)
        out = np.empty((len(self), len(pick) * (1 + past.count)))
        for k, r in enumerate(self.dataset.recordings):
            mine = self.of == k
            z = past(r.sample_time, r.signals[:, pick])
            out[mine] = at_times(r.time[self.row[mine]], r.sample_time, z)
        return out
