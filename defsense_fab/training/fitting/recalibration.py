"""Recalibrate a model in seconds after a cord was replaced or has aged: some poses, and rest.

Signals refer to the resistances at rest, which are measured again; this removes what is added to
a resistance. What remains are gains. At a pose's extreme

    x_pc = g_c a_p y_pc + o_c,

where y are the signals of the training, a_p is how far the pose was shown this time (near one,
unless all signals show that the pose was shown in part only),
g_c are the gains of the channels, and o_c is the difference of this rest from others. In addition,
one repetition of a pose differs from the next, which the training has measured.

Cords have memory, so one repetition determines a gain to ten or twenty percent only, and a wrong
gain does more harm than none. So the changes are hypotheses: no channel, one, two, or all of them.
Each has an evidence (Laplace's approximation), and the gains are averaged over the hypotheses by
their probabilities. Where the poses do not determine them, the gains stay near one.

References:
    MacKay 1992, Bayesian interpolation, Neural Computation 4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Float, Int
from ...core.errors import TrainingError
from ...decoding.trained_model import TrainedModel
from ..data.dataset import Recording
from .pose_signals import PoseSignals, extract_pose_signals, last_rest_signals

# Prior standard deviations of log a, and of the log of a gain that changed.
_SHOWN_SIGMA, _GAIN_SIGMA = 0.15, 0.25
_MAX_SHOWN_DEVIATION = 2.0  # of log a, in standard deviations, up to which its prior is used
_REST_SIGMA = 0.003  # of a signal from one rest to another, depending on the movements before
_USUAL_SPREAD = 0.06  # between repetitions, of a pose's signals, if the model states none
_TRAINED_REPETITIONS = 4  # of a pose in a typical training
_MIN_SPREAD = 0.0005  # of the signals, in addition
# Prior probabilities that no channel, one, two or all have changed.
_P_NONE, _P_ONE, _P_TWO, _P_ALL = 0.5, 0.35, 0.1, 0.05
_MAX_CHANNELS_FOR_PAIRS = 5  # with more channels, there are too many pairs
_MAX_RESIDUAL = 2.0  # root mean square, in standard deviations of a repetition
_MAX_GAIN = 2.0  # beyond it, or below its inverse, the cord is another one
_MIN_REACH = 0.4  # of how far a pose went in the training
_MAX_LOG_GAIN_ERROR = 0.08  # above it, a note is given


@dataclass(frozen=True)
class Recalibration:
    """Result of a recalibration.

    Attributes:
        model: The corrected model.
        gain: Gains of the channels, shape (c,), relative to the model's.
        gain_error: Standard deviations of the gains, shape (c,).
        change_probability: Probability that any gain has changed.
        rest_signals: Signals at rest relative to the recording's R0, shape (c,).
        residual: Root mean square of what the gains do not explain, in standard deviations of a
            repetition; 1 is usual.
        problems: Why gains do not suffice, if so.
        notes: What else the user should know.
    """

    model: TrainedModel
    gain: Float
    gain_error: Float
    change_probability: float
    rest_signals: Float
    residual: float
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """Return the result in plain values, as `defsense recalibrate --json` writes it."""
        names = self.model.channels
        return {
            "gain": dict(zip(names, self.gain.tolist(), strict=True)),
            "error": dict(zip(names, self.gain_error.tolist(), strict=True)),
            "changed": self.change_probability,
            "at_rest": dict(zip(names, self.rest_signals.tolist(), strict=True)),
            "left": self.residual,
            "problems": list(self.problems),
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class _Hypothesis:
    """A fit with some gains free.

    Attributes:
        gain: Gains, shape (c,).
        log_error: Standard deviations of the logs of the gains, shape (c,).
        evidence: Log evidence.
        residual: Root mean square residual.
    """

    gain: Float
    log_error: Float
    evidence: float
    residual: float


def recalibrate(model: TrainedModel, recordings: Sequence[Recording]) -> Recalibration:
    """Correct the gains of a model from recordings of rest and of poses it was trained on.

    Args:
        model: The trained model, with the signals of its poses.
        recordings: Recordings of rest and of two poses or more.

    Returns:
        The corrected model, with the gains found.

    Raises:
        TrainingError: If fewer than two poses are shown far enough.
    """
    trained = {name: model.gain * np.asarray(s) for name, s in model.poses.items()}
    poses = extract_pose_signals(recordings, trained)
    rest_signals = last_rest_signals(recordings)
    shown = {name: pose for name, pose in poses.items() if pose.reach >= _MIN_REACH}
    if len(shown) < 2:
        incomplete = {name: pose.reach for name, pose in poses.items() if name not in shown}
        shown_poses = [
            *shown,
            *(f"{n} ({reach:.0%} as far as trained)" for n, reach in incomplete.items()),
        ]
        raise TrainingError(
            f"recalibration needs two poses or more of {', '.join(model.poses) or 'none'}, but the"
            f" recording shows {', '.join(shown_poses) or 'none'}",
            code="too-few-poses",
            action=(
                "Record rest and three poses, each as far as in the training; if this was done,"
                " cords are swapped or lie differently, so train again"
            ),
            shown=tuple(shown),
            incomplete=incomplete,
        )
    x = (np.array([p.signals for p in shown.values()]) - rest_signals) / (1 + rest_signals)
    y = np.array([trained[name] for name in shown])
    probabilities, hypotheses = _weigh_hypotheses(
        x, y, _pose_sigmas(model, shown, y), _shown_sigmas(shown)
    )
    logs = np.log([h.gain for h in hypotheses])
    mean = probabilities @ logs
    log_errors = np.array([h.log_error for h in hypotheses])
    log_error = np.sqrt(probabilities @ (logs**2 + log_errors**2) - mean**2)
    gain = np.exp(mean)
    residual = min(h.residual for h in hypotheses)
    return Recalibration(
        model=replace(model, gain=model.gain * gain),
        gain=gain,
        gain_error=gain * log_error,
        change_probability=float(1 - probabilities[0]),
        rest_signals=rest_signals,
        residual=residual,
        problems=_describe_problems(model, gain, residual),
        notes=_describe_notes(model, gain, log_error, poses),
    )


def _pose_sigmas(model: TrainedModel, shown: Mapping[str, PoseSignals], y: Float) -> Float:
    """Return standard deviations (p, 1) of the poses' signals from those of the training."""
    size = np.linalg.norm(y, axis=1)
    spread = [
        model.pose_spread.get(name, _USUAL_SPREAD * s) for name, s in zip(shown, size, strict=True)
    ]
    repetitions = np.array([p.repetitions for p in shown.values()])
    factor = np.sqrt(1 / repetitions + 1 / _TRAINED_REPETITIONS)
    return np.asarray((np.array(spread) * factor + _MIN_SPREAD)[:, None])


