"""Datasets for training: signals of channels and targets over time, in one or more runs.

Of a device, signals are those of its cords and targets are the positions of its markers. Of any
other sensor, targets are positions or scalars with names and units (`decoding/quantities.py`).

Resistances stay on the samples of the read-out board, with times on the clock of the cameras. A
model's memory of the past is computed from all samples, not only from those at camera frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.errors import TrainingError
from ...decoding.quantities import MARKER_UNIT, Readings, Targets
from ...decoding.signal_history import interpolate_at
from ...sensing.response import relative_change

_FINGERPRINT_MOMENTS = 64
_FINGERPRINT_GAP_S = 1.0  # largest gap between samples across which a value is interpolated
_SAME_RECORDING_CORRELATION = 0.998  # of the fingerprints, from which two recordings are the same


@dataclass(frozen=True)
class Recording:
    """One run of a session on one built device: n samples of c channels, t frames of m targets.

    Attributes:
        name: Name of the run, unique in its dataset.
        session: Name of the session that the run belongs to.
        unit: Name of the built device.
        sample_time: Times of the samples, shape (n,), s, increasing, on the clock of the frames.
        ohm: Resistances, shape (n, c), ohm; NaN where a channel gave none. With `scale`, readings
            in the units of the dataset.
        rest: Resistances at rest R0, shape (c,), ohm. With `scale`, the reference of the readings.
        time: Times of the frames, shape (t,), s, increasing.
        points: Marker positions, shape (t, m, 3), mm, in the device's rest frame; NaN where a
            marker was not visible. Other targets have the shape (t, m, r), with r = 1 for scalars.
        sigma: Standard deviations of the positions along the axes, shape (t, m, r), mm; NaN where
            unknown.
        sync_error: Standard error of the clock synchronization, s; None if unknown.
        poses: Requested poses as (start time in s, name).
        scale: Change of a reading that is a signal of 1, shape (c,); None for resistances of a
            device's cords, whose signals are (R - R0)/R0.

    Raises:
        TrainingError: If shapes do not match or times do not increase.
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
    scale: Float | None = None

    def __post_init__(self) -> None:
        n, c = self.ohm.shape
        t, m, axes = self.points.shape if self.points.ndim == 3 else (0, 0, 0)
        shapes = self.sample_time.shape, self.rest.shape, self.time.shape, self.points.shape
        if (
            shapes != ((n,), (c,), (t,), (t, m, axes))
            or self.sigma.shape != self.points.shape
            or axes not in (1, 3)
        ):
            raise TrainingError(
                f"the shapes of samples {self.ohm.shape}, R0 {self.rest.shape}, frames"
                f" {self.time.shape} and markers {self.points.shape} do not match",
                code="shapes-differ",
                where=self.name,
            )
        for series, times in (("samples", self.sample_time), ("frames", self.time)):
            if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
                k = int(np.argmax(~np.isfinite(times[1:]) | ~(np.diff(times) > 0))) + 1
                raise TrainingError(
                    f"the times of the {series} must increase; the time at index {k} does not",
                    code="times-not-increasing",
                    where=self.name,
                    series=series,
                    index=k,
                )

    @cached_property
    def signals(self) -> Float:
        """Signals of the samples, shape (n, c).

        They are (R - R0)/R0, NaN at open and short circuits. With a scale, they are
        (reading - reference) / scale.
        """
        if self.scale is not None:
            return np.asarray((self.ohm - self.rest) / self.scale)
        is_valid = np.isfinite(self.ohm) & (self.ohm > 0)
        with np.errstate(all="ignore"):
            return np.where(is_valid, relative_change(self.ohm, self.rest), np.nan)

    def signals_at(self, times: Float) -> Float:
        """Interpolate the signals linearly between samples.

        Args:
            times: Times, shape (t,), s.

        Returns:
            Signals (R - R0)/R0, shape (t, c); NaN where no samples are near or a channel was open.
        """
        return interpolate_at(times, self.sample_time, self.signals)

    @property
    def visible(self) -> Bool:
        """Whether each marker was visible in each frame, shape (t, m)."""
        return np.asarray(np.isfinite(self.points[..., 0]))


