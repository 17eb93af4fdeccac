"""How a device is moved: smoothly interpolate_keys its poses and mixtures of them, held by a hand."""

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

# The hands that move a device's twin: told which pose to show, they show it.

REST, FREE = "rest", "free"
_CYCLE = 4.0  # s, for a pose from rest to full and back
_REACT = 0.4  # s, until hands move, and by which they are back before the time is over


@dataclass(frozen=True)
class _Show:
    start: float
    end: float
    name: str
    reach: float
    motion: Motion | None


class PosePlayer:
    """Levels of poses by time, s; each show begins and ends at rest."""

    def __init__(self, ramps: Sequence[Ramp], seed: int = 0) -> None:
        self._ramps, self._rng = tuple(ramps), np.random.default_rng(seed)
        self._names = [r.name for r in ramps]
        self._shows: list[_Show] = []
        self._lock = threading.Lock()

    def perform(self, name: str, start: float, seconds: float) -> None:
        """Show a pose, `rest`, or a `free` mixture of them, for so long from `start`, s."""
        first, last = start + _REACT, start + max(seconds - _REACT, 2 * _REACT)
        motion = None
        if name == FREE:
            motion = draw_motion(self._ramps, last - first, self._rng, pace=0.9, pause=0.2)
        with self._lock:
            self._shows.append(_Show(first, last, name, self._rng.uniform(0.9, 1.0), motion))

    def levels(self, time: float) -> Mapping[str, float]:
        """Of each pose, 0 to 1."""
        with self._lock:
            show = next((s for s in reversed(self._shows) if s.start <= time < s.end), None)
        out = dict.fromkeys(self._names, 0.0)
        if show is None or show.name == REST:
            return out
        into, left = time - show.start, show.end - time
        if show.motion is not None:
            found = show.motion.levels(into)
            near = min(1.0, left / 0.8)  # back to rest at the end
            calm = near * near * (3 - 2 * near)
            return {n: float(v) * calm for n, v in zip(self._names, found, strict=True)}
        if show.name in out:
            cycles = max(1, round((show.end - show.start) / _CYCLE))
            phase = np.pi * cycles * into / (show.end - show.start)
            out[show.name] = show.reach * float(np.sin(phase)) ** 2
        return out

    def weights(self, time: float) -> Float:
        """Of the simulated states (s,)."""
        size = 1 + max((int(r.states.max()) for r in self._ramps), default=-1)
        out = np.zeros(size)
        levels = self.levels(time)
        for ramp in self._ramps:
            level = levels[ramp.name]
            if level:
                out[ramp.states] += ramp.weights(np.array(level))
        return out


_WAVES = 3


@dataclass(frozen=True)
class Ramp:
    """A pose that was simulated at `levels` (k,), increasing and above 0, of its full extent, in
    the `states` (k,); at level 0 the device is at rest."""

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
        """Those (..., k) of its states at levels (...): a smooth path interpolate_keys all of them."""
        return np.asarray(self._path(np.clip(level, 0, self.levels[-1]))[..., 1:])

    @cached_property
    def _path(self) -> CubicSpline:
        knots = np.append(0.0, self.levels)
        return CubicSpline(knots, np.eye(len(knots)), bc_type="natural")


def interpolate_keys(times: Float, keys: Float, time: float | Float) -> Float:
    """Values (..., r) at times (...) s of a path interpolate_keys `keys` (q, r) at `times` (q,) s, smooth
    (the fifth degree, with neither speed nor acceleration at the keys); still before and after."""
    t = np.clip(time, times[0], times[-1])
    i = np.clip(np.searchsorted(times, t, "right") - 1, 0, max(len(times) - 2, 0))
    j = np.minimum(i + 1, len(times) - 1)
    span = np.maximum(times[j] - times[i], 1e-300)
    x = np.asarray((t - times[i]) / span)[..., None]
    s = x**3 * (10 - 15 * x + 6 * x * x)
    return np.asarray(keys[i] + s * (keys[j] - keys[i]))


