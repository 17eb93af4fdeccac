"""Options of the verbs of `workflow.calibrate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ...calibration.options import FitOptions as FitOptions
from ...calibration.options import MeasureOptions as MeasureOptions
from ...core.errors import CalibrationError, FabricationError
from ...core.response import (
    CORD_OFFSET_MM,
    JIG_RADII_MM,
    SPECIMEN_LENGTH_MM,
    SPECIMEN_THICKNESS_MM,
    SPECIMEN_WIDTH_MM,
)
from ...core.schema.options import check_options
from ...sensing.voltage_divider import Resistance
from ...twin.electronics.cords import CordTraits

#: Clearances of the coupon, on the diameter, mm.
CLEARANCES_MM = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)


@dataclass(frozen=True)
class PrintOptions:
    """How calibration parts are printed.

    Attributes:
        cord: Set the cord (see defsense list cords), or the diameter of another cord in mm.
        process: Set the process; see defsense list printers.
    """

    cord: str = "rubber-2mm"
    process: str = "fdm-tpu"


@dataclass(frozen=True)
class TraceOptions:
    """Printed traces of calibration parts, in place of cords.

    Attributes:
        trace: Set the conductive filament (see defsense list filaments), to print traces.
        trace_width: Set the width of the traces in mm (default: 1.2).
        trace_height: Set the height of the traces in mm (default: 0.8).
        device: Set a device with printed traces, whose [cord] and [fabrication] are used.

    Raises:
        FabricationError: A value is not valid.
    """

    trace: str | None = None
    trace_width: Annotated[float, Meta(ge=0.1, le=20)] | None = None
    trace_height: Annotated[float, Meta(ge=0.1, le=20)] | None = None
    device: Path | None = None

    def __post_init__(self) -> None:
        check_options(self, FabricationError)


@dataclass(frozen=True)
class SpecimenOptions:
    """Sizes of the bending specimen and its jigs.

    Attributes:
        length: Set the length of the specimen in mm.
        thickness: Set the thickness of the specimen in mm.
        width: Set the width of the specimen in mm.
        offset: Set the distance of the outer cords from bottom and top in mm (default: 2, or what
            leaves two lines of skin).
        radii: Set the radii of the jigs' surfaces in mm.
    """

    length: float = SPECIMEN_LENGTH_MM
    thickness: float = SPECIMEN_THICKNESS_MM
    width: float = SPECIMEN_WIDTH_MM
    offset: float | None = None
    radii: tuple[float, ...] = JIG_RADII_MM


@dataclass(frozen=True)
class TableOptions:
    """The specimens and jigs of tables of readings; sessions contain theirs.

    Attributes:
        thickness: Set the thickness of the specimens in mm, for tables.
        offset: Set the distance of the outer cords from bottom and top in mm, for tables.
        radii: Set the radii in mm of the jigs that tables may name.
    """

    thickness: float = SPECIMEN_THICKNESS_MM
    offset: float = CORD_OFFSET_MM
    radii: tuple[float, ...] = JIG_RADII_MM


@dataclass(frozen=True)
class ResistivityOptions:
    """Measured resistances of a coupon of printed traces.

    Attributes:
        ohm: Set the resistance of each trace in ohm, in the order of the engraved numbers.
        readings: Set a table with the columns trace and resistance (ohm); rows may repeat.
        spread: Set the standard deviation of a reading in percent that printing and meter cause.

    Raises:
        CalibrationError: A value is not valid.
    """

    ohm: tuple[Resistance, ...] | None = None
    readings: Path | None = None
    spread: Annotated[float, Meta(ge=0.1, le=50)] = FitOptions.spread  # as between specimens

    def __post_init__(self) -> None:
        check_options(self, CalibrationError)


@dataclass(frozen=True)
class SimulatedSpecimenOptions:
    """Simulated specimens, and the cord in them.

    Attributes:
        k: Set the slope of the response at rest (k_res).
        q: Set the quadratic coefficient of the response.
        noise: Set the standard deviation of one reading of (R - R0)/R0.
        play: Set the half width of the hysteresis, relative to R0.
        healing: Set the share of a change that relaxes.
        time: Set the time constant of the relaxation in s.
        spread: Set the standard deviation of the gains of the pieces.
        drift: Set the drift of all resistances per hour.
        misplaced: Set the standard deviation of the heights of the cords in mm.
        lengths: Set the lengths in mm, one per specimen.
        rounds: Set the number of rounds over all jigs.
        seed: Set the random seed.

    Raises:
        CalibrationError: A value is not valid.
    """

    k: Annotated[float, Meta(ge=-100, le=100)] = 2.0
    q: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    noise: Annotated[float, Meta(ge=0, le=1)] = CordTraits.noise
    play: Annotated[float, Meta(ge=0, le=1)] = CordTraits.play
    healing: Annotated[float, Meta(ge=0, le=1)] = CordTraits.healing
    time: Annotated[float, Meta(ge=0.1, le=1e4)] = CordTraits.time
    spread: Annotated[float, Meta(ge=0, le=0.5)] = CordTraits.spread
    drift: Annotated[float, Meta(ge=-10, le=10)] = CordTraits.drift
    misplaced: Annotated[float, Meta(ge=0, le=5)] = 0.0
    lengths: tuple[Annotated[float, Meta(ge=10, le=1000)], ...] = (150.0, 200.0)
    rounds: Annotated[int, Meta(ge=1, le=100)] = MeasureOptions.rounds
    seed: Annotated[int, Meta(ge=0, le=2**32)] = MeasureOptions.seed

    def __post_init__(self) -> None:
        check_options(self, CalibrationError)
        if len(set(self.lengths)) < len(self.lengths):
            raise CalibrationError(
                f"{', '.join(f'{n:g}' for n in self.lengths)} has equal lengths",
                code="length-repeated",
                where="lengths",
                action="Give different lengths",
            )
