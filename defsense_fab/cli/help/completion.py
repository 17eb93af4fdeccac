"""The command `defsense completion`."""

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
    """`completion`."""
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
    """Answer the shell that asks what could come next, and end; return where argcomplete is not
    installed."""
    try:
        import argcomplete
    except ImportError:
        return
    _set_completers(parser)
    argcomplete.autocomplete(parser)


def _set_completers(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _set_completers(below)
        elif action.type is device_folder:
            action.completer = device_folders  # type: ignore[attr-defined]
        elif action.type is None and (words := _WORDS.get("".join(action.option_strings[-1:]))):
            action.completer = words  # type: ignore[attr-defined]


def _rows(table: str) -> Callable[..., list[str]]:
    def names(**_: object) -> list[str]:
        from ...core.storage.package_data import read_rows

        return list(read_rows(table))

    return names


def _units(**_: object) -> list[str]:
    from ...workflow.starts.units import UNITS

    return list(UNITS)


def _poses(prefix: str, **_: object) -> list[str]:
    """What may follow the last comma."""
    from ...workflow.starts.body_ends import END_POSES

    before = prefix.rpartition(",")[0].split(",")
    lead = f"{','.join(before)}," if before[0] else ""
    return [f"{lead}{p}" for p in (*END_POSES, *([] if lead else ["modes"])) if p not in before]


def _bodies(prefix: str, **_: object) -> list[str]:
    """The package's devices, and files."""
    from argcomplete.completers import FilesCompleter

    from ...workflow.starts.starting_devices import STARTING_DEVICES

    return [*(s.name for s in STARTING_DEVICES), *FilesCompleter()(prefix)]


#: What may follow an option that takes any text.
_WORDS = {
    "--cord": _rows("cords.csv"), "--process": _rows("printers.csv"),
    "--material": _rows("materials.csv"), "--units": _units, "--poses": _poses, "--body": _bodies,
}  # fmt: skip


def device_folders(prefix: str, **_: object) -> list[str]:
    """Folders that begin so: those of devices, or all where there is none, to go on from."""
    above, _slash, begun = prefix.rpartition("/")
    top = Path(f"{above}/") if above or prefix.startswith("/") else Path()
    names = sorted(p for p in top.glob("*/") if p.name.startswith(begun)) if top.is_dir() else []
    below = [p for p in names if (p / "device.toml").is_file()] or names
    lead = prefix[: len(prefix) - len(begun)]
    return [f"{lead}{p.name}/" for p in below if begun.startswith(".") or p.name[0] != "."]
