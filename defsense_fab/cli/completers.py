"""Values that a shell proposes for options that accept any text."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from cyclopts import Argument
    from cyclopts.completion import CompletionContext

Completer = Callable[["CompletionContext"], list[str]]


def add_completer(argument: Argument) -> None:
    """Add the completer for the name of an option, if the option accepts text and has none.

    The options of records are declared without one, since `workflow` does not depend on the
    command line.
    """
    from cyclopts import Parameter

    completer = _COMPLETERS.get(argument.name)
    if completer and argument.parameter.completer is None and _accepts_text(argument.hint):
        argument.parameter = Parameter.combine(argument.parameter, Parameter(completer=completer))


def _accepts_text(hint: Any) -> bool:
    return hint is str or any(_accepts_text(part) for part in get_args(hint))


def complete_device_folders(context: CompletionContext) -> list[str]:
    """Return folders: those of devices, or else all, to continue from."""
    folders = [p for p in _paths(context.incomplete) if p.endswith("/")]
    return [p for p in folders if (Path(p) / "device.toml").is_file()] or folders


def complete_files(context: CompletionContext) -> list[str]:
    """Return files and folders; the names of folders end with a slash."""
    return _paths(context.incomplete)


def _paths(start: str) -> list[str]:
    """Return the paths that start with a text; those of hidden files only if it has their dot."""
    parent, slash, name = start.rpartition("/")
    lead = parent + slash
    paths = sorted(Path(lead).glob(f"{escape(name)}*"))
    return [f"{lead}{p.name}{'/' if p.is_dir() else ''}" for p in paths if name or p.name[0] != "."]


def _rows(table: str, _: CompletionContext) -> list[str]:
    from ..core.storage.package_data import read_rows

    return list(read_rows(table))


def _units(_: CompletionContext) -> list[str]:
    from ..workflow.starts.options import UNITS

    return list(UNITS)


def _poses(context: CompletionContext) -> list[str]:
    """Return the poses that can follow the last comma."""
    from ..workflow.starts.options import END_POSES, MODES

    lead, comma, _ = context.incomplete.rpartition(",")
    present = lead.split(",")
    poses = [f"{lead}{comma}{pose}" for pose in END_POSES if pose not in present]
    return poses if comma else [*poses, MODES]


def _bodies(context: CompletionContext) -> list[str]:
    """Return the examples of the package, and files."""
    from ..workflow.starts.options import EXAMPLES

    return [*EXAMPLES, *complete_files(context)]


#: Completers by the name of the option.
_COMPLETERS: dict[str, Completer] = {
    "--cord": partial(_rows, "cords.csv"),
    "--process": partial(_rows, "printers.csv"),
    "--material": partial(_rows, "materials.csv"),
    "--units": _units,
    "--poses": _poses,
    "--body": _bodies,
}
