"""Arguments of all commands that work on a device folder."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core.errors import DeviceError
from .options import add_output_options


def add_device_arguments(sub: argparse.ArgumentParser) -> None:
    """Add the device folder, `--set`, `--json` and `--verbose` to a parser."""
    sub.add_argument(
        "folder", type=device_folder, metavar="DIR", help="Folder that contains device.toml"
    )
    sub.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="Override a parameter of the body's script from device.toml; may be repeated",
    )
    add_output_options(sub)


def device_folder(text: str) -> Path:
    """Return the folder of a device, given the folder or its device.toml."""
    from ..core.device.device_file import DEVICE

    path = Path(text)
    return path.parent if path.name == DEVICE and path.is_file() else path


def parse_overrides(pairs: Sequence[str]) -> dict[str, Any]:
    """Parse the values of `--set`.

    Args:
        pairs: `NAME=VALUE` each; a value is read as JSON, or else kept as text.

    Returns:
        Parameters of the body's script by name.

    Raises:
        DeviceError: A value is not a valid NAME=VALUE (`override-invalid`).
    """
    parameters: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name.isidentifier():
            raise DeviceError(
                f"{pair} is not a valid NAME=VALUE",
                code="override-invalid",
                where="--set",
                action="Give a name and a value, such as length=180",
                value=pair,
            )
        try:
            parameters[name] = json.loads(text)
        except ValueError:
            parameters[name] = text
    return parameters
