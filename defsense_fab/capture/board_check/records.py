"""What a check of the wiring compares: expectations of the cords, readings, and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...sensing.voltage_divider import Dividers

#: Stable codes of findings. `ok` is the only one that needs no action.
Code = Literal[
    "ok",
    "open",
    "short",
    "swapped",
    "noisy",
    "hum",
    "loose",
    "reference-wrong",
    "saturated",
    "rest-off",
    "not-read",
]
#: Hands off the device; the wire of one cord is moved; a pose is held.
PhaseKind = Literal["rest", "wiggle", "pose"]


@dataclass(frozen=True)
class Change:
    """The change of a cord's resistance in a pose, relative to rest.

    Attributes:
        mean: Expected (R - R0)/R0.
        deviation: Standard deviation over built devices and cords.
    """

    mean: float
    deviation: float


@dataclass(frozen=True)
class ExpectedCord:
    """What the build expects of one cord.

    Attributes:
        name: Name of the cord.
        ohm: Resistance at rest in the device, ohm.
        low: Lowest resistance of a sound cord at rest, ohm.
        high: Highest resistance of a sound cord at rest, ohm.
        noise: Standard deviation of (R - R0)/R0 of one conversion.
        contact: Standard deviation of the resistance of each of its two joints, ohm.
        changes: Changes in poses by name.
    """

    name: str
    ohm: float
    low: float
    high: float
    noise: float
    contact: float
    changes: Mapping[str, Change] = field(default_factory=dict)


@dataclass(frozen=True)
class BoardSetup:
    """How the read-out board measured.

    Attributes:
        converter: Converter of the board, 0 or 1, as in `Info`.
        full_scale: Counts at the supply's voltage.
        averages: Conversions per sample.
        reference: Reference resistors (c,), ohm.
    """

    converter: int
    full_scale: float
    averages: int
    reference: Float

    @property
    def dividers(self) -> Dividers:
        """The voltage dividers of the channels."""
        return Dividers(self.reference, self.full_scale)


@dataclass(frozen=True)
class Phase:
    """Readings of one step of the check.

    Attributes:
        kind: What the user did.
        subject: Name of the cord whose wire was moved, or of the pose; empty for rest.
        time: Times of the samples by the board's clock (n,), s.
        counts: Mean counts of a conversion (n, c), NaN where a channel was not read.

    Raises:
        CaptureError: There are fewer than `MIN_SAMPLES` samples (`too-few-samples`).
    """

    kind: PhaseKind
    subject: str
    time: Float
    counts: Float

    def __post_init__(self) -> None:
        if len(self.time) < MIN_SAMPLES:
            raise CaptureError(
                f"only {len(self.time)} samples arrived",
                code="too-few-samples",
                where=f"{self.kind} {self.subject}".strip(),
                action="Check the board's cable, and repeat the check",
                count=len(self.time),
            )

    @property
    def medians(self) -> Float:
        """Median counts (c,); NaN for a channel that was never read."""
        out = np.full(self.counts.shape[1], np.nan)
        is_read = np.isfinite(self.counts).any(axis=0)
        out[is_read] = np.nanmedian(self.counts[:, is_read], axis=0)
        return out


#: Smallest number of samples of a step: fits of hum have up to 7 unknowns.
MIN_SAMPLES = 30


@dataclass(frozen=True)
class Finding:
    """The state of one channel.

    Attributes:
        channel: Index of the channel.
        cord: Name of the cord that belongs to the channel.
        code: Stable code.
        text: What was found, as a sentence without its period.
        action: What to do, as a sentence without its period; empty if nothing.
        others: Names of the other cords concerned.
        data: Numbers behind the finding.
    """

    channel: int
    cord: str
    code: Code
    text: str
    action: str = ""
    others: tuple[str, ...] = ()
    data: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.text}. {self.action}." if self.action else f"{self.text}."