def _shown_sigmas(shown: Mapping[str, PoseSignals]) -> Float:
    """Return prior standard deviations (p,) of log a.

    If a pose was clearly shown in part only, the prior is as wide as that. Otherwise the missing
    part would be explained by a gain of the cord that only this pose strains.
    """
    deviation = np.abs(np.log([p.reach for p in shown.values()]))
    is_partial = deviation > _MAX_SHOWN_DEVIATION * _SHOWN_SIGMA
    return np.where(is_partial, deviation, _SHOWN_SIGMA)


def _weigh_hypotheses(
    x: Float, y: Float, sigma: Float, shown_sigma: Float
) -> tuple[Float, list[_Hypothesis]]:
    """Return the hypotheses with their probabilities (h,); the first is that nothing changed."""
    channels = range(x.shape[1])
    sets: list[tuple[int, ...]] = [(), *((k,) for k in channels)]
    prior = [_P_NONE, *(_P_ONE / len(channels) for _ in channels)]
    has_pairs = 2 < len(channels) <= _MAX_CHANNELS_FOR_PAIRS
    pairs = list(combinations(channels, 2)) if has_pairs else []
    sets += pairs
    prior += [_P_TWO / len(pairs) for _ in pairs]
    if len(channels) > 1:
        sets.append(tuple(channels))
        prior.append(_P_ALL)
    hypotheses = [_fit_hypothesis(x, y, sigma, shown_sigma, np.array(free, int)) for free in sets]
    log = np.log(prior) + np.array([h.evidence for h in hypotheses])
    odds = np.exp(log - log.max())
    return odds / odds.sum(), hypotheses


