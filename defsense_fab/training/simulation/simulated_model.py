"""What the simulation alone makes of a device: a model before the first picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.arrays import Float, Int
from ...decoding.input_features import InputDecoder
from ...decoding.past import Past
from ...decoding.trained_model import Branch, TrainedModel
from ..ridge.candidates import QUADRATIC, Candidate
from ..ridge.trained_range import trained_range
from ..ridge.weighted_ridge import Whitened, solve
from .prior import Prior

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
