"""What a layout is predicted to reach, as it stands in `layout.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Prediction:
    """Marker errors in mm. `rmse` counts the read-out's noise, `rmse_noise_free` does not.

    `unseen` and `unseen_noise_free` are of the `tested` states, which the decoder was not trained
    on, by `how` (see decoding/unseen.py); `floor` is the least noise-free RMSE over all states that
    any layout of as many cords can reach with an affine map. `rmse`, `rmse_noise_free`, `peak` and
    `average_peak` are of the states that it was trained on; `per_state` and `held_out` are RMSE by
    state, noise included. `noise` is the standard deviation of (R - R0)/R0 of each cord.
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
        return asdict(self)
