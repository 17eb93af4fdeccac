"""The usable frames of a dataset in one table, with decoder inputs, and their division for tests.

Models are always trained and tested on contiguous runs of frames. Neighboring frames are nearly
the same, so a test on frames between training frames would show only how well a decoder remembers.

References:
    Roberts et al. 2017, Cross-validation strategies for data with temporal, spatial, hierarchical,
    or phylogenetic structure, Ecography 40.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.signal_history import Past, interpolate_at
from ..data.dataset import Dataset
from ..options import TrainOptions

#: Fewer frames cannot be divided into meaningful folds.
MIN_FRAMES = 50


@dataclass(frozen=True)
class Frames:
    """The t frames with signals of all channels and at least one visible marker.

    Attributes:
        dataset: The dataset that the frames belong to.
        recording_index: Index of each frame's recording, shape (t,), not decreasing.
        frame_index: Index of each frame in its recording, shape (t,).
        points: Marker positions, shape (t, m, 3), mm, in the device's rest frame; NaN in gaps.
            Scalar targets have the shape (t, m, 1).
        sigma: Standard deviations of the positions, shape (t, m, r), mm; NaN in gaps.
    """

    dataset: Dataset
    recording_index: Int
    frame_index: Int
    points: Float
    sigma: Float

    @staticmethod
    def from_dataset(dataset: Dataset) -> Frames:
        """Collect the usable frames of all recordings.

        Args:
            dataset: The dataset.

        Returns:
            The frames, in the order of the recordings.

        Raises:
            TrainingError: If there are fewer than MIN_FRAMES.
        """
        counts = [len(r.time) for r in dataset.recordings]
        frames = Frames(
            dataset,
            np.repeat(np.arange(len(counts)), counts),
            np.concatenate([np.arange(n) for n in counts]),
            np.concatenate([r.points for r in dataset.recordings]),
            np.concatenate([r.sigma for r in dataset.recordings]),
        )
        channels = range(len(dataset.channels))
        has_signals = np.isfinite(frames.inputs(Past(), channels)).all(axis=1)
        has_markers = np.isfinite(frames.points[..., 0]).any(axis=1)
        is_usable = has_signals & has_markers
        if is_usable.sum() < MIN_FRAMES:
            raise TrainingError(
                f"{int(is_usable.sum())} of {is_usable.size} frames have both signals of all"
                f" channels ({int(has_signals.sum())}) and markers ({int(has_markers.sum())}), but"
                f" training needs {MIN_FRAMES}",
                code="too-few-frames",
                where=", ".join(r.name for r in dataset.recordings),
                action="Record for longer, or see in the session's report.html what is missing",
                count=int(is_usable.sum()),
                needed=MIN_FRAMES,
            )
        return frames.select(np.asarray(is_usable))

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, summed over the recordings, s."""
        time, index = self.time, self.recording_index
        return float(sum(np.ptp(time[index == k]) for k in np.unique(index)))

    def select(self, which: Bool | slice | Int) -> Frames:
        """Return the frames given by a mask (t,), a slice or indices."""
        return replace(
            self,
            recording_index=self.recording_index[which],
            frame_index=self.frame_index[which],
            points=self.points[which],
            sigma=self.sigma[which],
        )

    def __len__(self) -> int:
        return len(self.recording_index)

    @property
    def time(self) -> Float:
        """Times of the frames, shape (t,), s, on the clock of each recording."""
        time = np.empty(len(self))
        for k, recording in enumerate(self.dataset.recordings):
            is_of_recording = self.recording_index == k
            time[is_of_recording] = recording.time[self.frame_index[is_of_recording]]
        return time

    @property
    def visible(self) -> Bool:
        """Whether each marker is visible in each frame, shape (t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))

    def inputs(self, past: Past, channels: Sequence[int]) -> Float:
        """Compute the inputs of a decoder.

        Args:
            past: The memory that the decoder uses.
            channels: Indices of the decoder's k channels.

        Returns:
            Signals and their memories at the frames, shape (t, k (1 + past.count)).
        """
        indices = list(channels)
        inputs = np.empty((len(self), len(indices) * (1 + past.count)))
        for k, r in enumerate(self.dataset.recordings):
            is_of_recording = self.recording_index == k
            z = past(r.sample_time, r.signals[:, indices])
            times = r.time[self.frame_index[is_of_recording]]
            inputs[is_of_recording] = interpolate_at(times, r.sample_time, z)
        return inputs


def split_frames(
    frames: Frames,
    test_share: float = TrainOptions.test_share,
    leave_out: Sequence[str] = TrainOptions.leave_out,
) -> tuple[Frames, Frames]:
    """Divide frames into those to train on and those to test on.

    Args:
        frames: The frames.
        test_share: Share of the frames to test on, at the end; from 0 to below 1.
        leave_out: Names of the recordings to test on, in place of a share.

    Returns:
        The frames for training, and those for the test.

    Raises:
        TrainingError: If the share is out of range, or there is no such recording.
    """
    if leave_out:
        names = [r.name for r in frames.dataset.recordings]
        if unknown := [name for name in leave_out if name not in names]:
            raise TrainingError(
                f"no run has the name {unknown[0]}",
                code="unknown-run",
                where="leave_out",
                action=f"Choose from {', '.join(names)}",
                run=unknown[0],
            )
        is_tested = np.isin(frames.recording_index, [names.index(name) for name in leave_out])
        return frames.select(~is_tested), frames.select(is_tested)
    if not 0 <= test_share < 1:
        raise TrainingError(
            f"must be from 0 to below 1, not {test_share:g}",
            code="out-of-range",
            where="test_share",
            share=test_share,
        )
    cut = len(frames) - round(test_share * len(frames))
    return frames.select(slice(0, cut)), frames.select(slice(cut, len(frames)))


def assign_folds(count: int, folds: int = TrainOptions.folds) -> Int:
    """Assign frames to contiguous folds of nearly equal sizes.

    Args:
        count: Number of frames.
        folds: Number of folds.

    Returns:
        The fold of each frame, shape (count,).
    """
    return np.repeat(np.arange(folds), [len(p) for p in np.array_split(np.arange(count), folds)])
