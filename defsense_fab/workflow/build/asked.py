"""Copies and bed that a build was asked for in place of those in `device.toml`: kept with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...core.device.device import Device, FabricationSpec
from .state import load_state

#: The stage that lays copies on plates.
PLATES = "fabricate"


@dataclass(frozen=True)
class Asked:
    """How many `copies`, and the `bed` (x, y, z, mm) that they lie on; None: as device.toml has
    it."""

    copies: int | None = None
    bed: tuple[float, float, float] | None = None

    def of(self, device: Device) -> Device:
        """The device as it is built."""
        f = device.fabrication
        copies = f.copies if self.copies is None else self.copies
        return replace(device, fabrication=replace(f, copies=copies, bed=self.bed or f.bed))

    @property
    def options(self) -> str:
        """As they are given to a command, or nothing."""
        copies = [] if self.copies is None else [f"--copies {self.copies}"]
        bed = [] if self.bed is None else [f"--bed {','.join(f'{n:g}' for n in self.bed)}"]
        return " ".join([*copies, *bed])


def record(stage: str, device: Device, asked: Asked) -> dict[str, Any]:
    """What a finished stage keeps of them: what device.toml had, and what it was made for."""
    if stage != PLATES:
        return {}
    return {"had": _plates(device.fabrication), "for": _plates(asked.of(device).fabrication)}


def recorded(device: Device, folder: Path) -> Asked:
    """What the build in a folder was asked for, as far as device.toml still has what it had then:
    what was changed there since then counts."""
    had, made = _kept(folder)
    now = _plates(device.fabrication)
    still = {k: v for k, v in made.items() if had.get(k) == now.get(k) != v}
    bed = still.get("bed")
    return Asked(still.get("copies"), None if bed is None else (bed[0], bed[1], bed[2]))


def changes(device: Device, folder: Path) -> str:
    """Which of the two device.toml has otherwise than the build in a folder; nothing where none
    is."""
    made = _kept(folder)[1]
    now = _plates(recorded(device, folder).of(device).fabrication)
    told = {k: (_told(made[k]), _told(now[k])) for k in now if k in made and made[k] != now[k]}
    return ", ".join(
        f"[fabrication] {k} is {new} and was {old} as it was built"
        for k, (old, new) in told.items()
    )


def _plates(f: FabricationSpec) -> dict[str, Any]:
    return {"copies": f.copies, "bed": [float(n) for n in f.bed]}


def _kept(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """What device.toml had and what was made, as recorded; empty in builds of before."""
    stage = load_state(folder).get(PLATES, {})
    return stage.get("had", {}), stage.get("for", {})


def _told(value: Any) -> str:
    return " x ".join(f"{n:g}" for n in value) if isinstance(value, list) else str(value)
