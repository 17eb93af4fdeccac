"""Judge whether a model is useful: compare its error with the movement of the markers itself.

A constant shape, the mean of the training or the shape at rest, needs no signals. A model is
useless if its error on test frames is nearly as large as that of the better constant shape, or as
the error that models of signals from other times reach by chance.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...decoding.error_scale import describe_error
from ...decoding.signal_history import interpolate_at
from ...decoding.trained_model import TrainedModel, decode_inputs
from ..regression.frames import Frames
from .chance_error import measure_chance

#: Share of the movement from which an error is that of a useless model. At 0.8, the model explains
#: 1 - 0.8^2 = 36 % of the movement's variance. On real recordings useful models are at 0.73 or less
#: (a joint capsule of printed gauges), models of signals of another time at 0.92 or more.
MAX_ERROR_SHARE = 0.8
#: Share of the movement below which an error is not compared with chance: exactly periodic movement
#: is predicted by signals of any period.
MIN_CHANCE_SHARE = 0.5
_MAX_CHANCE_RATIO = 0.8  # of the error and the error by chance
_TRAVEL_QUANTILE = 0.99  # of the frames: wrong markers are further from rest than any real one
_BATCH_FRAMES = 1000  # features of more frames at once would take much memory


@dataclass(frozen=True)
class Cause:
    """A cause of large errors.

    Attributes:
        code: Stable kebab-case identifier.
        message: The cause, with the evidence for it.
        action: One thing that the user can do about it.
        data: Facts for programs.
    """

    code: str
    message: str
    action: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Usefulness:
    """Error of a model on test frames, and the movement of the markers in them.

    Attributes:
        error: Root mean square error of the model over all visible markers, mm.
        movement: Root mean square distance of the same markers from the better of two constant
            shapes, the mean of the training and the shape at rest, mm.
        cause: The likeliest cause of a useless model; None for a useful one.
        unit: Unit of both; empty if unknown.
        chance: Error that models of signals from other times reach, mm; None if not compared.
        travel: Largest distance of any marker from its place at rest, mm, without the 1 % of the
            frames in which it is farthest; None for targets.
    """

    error: float
    movement: float
    cause: Cause | None = None
    unit: str = "mm"
    chance: float | None = None
    travel: float | None = None

    @property
    def is_useless(self) -> bool:
        """Whether the error is nearly as large as the movement, or as an error by chance."""
        return self.error >= MAX_ERROR_SHARE * self.movement or self.is_chance

    @property
    def is_chance(self) -> bool:
        """Whether models of signals from other times are nearly as good."""
        return self.chance is not None and self.error >= _MAX_CHANCE_RATIO * self.chance

    def error_in_words(self, error: float) -> str:
        """Return an error, mm, with its share of the travel and its grade, in words.

        They are empty for a useless model and for targets.
        """
        if self.travel is None or self.is_useless:
            return ""
        return describe_error(error, self.travel, what="the markers move")

    @property
    def message(self) -> str:
        """The judgment of a useless model in words; empty for a useful one."""
        if not self.is_useless:
            return ""
        unit, moving = self.unit, "markers" if self.unit == "mm" else "targets"
        text = f"the model is useless: its error on the test, {self.error:.2f} {unit}, is "
        if self.error >= MAX_ERROR_SHARE * self.movement:
            size = "larger than" if self.error > self.movement else "nearly as large as"
            text += f"{size} the movement of the {moving} itself, {self.movement:.2f} {unit}"
        else:
            text += (
                f"not clearly smaller than that of models of signals from other times,"
                f" {self.chance:.2f} {unit} (the {moving} move by {self.movement:.2f} {unit})"
            )
        if self.cause is None:
            return f"{text}."
        return f"{text}. Likely cause: {self.cause.message}. {self.cause.action}."

    def to_json(self) -> dict[str, Any]:
        """Return the judgment in plain values; lengths in mm."""
        cause = self.cause
        return {
            "code": "useless-model" if self.is_useless else None,
            "error": self.error,
            "movement": self.movement,
            "chance": self.chance,
            "travel": self.travel,
            "grade": self.error_in_words(self.error) or None,
            "message": self.message,
            "cause": None if cause is None else {"code": cause.code, **cause.data},
        }


def measure_usefulness(model: TrainedModel, frames: Frames) -> Usefulness:
    """Compare the error of a model with the movement of the markers.

    Args:
        model: The model.
        frames: Test frames, with the model's channels and markers in its order.

    Returns:
        The judgment, without a cause.
    """
    points = frames.points
    main, middle = model.main, model.main.range.middle[None]
    if main.outside is not None:  # a linear decoder's output of the mean is the mean of its outputs
        mean_shape = main.outside(middle[:, : len(main.channels)]).reshape(points.shape[1:])
    else:
        mean_shape = decode_inputs(main, middle, points.shape[1]).points[0]
    movement = min(rms_distance(points, shape) for shape in (mean_shape, model.rest_points))
    error = rms_distance(points, decode(model, frames))
    chance = None
    if MIN_CHANCE_SHARE * movement <= error < MAX_ERROR_SHARE * movement:
        chance = measure_chance(frames) * movement
    travel = None if model.targets is not None else _travel(points, model.rest_points)
    return Usefulness(error, movement, chance=chance, travel=travel)


def rms_distance(points: Float, others: Float) -> float:
    """Return the root mean square distance, mm, of visible points (t, m, 3) from others."""
    squares = ((points - others) ** 2).sum(axis=-1)
    is_known = np.isfinite(squares)
    return float(np.sqrt(squares[is_known].mean())) if is_known.any() else 0.0


def _travel(points: Float, rest_points: Float) -> float:
    """Return the largest distance, mm, of points (t, m, 3) from rest, without the rarest ones."""
    distances = np.linalg.norm(points - rest_points, axis=2)
    visible = distances[:, np.isfinite(distances).any(axis=0)]
    return float(np.nanquantile(visible, _TRAVEL_QUANTILE, axis=0).max(initial=0.0))


def decode(model: TrainedModel, frames: Frames) -> Float:
    """Decode frames whose channels are in the model's order; returns positions (t, m, 3), mm."""
    decoded = np.empty(frames.points.shape)
    for k, r in enumerate(frames.dataset.recordings):
        index = np.flatnonzero(frames.recording_index == k)
        times = r.time[frames.frame_index[index]]
        decoded[index] = decode_at(model, r.sample_time, r.signals, times)
    return decoded


def decode_at(model: TrainedModel, time: Float, signals: Float, at: Float) -> Float:
    """Decode signals (n, c) at times (t,), s; returns positions (t, m, 3), mm, NaN in gaps."""
    z = interpolate_at(at, time, model.main.inputs(time, model.correct(signals)))
    parts = [
        decode_inputs(model.main, z[k : k + _BATCH_FRAMES], len(model.ids)).points
        for k in range(0, max(len(z), 1), _BATCH_FRAMES)
    ]
    return np.concatenate(parts)
