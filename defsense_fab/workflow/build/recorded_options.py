"""The options that a build was made with, as `state.json` records them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...core.device.device import Device
from .options import BuildOptions
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
    values = BuildOptions.values_of
    return {"had": values(device), "for": values(options.apply(device))}


def recorded_options(device: Device, folder: Path) -> BuildOptions:
    """Return the options of the build in a folder.

    A value that was changed in `device.toml` since that build takes precedence over its option.
    """
    had, used = _recorded(folder)
    now = BuildOptions.values_of(device)
    valid = {k: v for k, v in used.items() if had.get(k) == now.get(k) != v}
    overrides: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v for k, v in valid.items()
    }
    return BuildOptions(**overrides)


def changed_options(device: Device, folder: Path) -> dict[str, tuple[Any, Any]]:
    """Return the values of options that changed since the build: (old, new) by key."""
    used = _recorded(folder)[1]
    now = BuildOptions.values_of(recorded_options(device, folder).apply(device))
    return {k: (used[k], now[k]) for k in now if k in used and used[k] != now[k]}


def _recorded(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what device.toml had and what the build used, as recorded."""
    record = load_state(folder).get(PLATES, {})
    return record.get("had", {}), record.get("for", {})
