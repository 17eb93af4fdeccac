"""Everything that a device's twin takes for granted, by traits that can be switched off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...core.device.device import Device
from ...core.errors import CaptureError
from ..electronics.readout_board import BoardTraits
from ..electronics.rubber_cords import RubberTraits
from ..filming.camera_kinds import CAMERA_KINDS, DEFAULT_CAMERA_KIND
from ..scenes.assumptions import Assumption, assume, disable_traits, list_assumptions
from ..scenes.hand_walk import WalkTraits
from ..scenes.marker_measurement import MarkerTraits
from .built_unit import BuildingTraits
from .device_fields import MechanicsTraits

# What is taken for granted of the cameras that film a twin.


@dataclass(frozen=True)
class FilmTraits:
    """The cameras: `count` of a `kind` (`camera_kinds.py`), `rate` pictures a second; how far off
    their calibration is; how steadily the hand holds the device."""

    kind: str = DEFAULT_CAMERA_KIND
    count: int = 2
    rate: float = assume(15.0, "cameras", "Hz", "pictures", off=15.0)
    focal: float = assume(
        5e-4, "calibration", "1", "error of the focal lengths, standard deviation",
        "the twin's own boards, calibrated (docs/capture.md)",
    )  # fmt: skip
    center: float = assume(
        1.0, "calibration", "px", "error of the principal points, standard deviation"
    )
    turn: float = assume(
        0.02, "calibration", "degrees", "error of how cameras look, standard deviation"
    )
    shift: float = assume(0.2, "calibration", "mm", "error of where they are")
    steady: float = assume(
        3.0, "cameras", "mm and degrees", "how far the hand that holds the device sways", off=3.0
    )

    def __post_init__(self) -> None:
        if self.kind not in CAMERA_KINDS:
            raise CaptureError(
                f"twin: no cameras are called {self.kind}; there are {', '.join(CAMERA_KINDS)}"
            )


#: Always there: what is told of them can be changed, not left out.
_STAY = ("read-out board", "cameras", "hand", "time")


@dataclass(frozen=True)
class TwinTraits:
    """How the device is solved, built and moved, what its cords, its read-out board and the cameras
    do: make of markers what `markers` says, or see them on a `film`."""

    mechanics: MechanicsTraits = field(default_factory=MechanicsTraits)
    building: BuildingTraits = field(default_factory=BuildingTraits)
    rubber: RubberTraits = field(default_factory=RubberTraits)
    board: BoardTraits = field(default_factory=BoardTraits)
    markers: MarkerTraits = field(default_factory=MarkerTraits)
    hand: WalkTraits = field(default_factory=WalkTraits)
    film: FilmTraits | None = None
    age: float = assume(3.0, "time", "days", "of the device at its first session")
    between: float = assume(20.0, "time", "h", "between sessions")

    @classmethod
    def of(cls, device: Device) -> TwinTraits:
        """With the noise and the joints of the device's cord."""
        cord = device.cord
        return cls(rubber=RubberTraits(noise=cord.noise, contact=cord.contact))

    @property
    def _parts(self) -> dict[str, Any]:
        return {
            "mechanics": self.mechanics, "building": self.building, "rubber": self.rubber,
            "board": self.board, "hand": self.hand,
            **({"film": self.film} if self.film is not None else {"markers": self.markers}),
        }  # fmt: skip

    @property
    def told(self) -> list[Assumption]:
        """Every number with its source."""
        parts = [a for part in self._parts.values() for a in list_assumptions(part)]
        return parts + list_assumptions(self)

    @property
    def names(self) -> list[str]:
        """Of traits that can be switched off."""
        return list(dict.fromkeys(a.trait for a in self.told if a.trait not in _STAY))

    def disable_traits(self, off: Sequence[str]) -> TwinTraits:
        """With these switched off. Raises CaptureError for names of none."""
        for name in off:
            if name not in self.names:
                raise CaptureError(
                    f"twin: there is no trait {name!r} to switch off; there are"
                    f" {', '.join(self.names)}"
                )
        return replace(self, **{k: disable_traits(part, off) for k, part in self._parts.items()})
