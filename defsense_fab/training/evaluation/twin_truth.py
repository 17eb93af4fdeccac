"""Where errors come from by the truth that a twin's session has beside it (docs/twin.md).

One cause after another is taken out of what was recorded: the cameras' noise, clocks that are off,
the read-out's noise, and for decoders without a memory also all that a cord remembers and how its
R0 drifts. A memory that was trained on such cords would take out what is no longer there, and one
of how much a signal moved counts noise as movement: read-out noise stays in for that.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset, Recording
from .error_budget import CAMERAS, CLOCKS, READ_OUT, ErrorBudget, budget_by_substitution

TRUTH = "truth.npz"
MEMORY = "memory and drift of the cords"
_WINDOW = 19  # samples, over which noise of what is left of a signal is smoothed out
_ORDER = 3  # of a cord's answer to its ideal signal, without memory
_ROUNDING = 1e-3  # s, by which times of pictures differ in files


def budget_of_truth(model: TrainedModel, dataset: Dataset, last_share: float) -> ErrorBudget | None:
    """Of a dataset all sessions of which are twins', with one run each; None of others, and where
    nothing is known in all stages."""
    stages = [[r] for r in dataset.recordings]
    for parts in stages:
        found = _stages(parts[0], dataset)
        if found is None:
            return None
        parts += found
    names = ["recorded", CAMERAS, CLOCKS, READ_OUT, MEMORY]
    past = model.main.past
    names = names[: 3 if past.worked else 4 if past.count else 5]
    made = [
        (name, replace(dataset, recordings=tuple(parts[k] for parts in stages)))
        for k, name in enumerate(names)
    ]
    try:
        return budget_by_substitution(model, made, last_share)
    except TrainingError:  # no picture that is known in all of them
        return None


def _stages(r: Recording, dataset: Dataset) -> list[Recording] | None:
    """With true places; and true times; and without noise; and with neither memory nor drift."""
    path = Path(r.session) / TRUTH
    if not path.is_file():
        return None
    with np.load(path) as file:
        truth = {name: file[name] for name in file.files}
    ids, channels = truth["ids"].tolist(), truth["channels"].tolist()
    time = truth["sample_time"]
    near = np.searchsorted(truth["time"], r.time - _ROUNDING)
    known = len(time) == len(r.sample_time) and near.max(initial=0) < len(truth["time"])
    if not known or not set(dataset.ids.tolist()) <= set(ids):
        return None
    if not set(dataset.channels) <= set(channels):
        return None
    if np.abs(truth["time"][near] - r.time).max(initial=0.0) > _ROUNDING:
        return None  # pictures that a camera took at other times than it says
    m = [ids.index(i) for i in dataset.ids.tolist()]
    c = [channels.index(name) for name in dataset.channels]
    points = np.where(np.isfinite(r.points), truth["points"][near][:, m], np.nan)
    seen = replace(r, points=points, sigma=np.where(np.isfinite(points), 0.0, np.nan))
    ideal = truth["signals"][:, c]
    plain = _without_memory(ideal, r.signals)
    left = np.where(np.isfinite(r.signals), r.signals - plain, 0.0)
    smooth = plain + savgol_filter(left, _WINDOW, 2, axis=0)
    timely = replace(seen, sample_time=time)
    return [
        seen,
        timely,
        *(replace(timely, ohm=r.rest * (1 + s)) for s in (smooth, plain)),
    ]


def _without_memory(ideal: Float, signals: Float) -> Float:
    """What cords say (n, c) on average of an ideal signal (n, c): their gain, offset and softening,
    by polynomials."""
    out = np.empty_like(ideal)
    for k in range(ideal.shape[1]):
        known = np.isfinite(signals[:, k])
        terms = np.polynomial.polynomial.polyfit(ideal[known, k], signals[known, k], _ORDER)
        out[:, k] = np.polynomial.polynomial.polyval(ideal[:, k], terms)
    return out
