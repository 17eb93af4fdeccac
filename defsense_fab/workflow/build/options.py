"""Options of a build that override `device.toml`, and what the last build was made with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...core.device.device import Device, FabricationSpec
from .stage_files import load_state
from .stages import PLATES


@dataclass(frozen=True)
class BuildOptions:
    """What a build uses instead of the values in `device.toml`.

    Attributes:
        copies: Number of devices on the plates; None: `[fabrication] copies`.
        bed: Width, depth and height of the printer's bed, mm; None: `[fabrication] bed`.
    """

    copies: int | None = None
    bed: tuple[float, float, float] | None = None

    def apply(self, device: Device) -> Device:
        """Return the device with these options."""
        f = device.fabrication
        copies = f.copies if self.copies is None else self.copies
        return replace(device, fabrication=replace(f, copies=copies, bed=self.bed or f.bed))

    @property
    def is_empty(self) -> bool:
        """Whether nothing is overridden."""
        return self == BuildOptions()


def describe_options(options: BuildOptions) -> str:
    """Return the options as arguments of the command `defsense build`; empty without any."""
    copies = [] if options.copies is None else [f"--copies {options.copies}"]
    bed = [] if options.bed is None else [f"--bed {','.join(f'{n:g}' for n in options.bed)}"]
    return " ".join([*copies, *bed])


def plates_record(stage: str, device: Device, options: BuildOptions) -> dict[str, Any]:
    """Return what `state.json` records of the options for a stage.

    Args:
        stage: Name of the stage; only that of the parts depends on the options.
        device: Device as in `device.toml`.
        options: Options of the build.
    """
    if stage != PLATES:
        return {}
    return {"had": _plates(device.fabrication), "for": _plates(options.apply(device).fabrication)}


def recorded_options(device: Device, folder: Path) -> BuildOptions:
    """Return the options of the build in a folder.

    A value that was changed in `device.toml` since that build takes precedence over its option.
    """
    had, used = _recorded(folder)
    now = _plates(device.fabrication)
    valid = {k: v for k, v in used.items() if had.get(k) == now.get(k) != v}
    bed = valid.get("bed")
    return BuildOptions(valid.get("copies"), None if bed is None else (bed[0], bed[1], bed[2]))


def changed_options(device: Device, folder: Path) -> dict[str, tuple[Any, Any]]:
    """Return the values of `[fabrication]` that changed since the build: (old, new) by key."""
    used = _recorded(folder)[1]
    now = _plates(recorded_options(device, folder).apply(device).fabrication)
    return {k: (used[k], now[k]) for k in now if k in used and used[k] != now[k]}


def _plates(f: FabricationSpec) -> dict[str, Any]:
    return {"copies": f.copies, "bed": [float(n) for n in f.bed]}


def _recorded(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what device.toml had and what the build used, as recorded."""
    record = load_state(folder).get(PLATES, {})
    return record.get("had", {}), record.get("for", {})
