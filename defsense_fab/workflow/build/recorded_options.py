"""The options that a build was made with, as `state.json` records them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...core.device.device import Device, FabricationSpec
from .options import OVERRIDES, BuildOptions
from .stage_files import load_state
from .stages import PLATES


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
    overrides: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v for k, v in valid.items()
    }
    return BuildOptions(**overrides)


def changed_options(device: Device, folder: Path) -> dict[str, tuple[Any, Any]]:
    """Return the values of `[fabrication]` that changed since the build: (old, new) by key."""
    used = _recorded(folder)[1]
    now = _plates(recorded_options(device, folder).apply(device).fabrication)
    return {k: (used[k], now[k]) for k in now if k in used and used[k] != now[k]}


def _plates(f: FabricationSpec) -> dict[str, Any]:
    """Return the values that options can override, as JSON holds them."""
    values = {name: getattr(f, name) for name in OVERRIDES}
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def _recorded(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what device.toml had and what the build used, as recorded."""
    record = load_state(folder).get(PLATES, {})
    return record.get("had", {}), record.get("for", {})
