"""By how much a decoder says different things of one shape that is shown at different times.

Two pictures in which the markers agree within the cameras' noise show the same shape. Signals that
differ between them do so by the read-out's noise and by what a cord does not repeat: friction,
relaxation that a memory does not undo, joints, drift, clocks that are off while it moves. What
decoders of the folds left out make of either is compared, which is their slope times the signals'
difference. Half its mean square is the variance of a single show. Errors that come back with a
shape, which are the decoder's own, are not in it.

Shapes are compared in the few directions in which markers move together: noise of single markers
is nearly gone from these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, Int
from ..regression.frames import Frames

_MOST = 2000  # frames, evenly spread, among which pairs are looked for
_FEWEST = 100  # pairs
_APART = 5.0  # s between two shows, at least
_DIRECTIONS = 12  # of shapes, at most
_ROUNDS = 6  # of filling gaps
_ALIKE = 0.02  # of how far markers move, where the cameras' noise is not known
_NEAR = 0.25  # s: pictures further apart are not neighbours


@dataclass(frozen=True)
class Repeatability:
    """Mean squares, mm^2: of what is said of a shape about its mean, `at_once` in shows right after
    each other, and by `drift` more in those that are as long apart as the training's mostly are; of
    stated standard deviations of the markers' places, `cameras`; of the clocks' standard error
    times the markers' speed, `clocks`, which `at_once` holds too. Of the frames looked at, a
    `share` has partners of its shape."""

    at_once: float
    drift: float
    cameras: float
    clocks: float
    share: float


def repeatability(frames: Frames, guess: Float) -> Repeatability | None:
    """Of displacements (t, m, 3) mm that decoders said which were not trained on these frames. None
    where too few shapes come back."""
    shown, said = _shapes(frames, guess)
    some = np.unique(np.linspace(0, len(frames) - 1, _MOST).astype(int))
    variance = (frames.sigma**2).sum(axis=2)[frames.visible]
    variance = variance[np.isfinite(variance)]
    cameras = float(variance.mean()) if len(variance) else 0.0
    alike = max(np.sqrt(cameras), _ALIKE * float(np.sqrt(shown.var(axis=0).sum())))
    i, j = _pairs(frames, some, shown[some], alike)
    if len(i) < _FEWEST:
        return None
    square = (((said[i] - said[j]) - (shown[i] - shown[j])) ** 2).sum(axis=1) / 2
    partners = np.bincount(np.concatenate([i, j]), minlength=len(frames))
    weight = 1 / partners[i] + 1 / partners[j]  # so that frames count alike
    at_once, drift = _line(np.abs(frames.time[i] - frames.time[j]), square, weight)
    share = float((partners[some] > 0).mean())
    return Repeatability(at_once, drift, cameras, _clocks(frames, shown), share)


def _shapes(frames: Frames, guess: Float) -> tuple[Float, Float]:
    """What was shown, and what was said (t, k), in the same directions, so that lengths are root
    mean squares over the markers, mm."""
    moved = frames.points - frames.dataset.rest_points
    measured, said = moved.reshape(len(frames), -1), guess.reshape(len(frames), -1)
    known = np.isfinite(measured)
    middle = np.where(known, measured, 0).sum(0) / np.maximum(known.sum(0), 1)
    x = np.where(known, measured - middle, 0.0)
    directions = np.eye(x.shape[1])
    for _ in range(_ROUNDS):
        directions = np.linalg.eigh(x.T @ x)[1][:, -_DIRECTIONS:]
        x = np.where(known, x, x @ directions @ directions.T)
    scale = np.sqrt(moved.shape[1])
    return x @ directions / scale, (said - middle) @ directions / scale


def _pairs(frames: Frames, some: Int, shown: Float, alike: float) -> tuple[Int, Int]:
    """Of frames of one recording that show the same at different times."""
    found = cKDTree(shown).query_pairs(alike, output_type="ndarray")
    i, j = some[found[:, 0]], some[found[:, 1]]
    apart = np.abs(frames.time[i] - frames.time[j]) >= _APART
    own = (frames.of[i] == frames.of[j]) & apart
    return i[own], j[own]


def _line(lag: Float, square: Float, weight: Float) -> tuple[float, float]:
    """Of a line of weighted least squares, its value at 0 and what the mean is above that, neither
    negative."""
    weight = weight / weight.sum()
    middle, mean = float(weight @ lag), float(weight @ square)
    spread = float(weight @ (lag - middle) ** 2)
    slope = float(weight @ ((lag - middle) * square)) / spread if spread > 0 else 0.0
    above = min(max(slope * middle, 0.0), mean)
    return mean - above, above


def _clocks(frames: Frames, shown: Float) -> float:
    """mm^2, of clocks that are off by their stated standard error."""
    error = np.array([r.sync_error or 0.0 for r in frames.dataset.recordings])[frames.of]
    step = frames.time[2:] - frames.time[:-2]
    near = (frames.of[2:] == frames.of[:-2]) & (step > 0) & (step <= _NEAR)
    if not near.any():
        return 0.0
    square = ((shown[2:] - shown[:-2])[near] ** 2).sum(axis=1) / step[near] ** 2
    return float((error[1:-1][near] ** 2 * square).mean())
