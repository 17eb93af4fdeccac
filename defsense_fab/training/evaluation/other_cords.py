"""Whether a device has the cords that a model was trained on, by their resistances at rest."""

from __future__ import annotations

import numpy as np

from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset

_DRIFT = 0.15  # of R0, by which a cord that is the same changes at most


def other_cords(name: str, model: TrainedModel, dataset: Dataset) -> list[str]:
    """Notes on channels whose R0 has changed since the model's training by more than the others'.
    Nothing is said of models of more than one built device, of other ones, or where an R0 is not
    known: signals without resistances are in units of R0."""
    before = np.array([r for r in model.told.get("R0", {}).values() if None not in r], float)
    if before.ndim != 2 or before.shape[1] != len(model.channels) or (before == 1).all():
        return []
    units = model.told.get("units_trained", [])
    out = []
    for session in dict.fromkeys(r.session for r in dataset.recordings):
        own = [r for r in dataset.recordings if r.session == session]
        if set(dataset.channels) != set(model.channels) or {r.unit for r in own} != set(units):
            continue
        order = [dataset.channels.index(c) for c in model.channels]
        R0 = np.median([r.rest[order] for r in own], axis=0)
        if not np.isfinite(R0).all() or (R0 <= 0).any() or (R0 == 1).all():
            continue
        change = np.log(R0) - np.log(np.median(before, axis=0))
        change -= np.median(change)
        for channel, off in zip(model.channels, change.tolist(), strict=True):
            if abs(off) > np.log1p(_DRIFT):
                out.append(
                    f"{session}: R0 of {channel} is {np.exp(off):.2f} times that which {name} was"
                    " trained with: was the cord replaced? 'defsense recalibrate' corrects the"
                    " model, or train again"
                )
    return out
