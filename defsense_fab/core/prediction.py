"""What a layout is predicted to reach, as it stands in `layout.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Prediction:
    """Marker errors in mm. `rmse` counts the read-out's noise, `rmse_noise_free` does not.

    `peak` and `average_peak` are those of the noise-free reconstruction; `floor` is the least
    noise-free RMSE that any layout of as many cords can reach with an affine map; `per_state`
    and `held_out` are RMSE by state, noise included.
    """

    decoder: str
    noise: float
    rmse: float
    rmse_noise_free: float
    peak: float
    average_peak: float
    floor: float
    per_state: Mapping[str, float]
    held_out: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)
