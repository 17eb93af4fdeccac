"""The pictures of a dataset with what a decoder may see at their times, in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curves.sampling import at_times
from ...core.errors import TrainingError
from ...decoding.past import Past
from ..data.dataset import Dataset

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
    def seen(self) -> Bool:
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
