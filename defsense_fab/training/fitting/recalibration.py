"""A routine of seconds after a cord was replaced or has aged: a few poses, and rest.

Signals refer to the resistances at rest, which are measured anew: so much for what is added. What
is left are gains. At a pose's extreme x_pc = g_c a_p y_pc + o_c, y being the signals of the
training, a_p how far the pose was shown this time, near one; g_c the channels' gains: one, but for
those that changed; o_c by how much this rest differs from others. Gains that lie far from one cost
little more than those that lie near (Cauchy), so that one cord which changed is found rather than
spread over all; those that are not proven to have changed are one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Bool, Float
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Recording
from .pose_signals import pose_signals, shows

_SHOWN, _GAINS = 0.15, 0.1  # spreads of log a and log g
_AS_FAR = 0.01  # the same of log a, where poses are taken to be shown as far as before
_APART = 0.12  # between log g by the one and by the other, beyond which they do not tell it
_RESTS = 0.003  # of a cord's signal from one rest to another, by what was done before
_OFF = 0.04  # of a pose's own signal, and so much more, by which one show differs from the next
_MORE = 0.0015
_ENOUGH = 2.0  # root mean square of what is left, in what one show differs by
_SURE, _LITTLE = 1.0, 0.1  # standard errors, and the change of a gain, that prove one
_FAR = 2.0  # a gain beyond which, or below whose inverse, the cord is another one


@dataclass(frozen=True)
class Recalibration:
    """The corrected model; gains (c,) that were found, and their standard errors (c,); what the
    signals were `at_rest` (c,), by the R0 that they had; how well gains explain the poses (`left`,
    1 is usual); why they do not suffice, if so."""

    model: TrainedModel
    gain: Float
    error: Float
    at_rest: Float
    left: float
    problems: tuple[str, ...]


def recalibrate(model: TrainedModel, recordings: Sequence[Recording]) -> Recalibration:
    """From recordings of rest and poses that the model was trained on. Raises TrainingError where
    these are missing."""
    now, at_rest = pose_signals(recordings), rest_signals(recordings)
    both = [name for name in now if name in model.poses]
    if len(both) < 2:
        raise TrainingError(
            f"re-calibration needs two poses or more of {', '.join(model.poses) or 'none'}, and"
            f" the recording shows {', '.join(now) or 'none'}; record rest and three poses"
        )
    x = (np.array([now[name] for name in both]) - at_rest) / (1 + at_rest)
    y = model.gain * np.array([model.poses[name] for name in both])
    every = np.ones(x.shape[1], bool)
    gain, error, _ = _fit(x, y, every)
    changed = np.abs(np.log(gain)) > np.maximum(_SURE * error / gain, np.log(1 + _LITTLE))
    gain, error, left = _fit(x, y, changed)
    as_far = _fit(x, y, every, _AS_FAR)[0]
    found = replace(model, gain=model.gain * gain)
    return Recalibration(
        found, gain, error, at_rest, left, _problems(model, gain, error, left, as_far)
    )


def rest_signals(recordings: Sequence[Recording]) -> Float:
    """What the signals (c,) are in the last rest that was asked for; zero where none was."""
    at_rest = [r.signals[part] for r in recordings for name, part in shows(r) if name == "rest"]
    at_rest = [s for s in at_rest if np.isfinite(s).any(axis=0).all()]
    if not at_rest:
        return np.zeros(recordings[0].ohm.shape[1])
    return np.asarray(np.nanmedian(at_rest[-1], axis=0))


def _fit(x: Float, y: Float, free: Bool, spread: float = _SHOWN) -> tuple[Float, Float, float]:
    """Gains (c,), their standard errors (c,), and what is left of signals (p, c) against those of
    the training (p, c); gains that are not `free` (c,) are one,
    and log a has a `spread`."""
    p, c = x.shape
    scale = _OFF * np.linalg.norm(y, axis=1, keepdims=True) / np.sqrt(c) + _MORE

    def residuals(z: Float) -> Float:
        gains, shown, offset = np.exp(free * z[:c]), np.exp(z[c : c + p]), z[c + p :]
        off = (x - shown[:, None] * gains * y - offset) / scale
        g = z[:c] / _GAINS  # Cauchy's, as far as it is from the least squares of the rest
        return np.concatenate(
            [off.ravel(), z[c : c + p] / spread, offset / _RESTS,
             np.sign(g) * np.sqrt(np.log1p(g**2))]
        )  # fmt: skip

    begin = np.zeros(2 * c + p)
    starts = [begin]
    ratio = np.median(x / np.where(np.abs(y) > _MORE, y, np.nan), axis=0)
    for k in range(c):
        start = begin.copy()
        start[k] = np.log(np.clip(np.nan_to_num(ratio[k], nan=1.0), 0.3, 3.0))
        starts.append(start)
    best = min((least_squares(residuals, s) for s in starts), key=lambda f: float(f.cost))
    off = residuals(best.x)[: p * c]
    J = best.jac
    covariance = np.linalg.pinv(J.T @ J)
    error = np.exp(best.x[:c]) * np.sqrt(np.maximum(np.diag(covariance)[:c], 0.0))
    return np.exp(free * best.x[:c]), error, float(np.sqrt((off**2).mean()))


def _problems(
    model: TrainedModel, gain: Float, error: Float, left: float, as_far: Float
) -> tuple[str, ...]:
    out = []
    if left > _ENOUGH:
        out.append(
            f"gains do not explain what the poses show ({left:.1f} times what one show usually"
            " differs by): the cords lie otherwise, or the poses were shown otherwise; train again"
        )
    apart = np.abs(np.log(gain / as_far))
    if left <= _ENOUGH and (apart > _APART).any():
        told = ", ".join(f"{n} {g:.2f}" for n, g in zip(model.channels, as_far, strict=True))
        out.append(
            "several gains changed, or the poses were shown less or more far than in the training,"
            f" which these poses do not tell apart (shown as far, they would be {told}); show the"
            " poses as far as then, or train again"
        )
    for name, g, e in zip(model.channels, gain, error, strict=True):
        if not 1 / _FAR < g < _FAR:
            out.append(f"{name}: its gain changed by {g:.2f}, as another cord's; train again")
        elif e > 0.15:
            out.append(f"{name}: these poses hardly strain it (gain {g:.2f} ± {e:.2f})")
    return tuple(out)


def as_told(found: Recalibration) -> Mapping[str, object]:
    """In plain values, for `--json`."""
    names = found.model.channels
    return {
        "gain": dict(zip(names, found.gain.tolist(), strict=True)),
        "error": dict(zip(names, found.error.tolist(), strict=True)),
        "at_rest": dict(zip(names, found.at_rest.tolist(), strict=True)),
        "left": found.left,
        "problems": list(found.problems),
    }
