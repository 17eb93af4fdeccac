"""The error that models reach by chance: of signals that belong to other times of the movement.

Periodic movement is partly predicted by signals of any time. A useful model must do better than
nearly all models that are fitted to the same signals after they were moved in time, circularly and
by far.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...decoding.signal_history import Past
from ..data.shift_curve import block_residuals
from ..regression.frames import Frames, assign_folds

_PAST = Past((1.0, 10.0))  # memories of all models
_MAX_FRAMES = 1500  # that are compared
_MAX_INPUTS, _MAX_SQUARES = 24, 8
_MODELS = 199  # at equal steps
_MIN_MOVE_SHARE = 0.05  # of the frames, by which signals are moved at least
_QUANTILE = 0.01  # of the models' errors


def measure_chance(frames: Frames) -> float:
    """Measure the error of models of signals from other times, as a share of the movement.

    Args:
        frames: Frames whose dataset is used, with all its frames.

    Returns:
        The share that 99 % of the models exceed, in folds that are left out.
    """
    frames = Frames.from_dataset(frames.dataset)
    frames = frames.select(slice(None, None, max(len(frames) // _MAX_FRAMES, 1)))
    count = len(frames)
    points = frames.points.reshape(count, -1)
    moved = np.nan_to_num(points - np.nanmean(points, axis=0))
    x = _inputs(frames)
    fold = assign_folds(count)
    starts = np.searchsorted(fold, np.unique(fold)).tolist()
    blocks = [slice(a, b) for a, b in zip(starts, [*starts[1:], count], strict=True)]
    least = max(int(_MIN_MOVE_SHARE * count), 1)
    shares = []
    for by in np.unique(np.linspace(least, count - least, _MODELS).astype(int)):
        left = block_residuals(np.roll(x, by, axis=0), moved, blocks, np.arange(len(blocks)))
        shares.append(float(left.sum()))
    return float(np.sqrt(np.quantile(shares, _QUANTILE) / (moved**2).sum()))


def _inputs(frames: Frames) -> Float:
    """Return principal components (t, d) of signals and memories, and squares of the largest."""
    z = frames.inputs(_PAST, range(len(frames.dataset.channels)))
    z = z - z.mean(axis=0)
    deviation = z.std(axis=0)
    z = z / np.where(deviation > 0, deviation, 1.0)
    u, size, _ = np.linalg.svd(z, full_matrices=False)
    u = u[:, size > 1e-6 * size[0]][:, :_MAX_INPUTS]
    squares = u[:, :_MAX_SQUARES] ** 2
    return np.concatenate([u, squares - squares.mean(axis=0)], axis=1)
