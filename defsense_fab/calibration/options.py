"""Options of the measurement of a bending specimen, and of the fit to its readings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from ..core.errors import CalibrationError
from ..core.response import ModelName
from ..core.schema.options import check_options
from ..core.storage.session_manifest import Criterion
from ..sensing.voltage_divider import REFERENCE_OHM, Resistance


@dataclass(frozen=True)
class BoardOptions:
    """How the read-out board measures.

    Attributes:
        reference: Set the reference resistors of the channels in ohm, or one for all.
        rate: Set the sampling rate in Hz.
        average: Set the number of conversions per sample (default: the board's).

    Raises:
        CalibrationError: A value is not valid.
    """

    reference: tuple[Resistance, ...] = (REFERENCE_OHM,)
    rate: Annotated[int, Meta(ge=1, le=500)] = 20
    average: Annotated[int, Meta(ge=1)] | None = None

    def __post_init__(self) -> None:
        check_options(self, CalibrationError)


@dataclass(frozen=True)
class MeasureOptions:
    """Which readings are taken on a specimen.

    Attributes:
        name: Set the name of the specimen; pieces of the same name are the same piece (default:
            its length).
        rounds: Set the number of rounds over all jigs.
        radii: Set the radii in mm of the jigs to use (default: all).
        faces: Choose the sides to place on the jigs: both, or one.
        tolerance: Set the remaining change of a settled reading in percent.
        longest: Set the time in s after which a reading is taken even if it has not settled.
        seed: Set the random seed of the order of the jigs.

    Raises:
        CalibrationError: A value is not valid.
    """

    name: str | None = None
    rounds: Annotated[int, Meta(ge=1, le=100)] = 3
    radii: tuple[float, ...] | None = None
    faces: Literal["ab", "a", "b"] = "ab"
    tolerance: Annotated[float, Meta(ge=1e-4, le=10)] = 100 * Criterion.tolerance
    longest: Annotated[float, Meta(ge=10, le=3600)] = Criterion.most
    seed: Annotated[int, Meta(ge=0, le=2**53)] = 1

    def __post_init__(self) -> None:
        check_options(self, CalibrationError)

    @property
    def criterion(self) -> Criterion:
        """When a reading has settled."""
        return Criterion(tolerance=self.tolerance / 100, most=self.longest)


@dataclass(frozen=True)
class FitOptions:
    """How the response is fitted.

    Attributes:
        neutral: Choose what to do when the neutral cord drifts: refuse, correct by subtracting its
            change from the others, or ignore.
        model: Choose the model of the response (default: the one that the readings support).
        spread: Set the standard deviation between specimens, in percent, assumed while they are
            few.

    Raises:
        CalibrationError: A value is not valid.
    """

    neutral: Literal["refuse", "correct", "ignore"] = "refuse"
    model: ModelName | None = None
    spread: Annotated[float, Meta(ge=0, le=50)] = 3.0

    def __post_init__(self) -> None:
        check_options(self, CalibrationError)
