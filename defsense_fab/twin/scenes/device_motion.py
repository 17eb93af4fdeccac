"""Motions of a device: smooth paths through its poses, poses on demand, and the sway of a hand."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from .device_twin import RigidMotion

REST, FREE = "rest", "free"
SWAY_WAVES = 3  # sines that are added up
CYCLE_S = 4.0  # of a pose from rest to full and back
REACTION_S = 0.4  # until the hand moves; it is back at rest by as much before the end
RETURN_S = 0.8  # in which free motion fades to rest at the end
MEAN_MOVE_S, MEAN_PAUSE_S = 0.9, 0.2  # from one key of free motion to the next, and at a key
MIXED_SHARE = 0.3  # of keys that mix in a second pose, and of keys that are followed by rest


@dataclass(frozen=True)
class Ramp:
    """A pose that was simulated at several levels of its full extent.

    Attributes:
        name: Name of the pose.
        levels: Levels (k,), increasing and above 0; at level 0 the device is at rest.
        states: Index of the simulated state at each level (k,).

    Raises:
        CaptureError: The sizes differ (`ramp-sizes-differ`), or the levels do not increase
            (`levels-not-increasing`).
    """

    name: str
    levels: Float
    states: Int

    def __post_init__(self) -> None:
        if self.levels.shape != self.states.shape or not len(self.levels):
            raise CaptureError(
                f"{len(self.levels)} levels for {len(self.states)} states; there must be one level"
                " per state, and at least one",
                code="ramp-sizes-differ",
                where=f"ramp {self.name}",
            )
        if not (np.diff(self.levels, prepend=0.0) > 0).all():
            raise CaptureError(
                f"levels {self.levels.tolist()} do not increase from above 0",
                code="levels-not-increasing",
                where=f"ramp {self.name}",
            )

    def weights(self, level: Float) -> Float:
        """Return the weights (..., k) of the states at levels (...), on a smooth path."""
        return np.asarray(self._path(np.clip(level, 0, self.levels[-1]))[..., 1:])

    @cached_property
    def _path(self) -> CubicSpline:
        knots = np.append(0.0, self.levels)
        return CubicSpline(knots, np.eye(len(knots)), bc_type="natural")


def interpolate_keys(times: Float, keys: Float, time: float | Float) -> Float:
    """Interpolate a path through key values that stops at every key.

    Between keys the path is a polynomial of the fifth degree, with neither speed nor acceleration
    at the keys. Before the first and after the last key it does not move.

    Args:
        times: Times of the keys (q,) s, increasing.
        keys: Values at the keys (q, r).
        time: Times (...) s at which the path is evaluated.

    Returns:
        Values (..., r).
    """
    t = np.clip(time, times[0], times[-1])
    i = np.clip(np.searchsorted(times, t, "right") - 1, 0, max(len(times) - 2, 0))
    j = np.minimum(i + 1, len(times) - 1)
    span = np.maximum(times[j] - times[i], 1e-300)
    x = np.asarray((t - times[i]) / span)[..., None]
    s = x**3 * (10 - 15 * x + 6 * x * x)
    return np.asarray(keys[i] + s * (keys[j] - keys[i]))


def draw_keys(count: int, duration: float, rng: np.random.Generator) -> tuple[Float, Float]:
    """Draw a random path through all poses in turns, each to a random level, from rest on.

    Args:
        count: Number of poses.
        duration: Shortest duration, s.
        rng: Random generator.

    Returns:
        Times of the keys (q,) s, and levels of the poses at the keys (q, count).
    """
    time = MEAN_PAUSE_S
    times, keys = [0.0, time], [np.zeros(count), np.zeros(count)]
    while time < duration:
        for k in rng.permutation(count):
            key = np.zeros(count)
            level = rng.uniform(0.5, 1.0)
            key[k] = level
            if count > 1 and rng.random() < MIXED_SHARE:
                share = rng.uniform(0.3, 0.7)
                other = (k + 1 + rng.integers(count - 1)) % count
                key[k], key[other] = share * level, (1 - share) * level
            stops = [key, np.zeros(count)] if rng.random() < MIXED_SHARE else [key]
            for stop in stops:
                arrival = time + MEAN_MOVE_S * rng.uniform(0.7, 1.3)
                time = arrival + MEAN_PAUSE_S * rng.uniform(0.5, 1.5)
                times += [arrival, time]
                keys += [stop, stop]
    return np.array(times), np.stack(keys)


@dataclass(frozen=True)
class _Performance:
    """A pose that is shown from `start` to `end` s; `keys` are those of free motion."""

    start: float
    end: float
    name: str
    reach: float
    keys: tuple[Float, Float] | None


class PosePlayer:
    """Moves a device through poses on demand; every performance starts and ends at rest.

    Args:
        ramps: The poses.
        seed: Seed of the variation between performances.
    """

    def __init__(self, ramps: Sequence[Ramp], seed: int = 0) -> None:
        self._ramps, self._rng = tuple(ramps), np.random.default_rng(seed)
        self._names = [r.name for r in ramps]
        self._performances: list[_Performance] = []
        self._lock = threading.Lock()

    def perform(self, name: str, start: float, seconds: float) -> None:
        """Show a pose from a time on.

        Args:
            name: Name of a pose, `rest`, or `free` for a mixture of poses.
            start: Start, s.
            seconds: Duration, s.
        """
        first, last = start + REACTION_S, start + max(seconds - REACTION_S, 2 * REACTION_S)
        keys = draw_keys(len(self._ramps), last - first, self._rng) if name == FREE else None
        with self._lock:
            reach = self._rng.uniform(0.9, 1.0)
            self._performances.append(_Performance(first, last, name, reach, keys))

    def levels(self, time: float) -> Mapping[str, float]:
        """Return the level of each pose, 0 to 1, at a time, s."""
        with self._lock:
            current = next(
                (p for p in reversed(self._performances) if p.start <= time < p.end), None
            )
        levels = dict.fromkeys(self._names, 0.0)
        if current is None or current.name == REST:
            return levels
        elapsed, remaining = time - current.start, current.end - time
        if current.keys is not None:
            x = min(1.0, remaining / RETURN_S)
            fade = x * x * (3 - 2 * x)
            free = interpolate_keys(*current.keys, elapsed)
            return {n: float(v) * fade for n, v in zip(self._names, free, strict=True)}
        if current.name in levels:
            cycles = max(1, round((current.end - current.start) / CYCLE_S))
            phase = np.pi * cycles * elapsed / (current.end - current.start)
            levels[current.name] = current.reach * float(np.sin(phase)) ** 2
        return levels

    def weights(self, time: float) -> Float:
        """Return the weights (s,) of the simulated states at a time, s."""
        weights = np.zeros(1 + max((int(r.states.max()) for r in self._ramps), default=-1))
        levels = self.levels(time)
        for ramp in self._ramps:
            level = levels[ramp.name]
            if level:
                weights[ramp.states] += ramp.weights(np.array(level))
        return weights


@dataclass(frozen=True)
class Sway:
    """The unsteadiness of a hand that holds the device: a sum of k waves.

    Attributes:
        center: The point (3,) mm about which the device turns.
        amplitudes: Amplitudes (k, 6): three shifts, mm, and three rotations, radians.
        frequencies: Frequencies (k, 6) Hz.
        phases: Phases (k, 6) radians.
    """

    center: Float
    amplitudes: Float
    frequencies: Float
    phases: Float

    def pose_at(self, time: float) -> RigidMotion:
        """Return the rigid motion of the device at a time, s."""
        waves = self.amplitudes * np.sin(2 * np.pi * self.frequencies * time + self.phases)
        offset = waves.sum(0)
        rotation = Rotation.from_rotvec(offset[3:]).as_matrix()
        return RigidMotion(rotation, self.center - rotation @ self.center + offset[:3])


def draw_sway(
    rng: np.random.Generator,
    center: Float,
    shift: float = 5.0,
    degrees: float = 5.0,
    frequency: float = 0.3,
) -> Sway:
    """Draw a random sway.

    Args:
        rng: Random generator.
        center: The point (3,) mm about which the device turns.
        shift: Extent of the shift, mm.
        degrees: Extent of the rotation, degrees.
        frequency: Mean frequency, Hz.

    Returns:
        The sway.
    """
    size = np.repeat([shift, np.radians(degrees)], 3) / np.sqrt(SWAY_WAVES)
    return Sway(
        np.asarray(center, float),
        size * rng.uniform(0.5, 1.0, (SWAY_WAVES, 6)),
        frequency * rng.uniform(0.4, 1.6, (SWAY_WAVES, 6)),
        rng.uniform(0, 2 * np.pi, (SWAY_WAVES, 6)),
    )
