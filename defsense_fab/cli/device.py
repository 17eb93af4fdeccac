"""The arguments of all commands that work on a device's folder."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core.errors import DeviceError


def device_arguments(sub: argparse.ArgumentParser) -> None:
    """The folder, `--set`, `--json` and `--verbose`."""
    sub.add_argument("folder", type=device_folder, metavar="DIR", help="the folder of device.toml")
    sub.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of the body's script, in place of device.toml's; may be repeated",
    )
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")


def device_folder(text: str) -> Path:
    """The folder of a device, or that of its device.toml where this is given."""
    from ..core.device.device_file import DEVICE

    path = Path(text)
    return path.parent if path.name == DEVICE and path.is_file() else path


def overrides(pairs: Sequence[str]) -> dict[str, Any]:
    """Parameters of the script by name. Raises DeviceError for what is no NAME=VALUE."""
    out: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name.isidentifier():
            raise DeviceError(f"--set {pair}: write it as NAME=VALUE, for example length=180")
        try:
            out[name] = json.loads(text)
        except ValueError:
            out[name] = text
    return out
