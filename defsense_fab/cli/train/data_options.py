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
    from ...workflow.train.training import UnitErrors

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
            items = value if isinstance(value, tuple) else (value,)
            words.append(f"--{name.replace('_', '-')}")
            words += [f"{item:g}" if isinstance(item, float) else str(item) for item in items]
    return " ".join(map(quote, words))


def describe_errors(errors: UnitErrors) -> str:
    """Return the errors of the targets in one unit as a sentence."""
    unit = errors.unit or "(no unit given)"
    text = f"test: RMSE {errors.rmse:.3g} {unit}"
    if len(errors.by_target) > 1:
        each = ", ".join(f"{name} {rmse:.3g}" for name, rmse in errors.by_target.items())
        text += f" ({each})"
    if errors.coverage is None or errors.level is None or errors.worst_tenth is None:
        return text
    return (
        f"{text}; {errors.level:.0%} intervals contain {errors.coverage:.0%} of the values"
        f" ({errors.worst_tenth:.0%} in the worst tenth of the time)"
    )


_NAMES = (
    "signals",
    "tracks",
    "targets",
    "tracks_unit",
    "signals_stream",
    "tracks_stream",
    "markers",
    "offset",
    "shift",
    "unit",
)