def _fit_hypothesis(x: Float, y: Float, sigma: Float, shown_sigma: Float, free: Int) -> _Hypothesis:
    """Fit signals (p, c) to those of the training (p, c), with some gains free (by index)."""
    p, c = x.shape
    f = len(free)

    def residuals(z: Float) -> Float:
        gains = np.ones(c)
        gains[free] = np.exp(z[:f])
        shown, offset = np.exp(z[f : f + p]), z[f + p :]
        difference = (x - shown[:, None] * gains * y - offset) / sigma
        return np.concatenate(
            [
                difference.ravel(),
                z[:f] / _GAIN_SIGMA,
                z[f : f + p] / shown_sigma,
                offset / _REST_SIGMA,
            ]
        )

    zero = np.zeros(f + p + c)
    ratios = x / np.where(np.abs(y) > _MIN_SPREAD, y, np.nan)
    ratio = np.nan_to_num(np.nanmedian(ratios, axis=0), nan=1.0)
    measured = np.concatenate([np.log(np.clip(ratio[free], 0.3, 3.0)), zero[f:]])
    fits = [least_squares(residuals, start) for start in ((zero, measured) if f else (zero,))]
    best = min(fits, key=lambda fit: float(fit.cost))
    hessian = best.jac.T @ best.jac
    evidence = -best.cost - np.linalg.slogdet(hessian)[1] / 2 - f * np.log(_GAIN_SIGMA)
    gain, log_error = np.ones(c), np.zeros(c)
    gain[free] = np.exp(best.x[:f])
    log_error[free] = np.sqrt(np.diag(np.linalg.inv(hessian))[:f])
    residual = float(np.sqrt((residuals(best.x)[: p * c] ** 2).mean()))
    return _Hypothesis(gain, log_error, float(evidence), residual)


def _describe_problems(model: TrainedModel, gain: Float, residual: float) -> tuple[str, ...]:
    problems = []
    if residual > _MAX_RESIDUAL:
        problems.append(
            f"gains do not explain the poses (residual {residual:.1f} times the usual difference of"
            " a repetition): the cords lie differently, or the poses were shown differently; train"
            " again"
        )
    for name, g in zip(model.channels, gain, strict=True):
        if not 1 / _MAX_GAIN < g < _MAX_GAIN:
            problems.append(f"{name}: its gain changed by {g:.2f}, as another cord's; train again")
    return tuple(problems)


def _describe_notes(
    model: TrainedModel, gain: Float, log_error: Float, poses: Mapping[str, PoseSignals]
) -> tuple[str, ...]:
    notes = [
        f"{name} was shown {pose.reach:.0%} as far as in the training, which is too little to use"
        for name, pose in poses.items()
        if pose.reach < _MIN_REACH
    ]
    uncertain = [
        f"{name} {g:.2f} ± {g * e:.2f}"
        for name, g, e in zip(model.channels, gain, log_error, strict=True)
        if e > _MAX_LOG_GAIN_ERROR
    ]
    if uncertain:
        notes.append(
            f"these poses determine gains roughly ({', '.join(uncertain)}); record more"
            " rounds, with each pose as far as in the training"
        )
    return tuple(notes)
