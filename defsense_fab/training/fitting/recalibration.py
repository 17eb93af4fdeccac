"""A routine of seconds after a cord was replaced or has aged: a few poses, and rest.

Signals refer to the resistances at rest, which are measured anew: so much for what is added. What
is left are gains. At a pose's extreme x_pc = g_c a_p y_pc + o_c, y being the signals of the
training, a_p how far the pose was shown this time, near one; g_c the channels' gains; o_c by how
much this rest differs from others; all but for how far one show of a pose differs from the next,
which the training has seen.

Cords remember, so that a show of a pose tells a gain by ten or twenty percent only, and a gain that
is wrong does more harm than none. So what may have changed are hypotheses: no channel, one, two, or
all of them. Each has an evidence (Laplace's approximation: MacKay 1992, Bayesian interpolation),
and the gains are the mean over hypotheses by what is left of them: where poses do not tell, the
gains stay near one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Recording
from .pose_signals import PoseSignals, pose_signals, shows

_SHOWN, _GAINS = 0.15, 0.25  # standard deviations of log a, and of the log of a gain that changed
_RESTS = 0.003  # of a cord's signal from one rest to another, by what was done before
_SPREAD = 0.06  # of one show to the next, of a pose's signals, where the model tells none
_TRAINED = 4  # shows of a pose that a training has, about
_MORE = 0.0005  # and so much besides, of signals
_NONE, _ONE, _TWO, _ALL = 0.5, 0.35, 0.1, 0.05  # how likely so many have changed
_FEW = 5  # channels, beyond which pairs are too many
_ENOUGH = 2.0  # root mean square of what is left, in what one show differs by
_FAR = 2.0  # a gain beyond which, or below whose inverse, the cord is another one
_PART = 0.4  # of how far a pose went in the training, at least
_UNSURE = 0.08  # standard deviation of the log of a gain, from which on it is told


@dataclass(frozen=True)
class Recalibration:
    """The corrected model; gains (c,) that were found, and their standard deviations (c,); how
    likely it is that any has `changed`; what the signals were `at_rest` (c,), by the R0 that they
    had; how well gains explain the poses (`left`, 1 is usual). Why they do not suffice, if so
    (`problems`), and what else there is to know (`notes`)."""

    model: TrainedModel
    gain: Float
    error: Float
    changed: float
    at_rest: Float
    left: float
    problems: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Hypothesis:
    """Gains (c,) with the standard deviations of their logs, its log evidence, what is left."""

    gain: Float
    error: Float
    evidence: float
    left: float


def recalibrate(model: TrainedModel, recordings: Sequence[Recording]) -> Recalibration:
    """From recordings of rest and poses that the model was trained on. Raises TrainingError where
    these are missing."""
    trained = {name: model.gain * np.asarray(s) for name, s in model.poses.items()}
    now, at_rest = pose_signals(recordings, trained), rest_signals(recordings)
    shown = {name: pose for name, pose in now.items() if pose.reach >= _PART}
    if len(shown) < 2:
        less = [f"{n} ({p.reach:.0%} as far as then)" for n, p in now.items() if n not in shown]
        raise TrainingError(
            f"re-calibration needs two poses or more of {', '.join(model.poses) or 'none'}, and"
            f" the recording shows {', '.join([*shown, *less]) or 'none'}; record rest and three"
            " poses, as far as in the training; if they were, cords are swapped or lie otherwise:"
            " train again",
            code="too-few-poses",
            shown=tuple(shown),
            incomplete={n: p.reach for n, p in now.items() if n not in shown},
        )
    x = (np.array([p.signals for p in shown.values()]) - at_rest) / (1 + at_rest)
    y = np.array([trained[name] for name in shown])
    sd = _spreads(model, shown, y)
    odds, found = _hypotheses(x, y, sd)
    logs = np.log([h.gain for h in found])
    mean = odds @ logs
    error = np.sqrt(odds @ (logs**2 + np.array([h.error for h in found]) ** 2) - mean**2)
    gain = np.exp(mean)
    left = min(h.left for h in found)
    corrected = replace(model, gain=model.gain * gain)
    return Recalibration(
        corrected, gain, gain * error, float(1 - odds[0]), at_rest, left,
        _problems(model, gain, left), _notes(model, gain, error, now),
    )  # fmt: skip


def rest_signals(recordings: Sequence[Recording]) -> Float:
    """What the signals (c,) are in the last rest that was asked for; zero where none was."""
    at_rest = [r.signals[part] for r in recordings for name, part in shows(r) if name == "rest"]
    at_rest = [s for s in at_rest if np.isfinite(s).any(axis=0).all()]
    if not at_rest:
        return np.zeros(recordings[0].ohm.shape[1])
    return np.asarray(np.nanmedian(at_rest[-1], axis=0))


def _spreads(model: TrainedModel, shown: Mapping[str, PoseSignals], y: Float) -> Float:
    """Standard deviations (p, 1) of what shows of poses differ by from those of the training."""
    size = np.linalg.norm(y, axis=1)
    one = [model.pose_spread.get(name, _SPREAD * s) for name, s in zip(shown, size, strict=True)]
    shows = np.array([p.shows for p in shown.values()])
    return np.asarray((np.array(one) * np.sqrt(1 / shows + 1 / _TRAINED) + _MORE)[:, None])


def _hypotheses(x: Float, y: Float, sd: Float) -> tuple[Float, list[_Hypothesis]]:
    """How likely each is (h,), the first being that nothing changed."""
    channels = range(x.shape[1])
    sets: list[tuple[int, ...]] = [(), *((k,) for k in channels)]
    prior = [_NONE, *(_ONE / len(channels) for _ in channels)]
    pairs = list(combinations(channels, 2)) if 2 < len(channels) <= _FEW else []
    sets += pairs
    prior += [_TWO / len(pairs) for _ in pairs]
    if len(channels) > 1:
        sets.append(tuple(channels))
        prior.append(_ALL)
    found = [_fit(x, y, sd, np.array(free, int)) for free in sets]
    log = np.log(prior) + np.array([h.evidence for h in found])
    odds = np.exp(log - log.max())
    return odds / odds.sum(), found


def _fit(x: Float, y: Float, sd: Float, free: np.ndarray) -> _Hypothesis:
    """Signals (p, c) against those of the training (p, c), with the gains that are `free`."""
    p, c = x.shape
    f = len(free)

    def residuals(z: Float) -> Float:
        gains = np.ones(c)
        gains[free] = np.exp(z[:f])
        shown, offset = np.exp(z[f : f + p]), z[f + p :]
        off = (x - shown[:, None] * gains * y - offset) / sd
        return np.concatenate([off.ravel(), z[:f] / _GAINS, z[f : f + p] / _SHOWN, offset / _RESTS])

    begin = np.zeros(f + p + c)
    ratio = np.nan_to_num(np.nanmedian(x / np.where(np.abs(y) > _MORE, y, np.nan), axis=0), nan=1.0)
    other = np.concatenate([np.log(np.clip(ratio[free], 0.3, 3.0)), begin[f:]])
    fits = [least_squares(residuals, start) for start in ((begin, other) if f else (begin,))]
    best = min(fits, key=lambda fit: float(fit.cost))
    hessian = best.jac.T @ best.jac
    evidence = -best.cost - np.linalg.slogdet(hessian)[1] / 2 - f * np.log(_GAINS)
    gain, error = np.ones(c), np.zeros(c)
    gain[free] = np.exp(best.x[:f])
    error[free] = np.sqrt(np.diag(np.linalg.inv(hessian))[:f])
    left = float(np.sqrt((residuals(best.x)[: p * c] ** 2).mean()))
    return _Hypothesis(gain, error, float(evidence), left)


def _problems(model: TrainedModel, gain: Float, left: float) -> tuple[str, ...]:
    out = []
    if left > _ENOUGH:
        out.append(
            f"gains do not explain what the poses show ({left:.1f} times what one show usually"
            " differs by): the cords lie otherwise, or the poses were shown otherwise; train again"
        )
    for name, g in zip(model.channels, gain, strict=True):
        if not 1 / _FAR < g < _FAR:
            out.append(f"{name}: its gain changed by {g:.2f}, as another cord's; train again")
    return tuple(out)


def _notes(
    model: TrainedModel, gain: Float, error: Float, now: Mapping[str, PoseSignals]
) -> tuple[str, ...]:
    out = [
        f"{name} was shown {pose.reach:.0%} as far as in the training, which tells too little"
        for name, pose in now.items()
        if pose.reach < _PART
    ]
    unsure = [
        f"{name} {g:.2f} ± {g * e:.2f}"
        for name, g, e in zip(model.channels, gain, error, strict=True)
        if e > _UNSURE
    ]
    if unsure:
        out.append(
            f"these poses tell gains roughly only ({', '.join(unsure)}); more rounds, each pose"
            " as far as in the training, tell them better"
        )
    return tuple(out)


def as_told(found: Recalibration) -> Mapping[str, object]:
    """In plain values, for `--json`."""
    names = found.model.channels
    return {
        "gain": dict(zip(names, found.gain.tolist(), strict=True)),
        "error": dict(zip(names, found.error.tolist(), strict=True)),
        "changed": found.changed,
        "at_rest": dict(zip(names, found.at_rest.tolist(), strict=True)),
        "left": found.left,
        "problems": list(found.problems),
        "notes": list(found.notes),
    }
