"""Predicted marker errors of a layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Prediction:
    """Predicted marker errors of a layout, as in `layout.json`.

    Attributes:
        decoder: Kind of the decoder.
        noise: Standard deviation of (R - R0)/R0 of each cord.
        unseen: RMSE on states that the decoder was not trained on, mm.
        unseen_noise_free: The same without the noise of the readings, mm.
        tested: Number of those states.
        how: How those states were chosen; see `decoding/expected_errors.py`.
        rmse: RMSE on the states that the decoder was trained on, mm.
        rmse_noise_free: The same without the noise of the readings, mm.
        peak: Largest error on those states, mm.
        average_peak: Mean over those states of the largest error, mm.
        floor: Lowest noise-free RMSE over all states that any layout with as many cords can reach
            with an affine map, mm.
        per_state: RMSE of each trained state, noise included, mm.
        held_out: RMSE of each held-out state, noise included, mm.
    """

    decoder: str
    noise: tuple[float, ...]
    unseen: float
    unseen_noise_free: float
    tested: int
    how: str
    rmse: float
    rmse_noise_free: float
    peak: float
    average_peak: float
    floor: float
    per_state: Mapping[str, float]
    held_out: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        """Return the values by name."""
        return asdict(self)
