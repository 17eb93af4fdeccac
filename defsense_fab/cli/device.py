"""Arguments of all commands that work on a device folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ..core.errors import DeviceError
from .completers import complete_device_folders

if TYPE_CHECKING:
    from cyclopts import Token


def device_folder(_: object, tokens: Sequence[Token]) -> Path:
    """Return the folder of a device, given the folder or its device.toml."""
    from ..core.device.device_file import DEVICE

    path = Path(tokens[0].value)
    return path.parent if path.name == DEVICE and path.is_file() else path


def _text(_: object, tokens: Sequence[Token]) -> tuple[str, ...]:
    return tuple(token.value for token in tokens)


#: Folder of a device; the path of its device.toml is accepted too.
DeviceFolder = Annotated[
    Path,
    Parameter(converter=device_folder, completer=complete_device_folders),
]
#: Overrides of parameters of the body's script.
Overrides = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set",
        converter=_text,
        n_tokens=1,
        allow_repeating=True,
        metavar="NAME=VALUE",
        help="Override a parameter of the body's script from device.toml; may be repeated.",
    ),
]


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
