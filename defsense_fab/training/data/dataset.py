"""What training eats: what the cords said, and where the markers were, of one or more runs.

The resistances stay on the read-out board's own samples, put on the markers' clock: what a model
knows of the past comes from all of them, not from those beside a picture alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.signal_history import at_times
from ...sensing.response import relative_change

# A recording is known again by what is in it, whatever file it lies in.
#
# Formats round, count their times from elsewhere, and know other resistances at rest. What none of
# that touches is how the signals go from one moment of the recording to the next.

_MOMENTS = 64
_GAP = 1.0  # s between samples, at most, that are still told of
_SAME = 0.998  # correlation, from which on two recordings are one


def fingerprint(r: Recording) -> tuple[float, ...]:
    """The sum of the signals at moments that are evenly spaced from the first picture to the last,
    from one to the next; zero where it is not known. Whichever order channels are in."""
    if len(r.time) < 2:
        return (0.0,) * (_MOMENTS - 1)
    moments = np.linspace(r.time[0], r.time[-1], _MOMENTS)
    total = r.signals.sum(axis=1, keepdims=True)
    steps = np.diff(at_times(moments, r.sample_time, total, _GAP)[:, 0])
    return tuple(np.round(np.nan_to_num(steps), 6).tolist())


def same_recording(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two fingerprints are of one recording."""
    a, b = np.asarray(one, float), np.asarray(other, float)
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(a.shape == b.shape and size > 0 and a @ b > _SAME * size)


@dataclass(frozen=True)
class Recording:
    """One run of a `session` on one built device (`unit`).

    n samples of c cords: `sample_time` (n,) s, increasing, on the clock of the pictures; `ohm`
    (n, c), NaN where a channel gave none; R0 at `rest` (c,) ohm. t pictures: `time` (t,) s,
    increasing; `points` (t, m, 3) mm in the device's rest frame, NaN where a marker was not seen;
    `sigma` (t, m, 3) mm, standard deviations along the axes, NaN where not known. `sync_error` s,
    the standard error of the clocks' comparison, None where it is not known. `poses`: which pose
    was asked for from when on, s.
    """

    name: str
    session: str
    unit: str
    sample_time: Float
    ohm: Float
    rest: Float
    time: Float
    points: Float
    sigma: Float
    sync_error: float | None = None
    poses: tuple[tuple[float, str], ...] = ()

    def __post_init__(self) -> None:
        n, c = self.ohm.shape
        t, m = self.points.shape[:2]
        shapes = self.sample_time.shape, self.rest.shape, self.time.shape, self.points.shape
        if shapes != ((n,), (c,), (t,), (t, m, 3)) or self.sigma.shape != (t, m, 3):
            raise TrainingError(
                f"{self.name}: samples {self.ohm.shape}, R0 {self.rest.shape}, pictures"
                f" {self.time.shape} and markers {self.points.shape} do not go together",
                code="shapes-differ",
            )
        for what, when in (("samples", self.sample_time), ("pictures", self.time)):
            if not np.isfinite(when).all() or (np.diff(when) <= 0).any():
                k = int(np.argmax(~np.isfinite(when[1:]) | ~(np.diff(when) > 0))) + 1
                raise TrainingError(
                    f"{self.name}: the times of the {what} must increase; the one at {k} does not",
                    code="times-not-increasing",
                    series=what,
                    index=k,
                )

    @cached_property
    def signals(self) -> Float:
        """(R - R0)/R0 (n, c) of the samples, NaN where there is no resistance: of an open circuit,
        or a short one."""
        known = np.isfinite(self.ohm) & (self.ohm > 0)
        with np.errstate(all="ignore"):
            return np.where(known, relative_change(self.ohm, self.rest), np.nan)

    def signals_at(self, when: Float) -> Float:
        """(R - R0)/R0 (t, c) at the times (t,) s: linear between samples, NaN where there are none
        near, or a channel was open."""
        return at_times(when, self.sample_time, self.signals)

    @property
    def seen(self) -> Bool:
        """Which markers were seen (t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))


@dataclass(frozen=True)
class Dataset:
    """Runs of devices of one layout: names of the c `channels`, numbers of the m markers `ids`
    (m,) and where they are at rest, `rest_points` (m, 3) mm in the device's frame. `layout` is the
    hash of the cords' layout, empty where it is not known; `provenance` is what else is known, in
    plain values."""

    device: str
    layout: str
    channels: tuple[str, ...]
    ids: Int
    rest_points: Float
    recordings: tuple[Recording, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        c, m = len(self.channels), len(self.ids)
        if not self.recordings:
            raise TrainingError(
                f"{self.device}: there is no recording to train on", code="no-recordings"
            )
        if len(set(self.channels)) < c:
            raise TrainingError(
                f"{self.device}: channels must have different names", code="duplicate-names"
            )
        if self.rest_points.shape != (m, 3):
            raise TrainingError(
                f"{self.device}: {m} markers have places {self.rest_points.shape}",
                code="shapes-differ",
            )
        for r in self.recordings:
            if r.ohm.shape[1] != c or r.points.shape[1] != m:
                raise TrainingError(
                    f"{r.name}: {r.ohm.shape[1]} channels and {r.points.shape[1]} markers, where"
                    f" the device has {c} and {m}",
                    code="shapes-differ",
                )

    @property
    def frames(self) -> int:
        """Pictures in all runs."""
        return sum(len(r.time) for r in self.recordings)
