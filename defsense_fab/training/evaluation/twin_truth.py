"""Split errors by cause with the truth that a twin's session contains (docs/twin.md).

One cause after another is removed from the recorded data: camera noise, clock errors, read-out
noise, and, for decoders without a memory, the memory of the cords and the drift of their R0. A
memory that was trained on such cords would correct what is no longer there. A memory of how much a
signal moved counts noise as movement, so for such decoders read-out noise is not removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial
from scipy.signal import savgol_filter

from ...core.arrays import Float
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Dataset, Recording
from .corrections import residual_of
from .decoded_frames import decode_frames, match_to_model, select_common
from .error_budget import (
    CAMERAS,
    CLOCKS,
    DECODER,
    READ_OUT,
    UNSEEN,
    ErrorBudget,
    correct_decoder,
    unseen_share,
)

TRUTH = "truth.npz"
MEMORY = "memory and drift of the cords"

_SMOOTHING_SAMPLES = 19  # over which noise is smoothed out of the remainder of a signal
_RESPONSE_ORDER = 3  # of a cord's signal as a polynomial of its ideal signal, without memory
_TIME_ROUNDING_S = 1e-3  # by which frame times differ in files


def budget_of_truth(model: TrainedModel, dataset: Dataset, last_share: float) -> ErrorBudget | None:
    """Split the error of a model on sessions of a twin.

    Args:
        model: The model.
        dataset: The dataset, with one run in each session.
        last_share: Share of the frames to test on, at the end of all runs.

    Returns:
        The shares by cause; None if a session is not a twin's, or no frame is in all stages.
    """
    stages = [[r] for r in dataset.recordings]
    for parts in stages:
        true_parts = _load_stages(parts[0], dataset)
        if true_parts is None:
            return None
        parts += true_parts
    past = model.main.past
    names = ["recorded", CAMERAS, CLOCKS, READ_OUT, MEMORY]
    names = names[: 3 if past.worked else 4 if past.count else 5]
    datasets = [
        (name, replace(dataset, recordings=tuple(parts[k] for parts in stages)))
        for k, name in enumerate(names)
    ]
    return split_by_substitution(model, datasets, last_share)


def split_by_substitution(
    model: TrainedModel, stages: Sequence[tuple[str, Dataset]], last_share: float = 1.0
) -> ErrorBudget | None:
    """Split the error of a model by removing one cause after another from the data.

    Args:
        model: The model.
        stages: Datasets by name. The first is as recorded; each of the others has one more cause
            removed, which its name states.
        last_share: Share of the frames to test on, at the end of all runs.

    Returns:
        The shares by cause; None if no frame is in all stages. The share of a stage is what the
        error loses by it, and can be negative. The remaining error is divided among the decoder,
        unseen poses, and unexplained.
    """
    data = [match_to_model(model, d) for _, d in stages]
    frames = select_common([decode_frames(model, d, last_share) for d in data])
    visible = np.logical_and.reduce([f.visible for f in frames])
    if not visible.any():
        return None
    frames = [
        replace(f, measured=np.where(visible[..., None], f.measured, np.nan)).select(
            visible.any(axis=1)
        )
        for f in frames
    ]
    squares = [f.mean(f.marker_error**2) for f in frames]
    shares = {
        cause: before - after
        for (cause, _), before, after in zip(stages[1:], squares, squares[1:], strict=False)
    }
    remaining = residual_of(frames[-1])
    enriched = correct_decoder(model, data[-1], frames[-1], remaining)
    shares[DECODER] = remaining.square - enriched.square
    shares[UNSEEN] = unseen_share(frames[-1], enriched)
    return ErrorBudget.complete(squares[0], shares)


def _load_stages(r: Recording, dataset: Dataset) -> list[Recording] | None:
    """Return a recording with more and more of the truth; None if it is not a twin's.

    The stages have true positions, then true times, then no noise, then neither memory nor drift.
    """
    path = Path(r.session) / TRUTH
    if not path.is_file():
        return None
    with np.load(path) as file:
        truth = {name: file[name] for name in file.files}
    ids, channels = truth["ids"].tolist(), truth["channels"].tolist()
    time = truth["sample_time"]
    index = np.searchsorted(truth["time"], r.time - _TIME_ROUNDING_S)
    is_complete = len(time) == len(r.sample_time) and index.max(initial=0) < len(truth["time"])
    if not is_complete or not set(dataset.ids.tolist()) <= set(ids):
        return None
    if not set(dataset.channels) <= set(channels):
        return None
    if np.abs(truth["time"][index] - r.time).max(initial=0.0) > _TIME_ROUNDING_S:
        return None  # frames that a camera took at other times than stated
    m = [ids.index(i) for i in dataset.ids.tolist()]
    c = [channels.index(name) for name in dataset.channels]
    points = np.where(np.isfinite(r.points), truth["points"][index][:, m], np.nan)
    placed = replace(r, points=points, sigma=np.where(np.isfinite(points), 0.0, np.nan))
    plain = _remove_memory(truth["signals"][:, c], r.signals)
    remainder = np.where(np.isfinite(r.signals), r.signals - plain, 0.0)
    smooth = plain + savgol_filter(remainder, _SMOOTHING_SAMPLES, 2, axis=0)
    timed = replace(placed, sample_time=time)
    return [
        placed,
        timed,
        replace(timed, ohm=r.rest * (1 + smooth)),
        replace(timed, ohm=r.rest * (1 + plain)),
    ]


def _remove_memory(ideal: Float, signals: Float) -> Float:
    """Return the average signals (n, c) of cords with these ideal signals (n, c).

    Gain, offset and softening of the cords are described by polynomials.
    """
    plain = np.empty_like(ideal)
    for k in range(ideal.shape[1]):
        is_known = np.isfinite(signals[:, k])
        x = ideal[is_known, k]
        order = _RESPONSE_ORDER if np.ptp(x) > 0 else 0
        plain[:, k] = Polynomial.fit(x, signals[is_known, k], order)(ideal[:, k])
    return plain
