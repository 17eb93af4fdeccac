"""The folder of a finished build, for those who use what it holds."""

from __future__ import annotations

from pathlib import Path

from ..device.device import Device
from ..errors import CaptureError

BUILD_AGAIN = "build the device again"


def build_folder(device: Device) -> Path:
    """Where the device's build is, whether it is there or not."""
    return device.source / "build"


def finished_build(device: Device, *needed: str) -> Path:
    """The folder of a build that has the files `needed`. Raises CaptureError where it has not."""
    folder = build_folder(device)
    if not all((folder / name).exists() for name in needed):
        raise CaptureError(f"{folder}: is not built; run 'defsense build {device.source}' first")
    return folder