@dataclass(frozen=True)
class Dataset:
    """Recordings of devices with one layout of cords.

    Attributes:
        device: Name of the device.
        layout: Hash of the layout of the cords; empty if unknown.
        channels: Names of the c channels.
        ids: Numbers of the m markers, shape (m,).
        rest_points: Marker positions at rest, shape (m, 3), mm, in the device's rest frame; of
            other targets, fixed reference values, shape (m, r).
        recordings: The recordings, at least one.
        provenance: Further facts about the origin, in plain values (JSON).
        targets: Names and units of the targets; None for markers.
        readings: Units and reference of the channels; None for resistances of a device's cords.

    Raises:
        TrainingError: If there is no recording, a channel's name repeats, or shapes do not match.
    """

    device: str
    layout: str
    channels: tuple[str, ...]
    ids: Int
    rest_points: Float
    recordings: tuple[Recording, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    targets: Targets | None = None
    readings: Readings | None = None

    def __post_init__(self) -> None:
        c, m = len(self.channels), len(self.ids)
        if not self.recordings:
            raise TrainingError("has no recordings", code="no-recordings", where=self.device)
        if len(set(self.channels)) < c:
            raise TrainingError(
                f"names of channels repeat in {', '.join(self.channels)}",
                code="name-repeated",
                where=self.device,
            )
        axes = 3 if self.targets is None else self.targets.axes
        if self.rest_points.shape != (m, axes):
            raise TrainingError(
                f"{m} markers have rest positions of shape {self.rest_points.shape}",
                code="shapes-differ",
                where=self.device,
            )
        for r in self.recordings:
            if r.ohm.shape[1] != c or r.points.shape[1:] != (m, axes):
                raise TrainingError(
                    f"has {r.ohm.shape[1]} channels and {r.points.shape[1]} markers, but the"
                    f" dataset has {c} and {m}",
                    code="shapes-differ",
                    where=r.name,
                )

    @property
    def frame_count(self) -> int:
        """Number of frames in all recordings."""
        return sum(len(r.time) for r in self.recordings)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the m targets; mm for markers."""
        return (MARKER_UNIT,) * len(self.ids) if self.targets is None else self.targets.units

    def describe(self, index: Sequence[int]) -> str:
        """Return the targets with some indices in words, such as "marker 4, 7" or "angle"."""
        if self.targets is None:
            numbers = ", ".join(str(self.ids[k]) for k in index)
            return f"{'marker' if len(index) == 1 else 'markers'} {numbers}"
        return ", ".join(self.targets.names[k] for k in index)


def recording_fingerprint(r: Recording) -> tuple[float, ...]:
    """Compute numbers that identify a recording by its content, in whichever file it is stored.

    File formats round numbers, start times elsewhere and use other resistances at rest. None of
    these changes how the signals differ from one moment of the recording to the next.

    Args:
        r: The recording; the order of its channels does not matter.

    Returns:
        Differences of the sum of the signals between neighboring moments, which are evenly spaced
        from the first frame to the last; 0 where unknown.
    """
    if len(r.time) < 2:
        return (0.0,) * (_FINGERPRINT_MOMENTS - 1)
    moments = np.linspace(r.time[0], r.time[-1], _FINGERPRINT_MOMENTS)
    total = r.signals.sum(axis=1, keepdims=True)
    steps = np.diff(interpolate_at(moments, r.sample_time, total, _FINGERPRINT_GAP_S)[:, 0])
    return tuple(np.round(np.nan_to_num(steps), 6).tolist())


def is_same_recording(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether two fingerprints belong to the same recording."""
    a, b = np.asarray(one, float), np.asarray(other, float)
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(a.shape == b.shape and size > 0 and a @ b > _SAME_RECORDING_CORRELATION * size)
