"""What the device's design and the model's training foretell of a test, beside what it measures."""

from __future__ import annotations

import numpy as np

from ...decoding.trained_model import TrainedModel
from ...sensing.layout import LayoutRecord, layout_hash
from ..fitting.repeatability import Repeatability
from ..regression.candidates import parse_form
from .decoded_frames import DecodedFrames
from .predicted_error import PredictedError, Promise, predicted_error


def predicted(
    model: TrainedModel, frames: DecodedFrames, layout: LayoutRecord | None
) -> PredictedError | None:
    """None of a model whose training tells nothing of how well shows repeat: of an older version,
    or too short. A layout that is not the model's promises nothing of it."""
    told = model.told.get("repeatability")
    if not told:
        return None
    own = layout is not None and model.layout in ("", layout_hash(layout))
    promise = promised(layout, model.kind) if own and layout is not None else None
    return predicted_error(Repeatability(**told), frames, promise)


def promised(layout: LayoutRecord, kind: str) -> Promise:
    """By the layout, of a decoder of this `kind`: what starts from the simulation is taken for the
    design's best."""
    best, form = layout.prediction, parse_form(kind)
    noise = float(np.sqrt(max(best.unseen**2 - best.unseen_noise_free**2, 0.0)))
    rmse = layout.unseen.get(form, best.unseen)
    low, high = (best.unseen, best.unseen)
    if layout.band is not None:
        low, high = layout.band.low, layout.band.high
    return Promise(rmse, noise, low, high)
