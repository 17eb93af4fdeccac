"""The error that a design and a training foretell, beside what a test measures.

Mean squares (mm^2) that add up to the predicted one:

- the design: what it promises, read-out noise and joints included;
- repeatability: by how much what is said of one shape differs from show to show in the training
  (`fitting/repeatability.py`), less the noise that the design's promise holds and what clocks do;
  less than 0 where the cords repeat better than that;
- clocks: their stated standard error times the markers' speed;
- drift: by how much shows that are long apart differ more; what goes on beyond the training's own
  length is not in it;
- camera noise: stated variances of the places that errors are measured against.

Nothing of the tested pictures goes into them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fitting.repeatability import Repeatability
from .decoded_frames import DecodedFrames
from .error_budget import CAMERAS, CLOCKS, DRIFT

DESIGN, REPEATABILITY = "the design", "repeatability"


@dataclass(frozen=True)
class Promise:
    """RMSE (mm) that a design promises on states that it was not fitted to, of the decoder's form
    that is asked about; between `low` and `high` lie 90 % of built devices with the design's best
    form, `noise` (mm) of which is read-out noise and joints."""

    rmse: float
    noise: float
    low: float
    high: float


@dataclass(frozen=True)
class PredictedError:
    """Mean squares (mm^2) by cause, `shares`, of which the design's is lacking where its `promise`
    is not known; `measured` RMSE, mm; the `share` of the training's frames whose shape was shown
    again."""

    promise: Promise | None
    shares: dict[str, float]
    measured: float
    share: float

    @property
    def predicted(self) -> float:
        """RMSE, mm."""
        return float(np.sqrt(max(sum(self.shares.values()), 0.0)))

    @property
    def ratio(self) -> float:
        """Predicted to measured; NaN where nothing was measured."""
        return self.predicted / self.measured if self.measured > 0 else np.nan

    @property
    def promised_ratio(self) -> float | None:
        """The promise alone to measured."""
        if self.promise is None:
            return None
        return self.promise.rmse / self.measured if self.measured > 0 else np.nan


def predicted_error(
    repeats: Repeatability, frames: DecodedFrames, promise: Promise | None = None
) -> PredictedError:
    """What a training foretells of tested frames."""
    clocks = min(repeats.clocks, repeats.at_once)
    known = 0.0 if promise is None else promise.noise**2
    shares = {
        **({} if promise is None else {DESIGN: promise.rmse**2}),
        REPEATABILITY: repeats.at_once - clocks - known,
        CLOCKS: clocks,
        DRIFT: repeats.drift,
        CAMERAS: repeats.cameras,
    }
    measured = float(np.sqrt((frames.per_frame**2).mean()))
    return PredictedError(promise, shares, measured, repeats.share)
