"""Decoders from a simulation: before the first frame, and fitted to the cords of a built device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Bool, Float, Int
from ...decoding.input_decoder import InputDecoder, SharedMemory
from ...decoding.signal_history import Past
from ...decoding.trained_model import Branch, TrainedModel
from .candidates import QUADRATIC, Candidate
from .intervals import fit_trained_range
from .simulation_prior import Prior
from .weighted_ridge import Whitening, solve_ridge

#: Memories, with time constants in s, among which cross-validation chooses. The empty one is for
#: cords without memory.
SHARED_MEMORIES = (
    Past(),
    Past((2.0, 30.0), (2.0, 20.0)),
    Past((0.5, 5.0, 50.0), (5.0, 50.0)),
    Past((1.0, 10.0, 60.0), (1.0, 10.0, 60.0)),
)

_INPUT_NOISE = 2e-3  # built cords differ from the simulation by at least this
# Prior standard deviations of the log gains, the offsets and the shares of the two memories.
_GAIN_SIGMA, _OFFSET_SIGMA, _MOVED_SIGMA, _WORKED_SIGMA = 0.15, 0.02, 0.3, 0.1
_BUILT_DEVICES = 100  # whose signals are the range of a model without recordings
_MAX_FRAMES = 300
_MAP_ERROR_MM = 1.0  # error of the simulated decoder itself
_MAX_EVALUATIONS = 60


def fit_simulated_decoder(prior: Prior, channels: Sequence[int] | None = None) -> InputDecoder:
    """Fit a static quadratic decoder of displacements to simulated states.

    Args:
        prior: The simulated states.
        channels: Indices of the channels to use; None for all.

    Returns:
        The decoder, whose outputs are displacements in mm.
    """
    signals = prior.signals if channels is None else prior.signals[:, list(channels)]
    features = Candidate(QUADRATIC, Past()).features(signals, signals.shape[1])
    whitening, x = Whitening.fit(features, signals)
    beta, constant = solve_ridge(prior.accumulate_sums(x), np.array([_INPUT_NOISE]))
    return InputDecoder(features, *whitening.undo(beta[0], constant[0]))


def fit_simulated_model(
    device: str, layout: str, channels: tuple[str, ...], ids: Int, rest_points: Float, prior: Prior
) -> TrainedModel:
    """Fit a model to simulated states alone, for a device without recordings.

    The range of its inputs contains the signals of built devices, whose channels deviate by the
    prior standard deviations of `fit_memory`. The model has no intervals, since the deviations of
    this device's channels are unknown.

    Args:
        device: Name of the device.
        layout: Hash of its layout.
        channels: Names of its c channels.
        ids: Numbers of its m markers, shape (m,).
        rest_points: Marker positions at rest, shape (m, 3), mm.
        prior: The simulated states.

    Returns:
        The model.
    """

    def fit_branch(indices: tuple[int, ...]) -> Branch:
        signals = prior.signals[:, list(indices)]
        decoder = fit_simulated_decoder(prior, indices)
        decoder = decoder.scale(np.ones(rest_points.size), rest_points.ravel())
        built = _signals_as_built(signals)
        return Branch(indices, Past(), decoder, fit_trained_range(built, signals), None)

    c = len(channels)
    all_channels = tuple(range(c))
    without = {
        name: fit_branch(tuple(j for j in all_channels if j != k))
        for k, name in enumerate(channels)
        if c > 1
    }
    return TrainedModel(
        device,
        layout,
        f"{QUADRATIC}, simulated",
        channels,
        ids,
        rest_points,
        np.ones(c),
        np.zeros(c),
        fit_branch(all_channels),
        without,
    )


def _signals_as_built(signals: Float) -> Float:
    """Return simulated signals (s, c) as devices with random gains and offsets have them (n, c)."""
    rng = np.random.default_rng(0)
    shape = (_BUILT_DEVICES, 1, signals.shape[1])
    gain = np.exp(_GAIN_SIGMA * rng.standard_normal(shape))
    offset = _OFFSET_SIGMA * rng.standard_normal(shape)
    return np.asarray(gain * signals + offset).reshape(-1, signals.shape[1])


def fit_memory(
    decoder: InputDecoder,
    past: Past,
    inputs: Float,
    points: Float,
    known: Bool,
    start: SharedMemory | None = None,
) -> SharedMemory:
    """Fit what converts the signals of a built device into those of the simulation.

    Each channel has a gain near one and an offset near zero; all cords share one memory
    (`decoding/input_decoder.py`). These few numbers are fitted to the measured marker positions
    (Gauss-Newton with a soft L1 loss); some dozens of frames suffice.

    Args:
        decoder: A static decoder of c signals.
        past: The memory whose shares are fitted.
        inputs: Signals and their memories, shape (t, d).
        points: Marker positions in the frame of the decoder's outputs, shape (t, m, 3), mm.
        known: Which positions are known, shape (t, m).
        start: Where to start the fit; None for gains of 1 without offsets and memory.

    Returns:
        The fitted memory in front of the decoder.
    """
    c, K = decoder.features.inputs, len(past.moved)
    step = max(len(inputs) // _MAX_FRAMES, 1)
    z, is_known = inputs[::step], known[::step]
    p = points[::step]
    scale = _MAP_ERROR_MM * np.sqrt(is_known.sum() / max(len(z), 1))  # frames count once
    sigma = np.repeat(
        [_GAIN_SIGMA, _OFFSET_SIGMA, _MOVED_SIGMA, _WORKED_SIGMA], [c, c, K, len(past.worked)]
    )

    def memory_of(x: Float) -> SharedMemory:
        return SharedMemory(
            np.exp(x[:c]), x[c : 2 * c], x[2 * c : 2 * c + K], x[2 * c + K :], decoder
        )

    def residuals(x: Float) -> Float:
        difference = (memory_of(x)(z).reshape(p.shape) - p)[is_known]
        return np.concatenate([difference.ravel() / scale, x / sigma])

    x0 = np.zeros(len(sigma))
    if start is not None:
        x0 = np.concatenate([np.log(start.gain), start.offset, start.moved, start.worked])
    fit = least_squares(residuals, x0, loss="soft_l1", x_scale="jac", max_nfev=_MAX_EVALUATIONS)
    return memory_of(fit.x)


@dataclass(frozen=True)
class SimulatedMap:
    """The simulated decoder of displacements behind a fitted memory, with its errors on folds.

    Attributes:
        whole: Fitted to all frames.
        folds: Fitted without each of the k folds.
        errors: Root mean squared errors on the folds left out, shape (k,), mm.
    """

    whole: SharedMemory
    folds: tuple[SharedMemory, ...]
    errors: Float

    @staticmethod
    def fit(
        decoder: InputDecoder, past: Past, inputs: Float, outputs: Float, weights: Float, fold: Int
    ) -> SimulatedMap:
        """Fit the memory to all frames, and without each fold.

        Args:
            decoder: A static decoder of displacements.
            past: The memory whose shares are fitted.
            inputs: Signals and their memories, shape (t, d).
            outputs: Displacements of the markers, shape (t, m, 3), mm.
            weights: Weights of the markers, shape (t, m); 0 where unknown.
            fold: Fold of each frame, shape (t,).

        Returns:
            The fitted map.
        """
        is_known = weights > 0
        filled = np.where(is_known[..., None], outputs, 0.0)
        whole = fit_memory(decoder, past, inputs, filled, is_known)
        folds, errors = [], []
        for k in range(int(fold.max()) + 1):
            test = fold == k
            memory = fit_memory(decoder, past, inputs[~test], filled[~test], is_known[~test], whole)
            difference = memory(inputs[test]).reshape(-1, *outputs.shape[1:]) - filled[test]
            w = weights[test]
            square = (w * (difference**2).sum(2)).sum()
            errors.append(np.sqrt(square / max(float(w.sum()), 1e-300)))
            folds.append(memory)
        return SimulatedMap(whole, tuple(folds), np.array(errors))

    def without_fold(self, fold: int | None = None) -> SharedMemory:
        """Return the memory fitted without a fold, or to all frames if it is None."""
        return self.whole if fold is None else self.folds[fold]
