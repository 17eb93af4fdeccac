"""Command `defsense completion`: complete commands in a shell."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import DeviceError
from ...core.machine.optional_libraries import CORE, optional
from ..device import device_folder
from ..options import add_verbose_option
from ..output import standard_output

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `completion`."""
    sub = commands.add_parser(
        "completion",
        help="Print the script that lets a shell complete commands",
        description="Print a script that makes the Tab key complete this program's commands,"
        ' options, choices and files. For bash: eval "$(defsense completion bash)" in ~/.bashrc;'
        " for zsh: the same with zsh in ~/.zshrc, after compinit; for fish: defsense completion"
        " fish > ~/.config/fish/completions/defsense.fish.",
        examples=["defsense completion bash"],
    )
    sub.add_argument("shell", choices=("bash", "zsh", "fish"), help="Shell that reads the script")
    add_verbose_option(sub)
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    with optional(DeviceError, "completion", CORE):
        from argcomplete.shell_integration import shellcode
    with standard_output():
        sys.stdout.write(shellcode(["defsense"], shell=options.shell) + "\n")
    return 0


def complete(parser: argparse.ArgumentParser) -> None:
    """Print completions for the shell and exit; return if argcomplete is not installed."""
    try:
        import argcomplete
    except ImportError:
        return
    _set_completers(parser)
    argcomplete.autocomplete(parser)


def _set_completers(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for subparser in action.choices.values():
                _set_completers(subparser)
        elif action.type is device_folder:
            action.completer = device_folders  # type: ignore[attr-defined]
        elif action.type is None and (
            completer := _COMPLETERS.get("".join(action.option_strings[-1:]))
        ):
            action.completer = completer  # type: ignore[attr-defined]


def _rows(table: str) -> Callable[..., list[str]]:
    def names(**_: object) -> list[str]:
        from ...core.storage.package_data import read_rows

        return list(read_rows(table))

    return names


def _units(**_: object) -> list[str]:
    from ...workflow.starts.units import UNITS

    return list(UNITS)


def _poses(prefix: str, **_: object) -> list[str]:
    """Return the poses that can follow the last comma."""
    from ...workflow.starts.body_ends import END_POSES

    before = prefix.rpartition(",")[0].split(",")
    lead = f"{','.join(before)}," if before[0] else ""
    return [f"{lead}{p}" for p in (*END_POSES, *([] if lead else ["modes"])) if p not in before]


def _bodies(prefix: str, **_: object) -> list[str]:
    """Return the examples of the package, and files."""
    from argcomplete.completers import FilesCompleter

    from ...workflow.starts.starting_devices import STARTING_DEVICES

    return [*(s.name for s in STARTING_DEVICES), *FilesCompleter()(prefix)]


#: Completers of options that accept any text.
_COMPLETERS = {
    "--cord": _rows("cords.csv"), "--process": _rows("printers.csv"),
    "--material": _rows("materials.csv"), "--units": _units, "--poses": _poses, "--body": _bodies,
}  # fmt: skip


def device_folders(prefix: str, **_: object) -> list[str]:
    """Return folders with this prefix: those of devices, or else all, to continue from."""
    parent, _slash, start = prefix.rpartition("/")
    folder = Path(f"{parent}/") if parent or prefix.startswith("/") else Path()
    folders = []
    if folder.is_dir():
        folders = sorted(p for p in folder.glob("*/") if p.name.startswith(start))
    devices = [p for p in folders if (p / "device.toml").is_file()] or folders
    lead = prefix[: len(prefix) - len(start)]
    return [f"{lead}{p.name}/" for p in devices if start.startswith(".") or p.name[0] != "."]
