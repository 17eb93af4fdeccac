"""Options of a build, which override `device.toml`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...core.device.fabrication_limits import BedSize, Copies
from ...core.schema.declare import Count
from ...core.schema.options import check_options

if TYPE_CHECKING:
    from ...core.device.device import Device

#: Options that override the key of `[fabrication]` of the same name.
_OF_FABRICATION = ("copies", "bed")


@dataclass(frozen=True)
class BuildOptions:
    """What a build uses instead of the values in `device.toml`.

    Attributes:
        copies: Set the number of devices on the plates (default: [fabrication] copies).
        bed: Set the width, depth and height of the printer's bed in mm, such as 220,220,250
            (default: [fabrication] bed).
        parts: Set the number of parts of the layout to build, of those that the report offers,
            without searching again (default: [design] parts).
        scheduler: Solve the poses and search for cords on a Dask cluster with this scheduler
            address, such as tcp://HOST:8786 (default: on this machine).
        search: Search for the cords again where an earlier layout was kept or improved after an
            edit (default: continue from it).
    """

    copies: Copies | None = None
    bed: tuple[BedSize, BedSize, BedSize] | None = None
    parts: Count | None = None
    scheduler: str | None = None
    search: bool = False

    def __post_init__(self) -> None:
        check_options(self)

    @property
    def overrides(self) -> dict[str, Any]:
        """Values that replace those of the same key in `device.toml`."""
        values = {name: getattr(self, name) for name in (*_OF_FABRICATION, "parts")}
        return {name: value for name, value in values.items() if value is not None}

    def apply(self, device: Device) -> Device:
        """Return the device with these options."""
        values = self.overrides
        parts = values.pop("parts", device.parts)
        return replace(device, fabrication=replace(device.fabrication, **values), parts=parts)

    @staticmethod
    def values_of(device: Device) -> dict[str, Any]:
        """Return the values of a device that options can override, as JSON holds them."""
        values = {name: getattr(device.fabrication, name) for name in _OF_FABRICATION}
        values["parts"] = device.parts
        return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}

    def __str__(self) -> str:
        """Return the overrides as arguments of the command `defsense build`; empty without any."""
        words = []
        for name, value in self.overrides.items():
            items = value if isinstance(value, tuple) else (value,)
            words.append(f"--{name} {','.join(f'{item:g}' for item in items)}")
        return " ".join(words)
