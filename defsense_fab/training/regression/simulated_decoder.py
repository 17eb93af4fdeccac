"""What the simulation alone makes of a device: a model before the first picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Bool, Float, Int
from ...decoding.input_decoder import InputDecoder, SharedMemory
from ...decoding.signal_history import Past
from ...decoding.trained_model import Branch, TrainedModel
from .candidates import QUADRATIC, Candidate
from .intervals import trained_range
from .simulation_prior import Prior
from .weighted_ridge import Whitened, solve

# The simulation's map behind a memory that was fitted to pictures, and its errors on folds.

# What turns the signals of a built device's cords into those that the simulation knows.
#
# Each channel has a gain near one and an offset near zero; what cords remember is the same of all
# (`decoding/input_decoder.py`). These few numbers are found so that the markers come out where
# cameras saw them (Gauss-Newton with a soft L1 loss): a few dozen pictures tell them.

#: Time constants, s, among which cross-validation chooses; none, for cords that forget at once.
PASTS = (
    Past(),
    Past((2.0, 30.0), (2.0, 20.0)),
    Past((0.5, 5.0, 50.0), (5.0, 50.0)),
    Past((1.0, 10.0, 60.0), (1.0, 10.0, 60.0)),
)
#: Standard deviations that the numbers are expected to have.
_GAINS, _OFFSETS, _MOVED, _WORKED = 0.15, 0.02, 0.3, 0.1
_FEW = 300  # pictures that are looked at
_ERROR = 1.0  # mm, of the map itself
_TRIES = 60  # evaluations


def fit_memory(
    decoder: InputDecoder, past: Past, inputs: Float, points: Float, known: Bool,
    near: SharedMemory | None = None,
) -> SharedMemory:  # fmt: skip
    """For a static decoder of c signals, by inputs (t, d) made with the `past`, and markers
    `points` (t, m, 3) mm in the frame of what the decoder gives, where `known` (t, m);
    beginning at one that is `near`."""
    c, K = decoder.features.inputs, len(past.moved)
    step = max(len(inputs) // _FEW, 1)
    z, there = inputs[::step], known[::step]
    p = points[::step]
    scale = _ERROR * np.sqrt(there.sum() / max(len(z), 1))  # a picture counts once
    spread = np.repeat(
        [_GAINS, _OFFSETS, _MOVED, _WORKED], [c, c, K, len(past.worked)]
    )  # fmt: skip

    def made(x: Float) -> SharedMemory:
        return SharedMemory(
            np.exp(x[:c]), x[c : 2 * c], x[2 * c : 2 * c + K], x[2 * c + K :], decoder
        )

    def residuals(x: Float) -> Float:
        off = (made(x)(z).reshape(p.shape) - p)[there]
        return np.concatenate([off.ravel() / scale, x / spread])

    start = np.zeros(len(spread))
    if near is not None:
        start = np.concatenate([np.log(near.gain), near.offset, near.moved, near.worked])
    found = least_squares(residuals, start, loss="soft_l1", x_scale="jac", max_nfev=_TRIES)
    return made(found.x)


@dataclass(frozen=True)
class SimulatedMap:
    """Of displacements: fitted to all pictures, and without each fold (k,); root mean squared
    errors (k,) mm on the folds left out."""

    whole: SharedMemory
    folds: tuple[SharedMemory, ...]
    errors: Float

    @staticmethod
    def fitted(
        decoder: InputDecoder, past: Past, inputs: Float, outputs: Float, weights: Float, fold: Int
    ) -> SimulatedMap:
        """To inputs (t, d) that see the `past` and outputs (t, m, 3) mm with weights (t, m), zero
        where one is not known, in folds (t,)."""
        known = weights > 0
        filled = np.where(known[..., None], outputs, 0.0)
        whole = fit_memory(decoder, past, inputs, filled, known)
        folds, errors = [], []
        for k in range(int(fold.max()) + 1):
            test = fold == k
            found = fit_memory(decoder, past, inputs[~test], filled[~test], known[~test], whole)
            off = found(inputs[test]).reshape(-1, *outputs.shape[1:]) - filled[test]
            w = weights[test]
            errors.append(np.sqrt((w * (off**2).sum(2)).sum() / max(float(w.sum()), 1e-300)))
            folds.append(found)
        return SimulatedMap(whole, tuple(folds), np.array(errors))

    def map(self, without: int | None = None) -> SharedMemory:
        """Fitted to all, or without a fold."""
        return self.whole if without is None else self.folds[without]


_NOISE = 2e-3  # of the inputs: what built cords are off by at least


def simulated_decoder(prior: Prior, channels: Sequence[int] | None = None) -> InputDecoder:
    """The static decoder of displacements, from the channels (k,) by index, or all."""
    signals = prior.signals if channels is None else prior.signals[:, list(channels)]
    features = Candidate(QUADRATIC, Past()).features(signals, signals.shape[1])
    phi = features(signals)
    whitened = Whitened.of(phi, features.slopes(signals), features.roughness())
    beta, constant = solve(prior.sums(phi, whitened), np.array([_NOISE]))
    return InputDecoder(features, *whitened.plain(beta[0], constant[0]))


def simulated_model(
    device: str, layout: str, channels: tuple[str, ...], ids: Int, rest_points: Float, prior: Prior
) -> TrainedModel:
    """The model of a device that no camera has seen. It has no intervals: what a built device's
    channels differ by is not known."""

    def branch(use: tuple[int, ...]) -> Branch:
        signals = prior.signals[:, list(use)]
        found = simulated_decoder(prior, use)
        decoder = replace(found, constant=found.constant + rest_points.ravel())
        return Branch(use, Past(), decoder, trained_range(signals, signals), None)

    every = tuple(range(len(channels)))
    without = {
        name: branch(tuple(c for c in every if c != k))
        for k, name in enumerate(channels)
        if len(every) > 1
    }
    c = len(channels)
    return TrainedModel(
        device, layout, f"{QUADRATIC}, simulated", channels, ids, rest_points, np.ones(c),
        np.zeros(c), branch(every), without,
    )  # fmt: skip
