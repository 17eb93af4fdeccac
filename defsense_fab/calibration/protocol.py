"""The measuring protocol: the order of the jigs, and when a reading has settled.

The resistance of conductive rubber overshoots when its strain changes, in either direction, and
creeps back over seconds to minutes. The creep is fitted by one exponential.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.storage.session_manifest import Criterion

FACES = ("a", "b")
_CREEP_TIMES_S = np.geomspace(0.5, 120, 60)  # time constants that are tried
_NOISE_SIGMAS = 3.0  # standard errors of a difference that are not a change
_MIN_FRAMES = 3  # in each half of the window
_CREEP_SIGNIFICANCE = 10.0  # reduction of the squared error, in variances of the residual


@dataclass(frozen=True)
class JigStep:
    """One reading of the protocol.

    Attributes:
        turn: Round, from 0.
        radius: Radius of the jig's surface, mm; None for the flat jig.
        face: Face of the specimen that is next to the jig.
    """

    turn: int
    radius: float | None
    face: str

    @property
    def jig(self) -> str:
        """Name of the jig, as it is engraved."""
        return "FLAT" if self.radius is None else f"R{self.radius:g}"


def plan_readings(
    radii: Sequence[float], rounds: int, faces: Sequence[str], rng: np.random.Generator
) -> tuple[JigStep, ...]:
    """Plan the order of the readings.

    Each round starts and ends on the flat jig. Between, the faces are in random order, and the jigs
    on each face are, so that a drift over time looks like noise and not like a response to strain.

    Args:
        radii: Radii of the jigs, mm.
        rounds: Number of rounds.
        faces: Faces of the specimen to measure.
        rng: Random generator of the order.

    Returns:
        The steps.
    """
    out = []
    for turn in range(rounds):
        out.append(JigStep(turn, None, faces[0]))
        for face in rng.permutation(faces):
            out += [JigStep(turn, float(r), str(face)) for r in rng.permutation(radii)]
        out.append(JigStep(turn, None, faces[0]))
    return tuple(out)


@dataclass(frozen=True)
class SettlingState:
    """How far a reading has settled.

    Attributes:
        ohm: Mean resistances (c,) in the last half window, ohm.
        error: Their standard errors (c,), ohm.
        change: Largest relative change between the halves of the window.
        is_settled: Whether all channels have settled.
        is_timed_out: Whether the longest time is over.
    """

    ohm: Float
    error: Float
    change: float
    is_settled: bool
    is_timed_out: bool


def check_settling(time: Float, ohm: Float, criterion: Criterion) -> SettlingState | None:
    """Check whether a reading has settled.

    Args:
        time: Times of the frames since the cord was bent (t,), s.
        ohm: Resistances (t, c), ohm. Those that are not finite mean an open circuit, which never
            settles.
        criterion: When a reading has settled.

    Returns:
        The state; None while there are too few frames.
    """
    half = criterion.window / 2
    now = time[-1] if len(time) else 0.0
    late, early = time > now - half, (time > now - 2 * half) & (time <= now - half)
    if now < criterion.window or min(late.sum(), early.sum()) < _MIN_FRAMES:
        return None
    a, b = ohm[early], ohm[late]
    is_timed_out = bool(now >= criterion.most)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        with np.errstate(invalid="ignore"):
            no_error = np.full(b.shape[1], np.inf)
            return SettlingState(b.mean(0), no_error, np.inf, False, is_timed_out)
    mean = b.mean(0)
    error = b.std(0, ddof=1) / np.sqrt(len(b))
    combined = np.hypot(a.std(0, ddof=1) / np.sqrt(len(a)), error)
    limit = np.maximum(criterion.tolerance * mean, _NOISE_SIGMAS * combined)
    difference = np.abs(mean - a.mean(0))
    is_settled = bool((difference < limit).all() and now >= criterion.least)
    return SettlingState(mean, error, float((difference / mean).max()), is_settled, is_timed_out)


@dataclass(frozen=True)
class Creep:
    """Creep R = end + start exp(-t / time).

    Attributes:
        end: Final resistance, ohm.
        start: Overshoot, ohm.
        time: Time constant, s; NaN where the readings do not creep.
    """

    end: float
    start: float
    time: float


def fit_creep(time: Float, ohm: Float) -> Creep:
    """Fit the creep of one cord.

    Args:
        time: Times of the frames since the cord was bent (t,), s.
        ohm: Resistances (t,), ohm.

    Returns:
        The creep, without overshoot where it is not significant.
    """
    no_creep = Creep(float(ohm.mean()), 0.0, float("nan"))
    best, creep = np.inf, no_creep
    constant_error = float(((ohm - ohm.mean()) ** 2).sum())
    for tau in _CREEP_TIMES_S:
        A = np.stack([np.ones_like(time), np.exp(-time / tau)], axis=1)
        x = np.linalg.lstsq(A, ohm, rcond=None)[0]
        error = float(((A @ x - ohm) ** 2).sum())
        if error < best:
            best, creep = error, Creep(float(x[0]), float(x[1]), float(tau))
    freedom = max(len(ohm) - 3, 1)
    if constant_error - best < _CREEP_SIGNIFICANCE * best / freedom:
        return no_creep
    return creep
