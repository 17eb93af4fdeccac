"""Everything that a device's twin takes for granted, by traits that can be switched off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ....core.device.device import Device
from ....core.errors import CaptureError
from ....twin.electronics.rubber_cords import RubberTraits
from ....twin.electronics.sampled_board import BoardTraits
from ....twin.scenes.assumption import Assumption, assumed, assumptions, without
from ....twin.scenes.hand_walk import WalkTraits
from ....twin.scenes.marker_measurement import MarkerTraits
from .built_unit import BuildingTraits
from .device_fields import MechanicsTraits
from .film_traits import FilmTraits

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
    age: float = assumed(3.0, "time", "days", "of the device at its first session")
    between: float = assumed(20.0, "time", "h", "between sessions")

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
        parts = [a for part in self._parts.values() for a in assumptions(part)]
        return parts + assumptions(self)

    @property
    def names(self) -> list[str]:
        """Of traits that can be switched off."""
        return list(dict.fromkeys(a.trait for a in self.told if a.trait not in _STAY))

    def without(self, off: Sequence[str]) -> TwinTraits:
        """With these switched off. Raises CaptureError for names of none."""
        for name in off:
            if name not in self.names:
                raise CaptureError(
                    f"twin: there is no trait {name!r} to switch off; there are"
                    f" {', '.join(self.names)}"
                )
        return replace(self, **{k: without(part, off) for k, part in self._parts.items()})
