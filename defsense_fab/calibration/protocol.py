"""When a cord has come to rest after it was bent anew, and what its way there tells.

Conductive rubber jumps too high when its strain changes, either way, and creeps back over seconds
to minutes; the creep is fitted by one exponential.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.storage.session_manifest import Criterion

# The protocol of a calibration: which jig next, and which way up.

FACES = ("a", "b")


@dataclass(frozen=True)
class JigStep:
    """One reading of the round `turn` (from 0): the specimen lies on the jig of this surface
    `radius`, mm, or on the flat one (None), with its `face` down."""

    turn: int
    radius: float | None
    face: str

    @property
    def jig(self) -> str:
        """The jig's name, as it is engraved."""
        return "FLAT" if self.radius is None else f"R{self.radius:g}"


def plan(
    radii: Sequence[float], rounds: int, faces: Sequence[str], rng: np.random.Generator
) -> tuple[JigStep, ...]:
    """Rounds that begin and end on the flat jig; in between, one face after the other, in random
    order, and on each the jigs in random order: what drifts with time then looks like noise, not
    like an answer to strain."""
    out = []
    for turn in range(rounds):
        out.append(JigStep(turn, None, faces[0]))
        for face in rng.permutation(faces):
            out += [JigStep(turn, float(r), str(face)) for r in rng.permutation(radii)]
        out.append(JigStep(turn, None, faces[0]))
    return tuple(out)


_TIMES = np.geomspace(0.5, 120, 60)  # s, of the exponentials that are tried
_NOISY = 3.0  # standard errors of a difference that are no change


@dataclass(frozen=True)
class Settled:
    """What there is to say after so many s: the mean resistances `ohm` (c,) of the last half window
    and their standard errors (c,), the largest relative `change` between the halves, whether that
    is `still`, and whether the time is `over`."""

    ohm: Float
    error: Float
    change: float
    still: bool
    over: bool


def settled(time: Float, ohm: Float, criterion: Criterion) -> Settled | None:
    """Of readings `ohm` (t, c) at `time` (t,) s since the cord was bent; None while they are too
    few to tell. Readings that are not finite are an open circuit and never settle."""
    half = criterion.window / 2
    now = time[-1] if len(time) else 0.0
    late, early = time > now - half, (time > now - 2 * half) & (time <= now - half)
    if now < criterion.window or min(late.sum(), early.sum()) < 3:
        return None
    a, b = ohm[early], ohm[late]
    over = bool(now >= criterion.most)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        with np.errstate(invalid="ignore"):
            return Settled(b.mean(0), np.full(b.shape[1], np.inf), np.inf, False, over)
    mean = b.mean(0)
    error = b.std(0, ddof=1) / np.sqrt(len(b))
    both = np.hypot(a.std(0, ddof=1) / np.sqrt(len(a)), error)
    limit = np.maximum(criterion.tolerance * mean, _NOISY * both)
    apart = np.abs(mean - a.mean(0))
    still = bool((apart < limit).all() and now >= criterion.least)
    return Settled(mean, error, float((apart / mean).max()), still, over)


@dataclass(frozen=True)
class Creep:
    """R = end + start exp(-t / time): `end` and `start` in ohm, `time` in s, NaN where the readings
    show none."""

    end: float
    start: float
    time: float


def creep(time: Float, ohm: Float) -> Creep:
    """Fitted to readings `ohm` (t,) of one cord at `time` (t,) s."""
    best, found = np.inf, Creep(float(ohm.mean()), 0.0, float("nan"))
    straight = float(((ohm - ohm.mean()) ** 2).sum())
    for tau in _TIMES:
        A = np.stack([np.ones_like(time), np.exp(-time / tau)], axis=1)
        x = np.linalg.lstsq(A, ohm, rcond=None)[0]
        left = float(((A @ x - ohm) ** 2).sum())
        if left < best:
            best, found = left, Creep(float(x[0]), float(x[1]), float(tau))
    free = max(len(ohm) - 3, 1)
    if straight - best < 10 * best / free:  # not clear of the noise
        return Creep(float(ohm.mean()), 0.0, float("nan"))
    return found
