"""A hand's plan_walk interpolate_keys a device's poses, as a guided recording asks for it: rest, the poses in
turns, and free mixtures of them, quickly and slowly, with pauses and a tremor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from .assumptions import assume
from .device_motion import interpolate_keys

REST, FREE = "rest", "free"
#: How far two, and three poses are taken at once.
MIXTURE_LIMITS = (1.05, 0.75)
_LEAST = 12.0  # s of a plan_walk


@dataclass(frozen=True)
class WalkTraits:
    """How the hand goes."""

    quick: float = assume(0.25, "hand", "s", "shortest way between two shapes", off=0.25)
    slow: float = assume(4.0, "hand", "s", "longest, log-uniform between the two", off=4.0)
    pause: float = assume(0.5, "hand", "s", "mean of the pauses, exponential, and half of the"
                           " shapes have none", off=0.5)  # fmt: skip
    pose: float = assume(8.0, "hand", "s", "that each pose is shown in a round", off=8.0)
    rest: float = assume(5.0, "hand", "s", "of rest at both ends and between rounds", off=5.0)
    back: float = assume(0.2, "hand", "1", "share of shapes that go back to rest", off=0.2)
    furthest: float = assume(1.05, "hand", "1", "of its amplitude that a pose is taken", off=1.05)
    tremor: float = assume(0.01, "tremor", "1", "of the weights, 1 to 9 Hz")


@dataclass(frozen=True)
class Walk:
    """Through poses' weights `keys` (q, d) at `times` (q,) s; `steps` that were asked for, by name
    from when on, s; waves of the tremor: sizes, Hz and phases (3, w, d)."""

    times: Float
    keys: Float
    steps: tuple[tuple[float, str], ...]
    waves: Float

    def __call__(self, time: Float) -> Float:
        """Weights (t, d) at times (t,) s."""
        levels = interpolate_keys(self.times, self.keys, time)
        size, frequency, phase = self.waves
        shakes = size * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)
        return np.asarray(levels * (1 + shakes.sum(1)))


def plan_walk(
    names: Sequence[str], together: Bool, duration: float, rng: np.random.Generator,
    traits: WalkTraits | None = None, shown: int | None = None,
) -> Walk:  # fmt: skip
    """Of `duration` s interpolate_keys d poses, of which those of `together` (d, d) are mixed; the first
    `shown` of them are shown by themselves, too (None: all). Raises CaptureError where it is too
    short."""
    own = traits or WalkTraits()
    if not duration >= _LEAST:
        raise CaptureError(
            f"a recording of {duration:g} s is too short",
            code="duration-too-short",
            where="twin",
            action=f"Use {_LEAST:g} s or more",
            duration=duration,
            minimum=_LEAST,
        )
    hand = _Hand(together, rng, own)
    count = len(names) if shown is None else shown
    rest = min(own.rest, duration / 4)
    turn, end = count * own.pose * 2 + rest, duration - rest
    rounds = max(round((end - rest) / turn), 1)
    hand.rest(rest)
    length = (end - hand.time) / rounds
    for k in range(rounds):
        begin = rest + k * length
        each = (length - rest * (k < rounds - 1)) / (2 * count)
        for pose in range(count):
            hand.alone(str(names[pose]), pose, begin + (pose + 1) * each)
        hand.free(begin + 2 * count * each)
        if k < rounds - 1:
            hand.rest(begin + length)
    hand.rest(duration)
    sizes = own.tremor * rng.uniform(0.3, 0.8, (4, len(names)))
    waves = rng.uniform(1, 9, sizes.shape), rng.uniform(0, 2 * np.pi, sizes.shape)
    return Walk(
        np.array(hand.times), np.array(hand.keys), tuple(hand.steps), np.stack([sizes, *waves])
    )


class _Hand:
    """Goes on from shape to shape."""

    def __init__(self, together: Bool, rng: np.random.Generator, traits: WalkTraits) -> None:
        self._together, self._rng, self._traits = together, rng, traits
        self.time, self.at = 0.0, np.zeros(len(together))
        self.times, self.keys = [0.0], [self.at]
        self.steps: list[tuple[float, str]] = []

    def rest(self, until: float) -> None:
        """At rest until then, on the way there at first."""
        self.steps.append((self.time, REST))
        if self.at.any():
            self._go(np.zeros(len(self.at)), min(0.8, 0.3 * (until - self.time)))
        self._stay(until)

    def alone(self, name: str, pose: int, until: float) -> None:
        """One pose at many levels."""
        self.steps.append((self.time, name))

        def shape() -> Float:
            out = np.zeros(len(self.at))
            out[pose] = self._rng.uniform(0.15, self._traits.furthest)
            return out

        self._wander(shape, until)

    def free(self, until: float) -> None:
        """Mixtures of one to three poses."""
        self.steps.append((self.time, FREE))
        self._wander(self._mixture, until)

    def _wander(self, shape, until: float) -> None:  # type: ignore[no-untyped-def]
        t, rng = self._traits, self._rng
        while True:
            target = np.zeros(len(self.at)) if rng.random() < t.back else shape()
            within = float(np.exp(rng.uniform(np.log(t.quick), np.log(t.slow))))
            pause = rng.exponential(2 * t.pause) * (rng.random() < 0.5)
            middle = self._between(target)
            need = within + pause + (0.0 if middle is None else within)
            if self.time + need > until:
                self._stay(until)
                return
            if middle is not None:
                self._go(middle, within)
            self._go(target, within)
            if pause:
                self._stay(self.time + pause)

    def _mixture(self) -> Float:
        chosen: list[int] = []
        wanted = int(self._rng.integers(1, 4))
        for k in self._rng.permutation(len(self.at)):
            if len(chosen) < wanted and all(self._together[k, i] for i in chosen):
                chosen.append(int(k))
        most = self._traits.furthest if len(chosen) < 2 else MIXTURE_LIMITS[len(chosen) - 2]
        out = np.zeros(len(self.at))
        out[chosen] = self._rng.uniform(0.1, min(most, self._traits.furthest), len(chosen))
        return out

    def _between(self, target: Float) -> Float | None:
        """What to go interpolate_keys where the way there would mix poses that do not go together, or more
        of them than are solved: what both have of each pose."""
        used = np.flatnonzero((self.at > 0) | (target > 0))
        apart = any(not self._together[i, j] for i in used for j in used if i < j)
        return np.minimum(self.at, target) if apart or len(used) > 3 else None

    def _go(self, target: Float, within: float) -> None:
        self.time += within
        self.at = target
        self.times.append(self.time)
        self.keys.append(target)

    def _stay(self, until: float) -> None:
        if until > self.time + 1e-9:
            self._go(self.at, until - self.time)
