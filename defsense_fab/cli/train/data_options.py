"""Options of all commands that read data: their device, and the data for another command line."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.train.options import DataFiles
from ..completers import complete_device_folders
from ..device import device_folder

if TYPE_CHECKING:
    from ...core.device.device import Device

#: Sessions and files; the sessions are operands.
Files = Annotated[DataFiles, Parameter(name="*")]
#: Folder of the device, or its device.toml.
DeviceOption = Annotated[
    Path | None,
    Parameter(
        name="--device",
        converter=device_folder,
        completer=complete_device_folders,
        metavar="DIR",
        help="Set the device folder, which contains device.toml",
    ),
]


def load_optional_device(folder: Path | None) -> Device | None:
    """Load the device of a folder; None without one."""
    from ...core.device.device_file import load_device

    return None if folder is None else load_device(folder)


def format_data_options(files: DataFiles, device: Path | None) -> str:
    """Return the same data as arguments for another command line."""
    words = [str(source) for source in files.sources]
    named = {"device": device, **{name: getattr(files, name) for name in _NAMES}}
    for name, value in named.items():
        if value != getattr(DataFiles, name, None):
            words += [
                f"--{name.replace('_', '-')}",
                f"{value:g}" if isinstance(value, float) else str(value),
            ]
    return " ".join(map(quote, words))


_NAMES = (
    "signals",
    "tracks",
    "tracks_unit",
    "signals_stream",
    "tracks_stream",
    "markers",
    "offset",
    "shift",
    "unit",
)
