"""Predict the error of a test from the device's design and the model's training.

Nothing of the test frames is used. These mean squares (mm^2) add up to the predicted one:

- the design: its expected error, with read-out noise and joints;
- repeatability: how much the decoded shape differs from show to show in the training
  (`fitting/repeatability.py`), less the noise that the design includes and the clocks' effect;
  negative if the cords repeat better than that;
- clocks: their stated standard error times the markers' speed;
- drift: how much more shows differ that are far apart in time; drift beyond the training's own
  duration is not included;
- camera noise: stated variances of the positions that errors are measured against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...decoding.trained_model import TrainedModel
from ...store.layout import LayoutRecord, layout_hash
from ..fitting.repeatability import Repeatability
from ..regression.candidates import parse_form
from .decoded_frames import DecodedFrames
from .error_budget import CAMERAS, CLOCKS, DRIFT

DESIGN, REPEATABILITY = "the design", "repeatability"


@dataclass(frozen=True)
class DesignPrediction:
    """Error that a design predicts for states that it was not fitted to.

    Attributes:
        rmse: Root mean square error for one form of decoder, mm.
        noise: Part of the best form's error that is due to read-out noise and joints, mm.
        low: Lower end of the interval that contains 90 % of built devices with the best form, mm.
        high: Upper end of that interval, mm.
    """

    rmse: float
    noise: float
    low: float
    high: float


@dataclass(frozen=True)
class PredictedError:
    """A predicted error, next to the measured one.

    Attributes:
        design: The prediction of the design; None if unknown.
        shares: Mean squares by cause, mm^2; without the design's if it is unknown.
        measured: Measured root mean square error, mm.
        repeated_share: Share of the training's frames whose shape was shown again.
    """

    design: DesignPrediction | None
    shares: dict[str, float]
    measured: float
    repeated_share: float

    @property
    def predicted(self) -> float:
        """Predicted root mean square error, mm."""
        return float(np.sqrt(max(sum(self.shares.values()), 0.0)))

    @property
    def ratio(self) -> float:
        """Ratio of the predicted to the measured error; NaN if nothing was measured."""
        return self.predicted / self.measured if self.measured > 0 else np.nan

    @property
    def design_ratio(self) -> float | None:
        """Ratio of the design's prediction alone to the measured error; None if unknown."""
        if self.design is None:
            return None
        return self.design.rmse / self.measured if self.measured > 0 else np.nan


def predict_error(
    repeatability: Repeatability, frames: DecodedFrames, design: DesignPrediction | None = None
) -> PredictedError:
    """Predict the error on test frames.

    Args:
        repeatability: Repeatability measured in the training.
        frames: The test frames; only their measured error is used.
        design: The prediction of the design, if known.

    Returns:
        The predicted and the measured error.
    """
    clocks = min(repeatability.clocks, repeatability.at_once)
    known = 0.0 if design is None else design.noise**2
    shares = {
        **({} if design is None else {DESIGN: design.rmse**2}),
        REPEATABILITY: repeatability.at_once - clocks - known,
        CLOCKS: clocks,
        DRIFT: repeatability.drift,
        CAMERAS: repeatability.cameras,
    }
    measured = float(np.sqrt((frames.frame_error**2).mean()))
    return PredictedError(design, shares, measured, repeatability.share)


def predict_model_error(
    model: TrainedModel, frames: DecodedFrames, layout: LayoutRecord | None
) -> PredictedError | None:
    """Predict the error of a model on test frames.

    Args:
        model: The model.
        frames: The test frames.
        layout: Layout of the device, if known; a layout other than the model's is not used.

    Returns:
        The prediction; None if the model's training was too short to measure repeatability.
    """
    stated = model.metadata.get("repeatability")
    if not stated:
        return None
    is_of_model = layout is not None and model.layout in ("", layout_hash(layout))
    design = design_prediction(layout, model.kind) if is_of_model and layout is not None else None
    return predict_error(Repeatability(**stated), frames, design)


def design_prediction(layout: LayoutRecord, kind: str) -> DesignPrediction:
    """Return the error that a layout predicts for a kind of decoder.

    Args:
        layout: The layout.
        kind: Kind of the decoder. One that starts from the simulation has the best form's error.

    Returns:
        The prediction.
    """
    best, form = layout.prediction, parse_form(kind)
    noise = float(np.sqrt(max(best.unseen**2 - best.unseen_noise_free**2, 0.0)))
    rmse = layout.unseen.get(form, best.unseen)
    low, high = (best.unseen, best.unseen)
    if layout.band is not None:
        low, high = layout.band.low, layout.band.high
    return DesignPrediction(rmse, noise, low, high)
