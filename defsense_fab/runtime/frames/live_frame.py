"""The decoded state of a device at one sample, its quality, and notes for the user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ...core.arrays import Float
from ...core.errors import DefsenseError
from ...decoding.quantities import Targets


class Quality(StrEnum):
    """How far a frame can be trusted, from the best to the worst."""

    TRUSTED = "trusted"
    UNTRAINED = "untrained"  # the readings lie outside the range of the training
    FALLBACK = "fallback"  # a cord has failed: decoded without it
    LOST = "lost"  # no usable reading: the last good positions are repeated

    @property
    def level(self) -> int:
        """The quality as a number: 3 for the best to 0 for the worst."""
        return len(Quality) - 1 - list(Quality).index(self)


#: Code of the note on a frame before the resistances at rest are known.
MEASURING_REST = "measuring-rest"


@dataclass(frozen=True)
class Note:
    """A message to the user about a frame, an output or a run. Its `str` is the text.

    Attributes:
        code: Stable identifier of the kind of message, as of `DefsenseError`.
        text: The message, one sentence or a few.
        data: Facts for programs, such as the names of channels.
    """

    code: str
    text: str
    data: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.text

    @classmethod
    def from_error(cls, error: DefsenseError, prefix: str = "") -> Note:
        """Return the note that reports an error, with a `prefix` before its message."""
        return cls(error.code, f"{prefix}{error}", error.data)


@dataclass(frozen=True)
class LiveFrame:
    """The state of a device at one sample of its read-out board.

    Attributes:
        device: Name of the device.
        number: Number of the frame, increasing.
        time: Time of the sample on the board's clock, s.
        arrived: Time when the sample was read, s, on this machine's `time.monotonic`.
        channels: Names of the c channels, in the model's order.
        ohms: Resistances (c,), ohm.
        signals: Relative changes (R - R0)/R0 (c,) with drift removed; NaN of failed channels.
        ids: Numbers of the m markers.
        markers: Marker positions (m, 3), mm, in the rest frame.
        radius: Radius of the 90 % interval around each marker (m,), mm; NaN if unknown.
        distance: Distance of the readings from the training data; above 1 they lie outside it.
        quality: How far the frame can be trusted.
        lost_channel: Name of the channel that failed and was left out, or None.
        controls: Values of the controls by name, within 0..1 or -1..1.
        confidence: Confidence in each control by name, 0..1.
        vertices: Surface vertices (v, 3), mm; None if no surface is solved.
        tracks: Marker positions seen by cameras (m, 3), mm, NaN where a marker was not seen; None
            without cameras.
        notes: What the user should know about this frame.
        targets: Names and units of the targets of a sensor that is no device; `markers` then have
            the shape (m, r), with r = 1 for scalars, and the units of the targets. `ohms` are
            readings in the units of the model.
    """

    device: str
    number: int
    time: float
    arrived: float
    channels: tuple[str, ...]
    ohms: Float
    signals: Float
    ids: tuple[int, ...]
    markers: Float
    radius: Float
    distance: float
    quality: Quality
    lost_channel: str | None = None
    controls: Mapping[str, float] = field(default_factory=dict)
    confidence: Mapping[str, float] = field(default_factory=dict)
    vertices: Float | None = None
    tracks: Float | None = None
    notes: tuple[Note, ...] = ()
    targets: Targets | None = None

    @property
    def tracking_error(self) -> float | None:
        """RMS distance of the markers from where cameras saw them, mm; None if they saw none."""
        if self.tracks is None or not np.isfinite(self.tracks).any():
            return None
        return float(np.sqrt(np.nanmean(((self.markers - self.tracks) ** 2).sum(axis=1))))
