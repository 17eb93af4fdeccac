"""Random walks of a hand through the poses of a device, as guided recordings request them.

A walk consists of rest, the poses one after the other, and free mixtures of poses, both fast and
slow, with pauses and a tremor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from .assumptions import assume
from .device_motion import FREE, REST, interpolate_keys

#: Largest levels of poses in mixtures of two, and of three poses.
MIXTURE_LIMITS = (1.05, 0.75)
MIN_WALK_S = 12.0
MAX_MIXED_POSES = 3
MAX_RETURN_S = 0.8  # to rest
TREMOR_WAVES = 4
TREMOR_HZ = (1, 9)


@dataclass(frozen=True)
class WalkTraits:
    """Assumptions on how the hand moves.

    Attributes:
        quick: Shortest time from one shape to the next, s.
        slow: Longest time, s; times are log-uniform.
        pause: Mean pause at a shape, s; half of the shapes have none.
        pose: Time that each pose is shown in a round, s.
        rest: Rest at both ends and between rounds, s.
        back: Share of moves that return to rest.
        furthest: Largest level of a pose.
        tremor: Amplitude of the tremor, relative to the levels.
    """

    quick: float = assume(0.25, "hand", "s", "shortest time between two shapes", off=0.25)
    slow: float = assume(4.0, "hand", "s", "longest time, log-uniform between the two", off=4.0)
    pause: float = assume(
        0.5, "hand", "s", "mean pause, exponential; half of the shapes have none", off=0.5
    )
    pose: float = assume(8.0, "hand", "s", "time that each pose is shown in a round", off=8.0)
    rest: float = assume(5.0, "hand", "s", "rest at both ends and between rounds", off=5.0)
    back: float = assume(0.2, "hand", "1", "share of moves that return to rest", off=0.2)
    furthest: float = assume(1.05, "hand", "1", "largest level of a pose", off=1.05)
    tremor: float = assume(0.01, "tremor", "1", "of the levels, 1 to 9 Hz")


@dataclass(frozen=True)
class Walk:
    """A walk through the levels of d poses.

    Attributes:
        times: Times of the keys (q,) s.
        keys: Levels of the poses (q, d).
        steps: Start, s, and name of each requested step: a pose, `rest` or `free`.
        waves: Amplitudes, frequencies in Hz and phases of the tremor (3, w, d).
    """

    times: Float
    keys: Float
    steps: tuple[tuple[float, str], ...]
    waves: Float

    def __call__(self, time: Float) -> Float:
        """Return the levels (t, d) of the poses at times (t,) s."""
        levels = interpolate_keys(self.times, self.keys, time)
        amplitude, frequency, phase = self.waves
        tremor = amplitude * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)
        return np.asarray(levels * (1 + tremor.sum(1)))


def plan_walk(
    names: Sequence[str],
    together: Bool,
    duration: float,
    rng: np.random.Generator,
    traits: WalkTraits | None = None,
    shown: int | None = None,
) -> Walk:
    """Plan a random walk.

    Args:
        names: Names of d poses.
        together: Whether two poses may be mixed (d, d).
        duration: Duration, s.
        rng: Random generator.
        traits: How the hand moves.
        shown: The first `shown` poses are also shown alone; None for all.

    Returns:
        The walk.

    Raises:
        CaptureError: The duration is too short (`duration-too-short`).
    """
    traits = traits or WalkTraits()
    if not duration >= MIN_WALK_S:
        raise CaptureError(
            f"a recording of {duration:g} s is too short",
            code="duration-too-short",
            where="twin",
            action=f"Use {MIN_WALK_S:g} s or more",
            duration=duration,
            minimum=MIN_WALK_S,
        )
    hand = _Hand(together, rng, traits)
    count = len(names) if shown is None else shown
    rest = min(traits.rest, duration / 4)
    turn, end = count * traits.pose * 2 + rest, duration - rest
    rounds = max(round((end - rest) / turn), 1)
    hand.rest(rest)
    length = (end - hand.time) / rounds
    for k in range(rounds):
        start = rest + k * length
        pose_duration = (length - rest * (k < rounds - 1)) / (2 * count)
        for pose in range(count):
            hand.show_pose(str(names[pose]), pose, start + (pose + 1) * pose_duration)
        hand.move_freely(start + 2 * count * pose_duration)
        if k < rounds - 1:
            hand.rest(start + length)
    hand.rest(duration)
    amplitudes = traits.tremor * rng.uniform(0.3, 0.8, (TREMOR_WAVES, len(names)))
    frequencies = rng.uniform(*TREMOR_HZ, amplitudes.shape)
    phases = rng.uniform(0, 2 * np.pi, amplitudes.shape)
    waves = np.stack([amplitudes, frequencies, phases])
    return Walk(np.array(hand.times), np.array(hand.keys), tuple(hand.steps), waves)


class _Hand:
    """A hand that moves the device from shape to shape."""

    def __init__(self, together: Bool, rng: np.random.Generator, traits: WalkTraits) -> None:
        self._together, self._rng, self._traits = together, rng, traits
        self.time, self.levels = 0.0, np.zeros(len(together))
        self.times, self.keys = [0.0], [self.levels]
        self.steps: list[tuple[float, str]] = []

    def rest(self, until: float) -> None:
        """Return to rest and stay there until a time, s."""
        self.steps.append((self.time, REST))
        if self.levels.any():
            rest = np.zeros(len(self.levels))
            self._move(rest, min(MAX_RETURN_S, 0.3 * (until - self.time)))
        self._stay(until)

    def show_pose(self, name: str, pose: int, until: float) -> None:
        """Show one pose at many levels until a time, s."""
        self.steps.append((self.time, name))

        def draw_shape() -> Float:
            levels = np.zeros(len(self.levels))
            levels[pose] = self._rng.uniform(0.15, self._traits.furthest)
            return levels

        self._wander(draw_shape, until)

    def move_freely(self, until: float) -> None:
        """Show mixtures of one to three poses until a time, s."""
        self.steps.append((self.time, FREE))
        self._wander(self._draw_mixture, until)

    def _wander(self, draw_shape: Callable[[], Float], until: float) -> None:
        t, rng = self._traits, self._rng
        while True:
            target = np.zeros(len(self.levels)) if rng.random() < t.back else draw_shape()
            duration = float(np.exp(rng.uniform(np.log(t.quick), np.log(t.slow))))
            pause = rng.exponential(2 * t.pause) * (rng.random() < 0.5)
            detour = self._find_detour(target)
            needed = duration + pause + (0.0 if detour is None else duration)
            if self.time + needed > until:
                self._stay(until)
                return
            if detour is not None:
                self._move(detour, duration)
            self._move(target, duration)
            if pause:
                self._stay(self.time + pause)

    def _draw_mixture(self) -> Float:
        chosen: list[int] = []
        count = int(self._rng.integers(1, MAX_MIXED_POSES + 1))
        for k in self._rng.permutation(len(self.levels)):
            if len(chosen) < count and all(self._together[k, i] for i in chosen):
                chosen.append(int(k))
        furthest = self._traits.furthest
        limit = furthest if len(chosen) < 2 else MIXTURE_LIMITS[len(chosen) - 2]
        levels = np.zeros(len(self.levels))
        levels[chosen] = self._rng.uniform(0.1, min(limit, furthest), len(chosen))
        return levels

    def _find_detour(self, target: Float) -> Float | None:
        """Return a shape to move through if the direct way to the target is not allowed.

        The direct way is not allowed if it mixes poses that must not be mixed, or more poses than
        were simulated together. The detour has what both shapes share of each pose.
        """
        used = np.flatnonzero((self.levels > 0) | (target > 0))
        is_forbidden = any(not self._together[i, j] for i in used for j in used if i < j)
        if is_forbidden or len(used) > MAX_MIXED_POSES:
            return np.minimum(self.levels, target)
        return None

    def _move(self, target: Float, duration: float) -> None:
        self.time += duration
        self.levels = target
        self.times.append(self.time)
        self.keys.append(target)

    def _stay(self, until: float) -> None:
        if until > self.time + 1e-9:
            self._move(self.levels, until - self.time)
