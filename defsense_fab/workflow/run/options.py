"""Options of a live run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from ...core.errors import LiveError
from ...core.schema.options import check_options
from ...sensing.voltage_divider import Resistance


@dataclass(frozen=True)
class RunOptions:
    """Options of a live run of one device.

    Resistances are given once for all channels, or once for each in the order of the read-out
    board.

    Attributes:
        rate: Set the sampling rate in Hz.
        rest: Set the resistances at rest in ohm (default: measured at the start).
        reference: Set the reference resistors of the voltage dividers in ohm (default: those of
            the training, else of the assembly guide).
        surface: Choose how the surface is computed: from the simulated states and as rigidly as
            possible beyond them (default), or by either method alone (basis, arap).
        fallback: Decode without a cord that is lost, rather than as if it were connected.
        record: Set the folder for the readings (default: live/TIME in the device folder).
        animation: Record the moving surface to this file: .glb, .usdc or .npz.
    """

    rate: Annotated[int, Meta(ge=10, le=500)] = 100
    rest: tuple[Resistance, ...] | None = None
    reference: tuple[Resistance, ...] | None = None
    surface: Literal["default", "basis", "arap"] | None = "default"
    fallback: bool = True
    record: Path | None = None
    animation: Path | None = None

    def __post_init__(self) -> None:
        check_options(self, LiveError)