@dataclass(frozen=True)
class Motion:
    """Goes interpolate_keys the levels `keys` (q, r) of the ramps at `times` (q,) s, as `interpolate_keys` does."""

    ramps: tuple[Ramp, ...]
    times: Float
    keys: Float

    def __post_init__(self) -> None:
        if self.keys.shape != (len(self.times), len(self.ramps)) or not len(self.times):
            raise CaptureError(
                f"keys of shape {self.keys.shape} do not fit {len(self.times)} times and"
                f" {len(self.ramps)} ramps",
                code="motion-sizes-differ",
                where="motion",
            )
        if (np.diff(self.times) <= 0).any() or not (self.keys >= 0).all():
            raise CaptureError(
                "times must increase, and levels must be at least 0",
                code="motion-not-increasing",
                where="motion",
            )

    @property
    def states(self) -> int:
        """How many states the ramps name."""
        return 1 + max((int(r.states.max()) for r in self.ramps), default=-1)

    def levels(self, time: float | Float) -> Float:
        """Of the ramps (..., r) at times (...) s."""
        return interpolate_keys(self.times, self.keys, time)

    def weights(self, time: float | Float) -> Float:
        """Of the states (..., s) at times (...) s: of a mixture of poses, the sum of theirs."""
        levels = self.levels(time)
        out = np.zeros((*levels.shape[:-1], self.states))
        for k, ramp in enumerate(self.ramps):
            out[..., ramp.states] += ramp.weights(levels[..., k])
        return out


def script_motion(
    ramps: Sequence[Ramp], script: Sequence[tuple[float, Mapping[str, float]]]
) -> Motion:
    """Through levels of poses by name at times, s: [(1.0, {"bend": 0.5}), (2.0, {}), ...]. Raises
    CaptureError for a pose without a ramp."""
    names = [r.name for r in ramps]
    keys = np.zeros((len(script), len(names)))
    for row, (_, levels) in zip(keys, script, strict=True):
        for name, level in levels.items():
            if name not in names:
                raise CaptureError(
                    f"the pose {name!r} has no ramp",
                    code="unknown-pose",
                    where="motion",
                    action=f"Use one of {', '.join(names)}",
                    pose=name,
                )
            row[names.index(name)] = level
    return Motion(tuple(ramps), np.array([t for t, _ in script], float), keys)


def draw_motion(
    ramps: Sequence[Ramp],
    duration: float,
    rng: np.random.Generator,
    pace: float = 1.2,
    pause: float = 0.4,
    mixed: float = 0.3,
) -> Motion:
    """A motion of at least so many s: interpolate_keys all poses in turns, each to a random level, a part
    `mixed` of them with another pose, or back to rest; `pace` s on the way, `pause` s there."""
    count, time = len(ramps), pause
    times, keys = [0.0, pause], [np.zeros(count), np.zeros(count)]
    while time < duration:
        for k in rng.permutation(count):
            key = np.zeros(count)
            level = rng.uniform(0.5, 1.0)
            key[k] = level
            if count > 1 and rng.random() < mixed:
                share = rng.uniform(0.3, 0.7)
                other = (k + 1 + rng.integers(count - 1)) % count
                key[k], key[other] = share * level, (1 - share) * level
            stops = [key, np.zeros(count)] if rng.random() < mixed else [key]
            for stop in stops:
                arrived = time + pace * rng.uniform(0.7, 1.3)
                time = arrived + pause * rng.uniform(0.5, 1.5)
                times += [arrived, time]
                keys += [stop, stop]
    return Motion(tuple(ramps), np.array(times), np.stack(keys))


@dataclass(frozen=True)
class Sway:
    """A hand that holds the device at `about` (3,) mm and is never quite still: a sum of waves of
    `amplitudes` (k, 6), three of shift in mm and three of turn in radians, `frequencies` (k, 6) in
    Hz and `phases` (k, 6)."""

    about: Float
    amplitudes: Float
    frequencies: Float
    phases: Float

    def at(self, time: float) -> RigidMotion:
        """How it holds the device at a time, s."""
        waves = self.amplitudes * np.sin(2 * np.pi * self.frequencies * time + self.phases)
        move = waves.sum(0)
        turn = Rotation.from_rotvec(move[3:]).as_matrix()
        return RigidMotion(turn, self.about - turn @ self.about + move[:3])


def draw_sway(
    rng: np.random.Generator, about: Float, shift: float = 5.0, degrees: float = 5.0,
    frequency: float = 0.3,
) -> Sway:  # fmt: skip
    """A random one of about such extents and frequency, Hz."""
    size = np.repeat([shift, np.radians(degrees)], 3) / np.sqrt(_WAVES)
    return Sway(
        np.asarray(about, float),
        size * rng.uniform(0.5, 1.0, (_WAVES, 6)),
        frequency * rng.uniform(0.4, 1.6, (_WAVES, 6)),
        rng.uniform(0, 2 * np.pi, (_WAVES, 6)),
    )
