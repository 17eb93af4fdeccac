"""The command `defsense`: parse the arguments, run the command, print errors."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..core.errors import CapacityError, DefsenseError, DeviceError, StorageError
from ..core.machine.optional_libraries import CORE, optional
from ..core.version import __version__
from .command_parser import CommandParser
from .commands import TASKS, module_of
from .exit_codes import REFUSED, STOPPED

#: What to do when the memory is insufficient, by command.
_MEMORY_ACTIONS = {
    "build": "Use a larger [mesh] edge_length in device.toml",
    "study": "Use fewer --workers, fewer cords, or a larger [mesh] edge_length in device.toml",
    "capture": "Close other programs, or use fewer, smaller or shorter pictures and videos",
    "calibrate": "Close other programs, or give fewer sessions at a time",
    "train": "Close other programs, or give fewer or shorter sessions",
    "dataset": "Close other programs, or give fewer or shorter sessions",
    "evaluate": "Close other programs, or give fewer or shorter sessions",
    "reproduce": "Give fewer NAMEs at a time, or --quick",
    "twin": "Give fewer --minutes or --sessions, or fewer [outputs] markers",
}
#: State of the files after Ctrl-C, by command.
_INTERRUPTED = {
    "build": "The previous build is unchanged; rerun the command to resume from the last completed"
    " stage.",
    "capture": "Completed recordings are kept; files that were being written are not.",
    "calibrate": "Recorded data are kept; rerun the command to resume.",
    "dataset": "Nothing was written; an existing dataset is unchanged.",
    "evaluate": "Nothing was written; an existing evaluation is unchanged.",
    "modes": "Nothing was written.",
    "new": "Nothing was written.",
    "study": "Completed runs are kept; rerun the command to resume.",
    "train": "No model was written; an existing model is unchanged.",
    "recalibrate": "No model was written; an existing model is unchanged.",
    "reproduce": "Completed results are kept; rerun the command to resume.",
    "run": "Recorded readings are kept.",
    "studio": "All changes are saved.",
    "doctor": "Nothing was changed.",
    "licences": "Nothing was changed.",
    "completion": "Nothing was changed.",
    "twin": "No incomplete session is kept; solved states are reused by the next run.",
}

#: Options that fix an error of the library when they are added, by the code of the error.
_FIXING_OPTIONS = {
    "unit-doubtful": "--units",
    "out-of-step": "--shift auto",
    "device-missing": "--device",
}

_log = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, and print an error as one line on standard error.

    Args:
        arguments: Words after `defsense`; those of the process if omitted.

    Returns:
        One of the codes of `exit_codes`.
    """
    _prepare_streams()
    if "_ARGCOMPLETE" in os.environ:  # the shell requests completions
        from .help.completion import complete

        complete(make_parser())
    words = sys.argv[1:] if arguments is None else arguments
    try:
        return run_command(words)
    except DefsenseError as error:
        problems = error.data.get("errors")  # of a file with several problems
        for problem in problems if isinstance(problems, tuple) else (error,):
            _print_error_line("error: " + " ".join(str(problem).split()))
        return REFUSED
    except KeyboardInterrupt:
        state = _INTERRUPTED.get(words[0] if words else "", _INTERRUPTED["build"])
        _print_error_line(f"Interrupted. {state}")
        return STOPPED


def run_command(words: Sequence[str]) -> int:
    """Run one command, and leave errors to the caller.

    Args:
        words: The command and its arguments.

    Returns:
        One of the codes of `exit_codes`.

    Raises:
        DefsenseError: The input or the machine does not allow the command. Errors of the operating
            system are converted: a lack of memory (CapacityError, `memory-insufficient`), a file
            that cannot be used (StorageError, `file-unusable`), a missing library (DeviceError,
            `library-missing` or `library-broken`).
        KeyboardInterrupt: Ctrl-C was pressed.
        SystemExit: The arguments do not match the parser, or help was requested.
    """
    options = argparse.Namespace(command=words[0] if words else "")
    with _record_interrupts() as interrupts:
        try:
            make_parser(options.command or None).parse_args(words, options)
            _log_to_standard_error(options.verbose)
            return int(options.run(options))
        except DefsenseError as error:
            _add_flags(error, words)
            raise
        except Exception as error:
            if interrupts:
                raise KeyboardInterrupt from error
            if not isinstance(error, MemoryError | OSError) and not _is_foreign_import(error):
                raise
            _log.debug("traceback of the error", exc_info=True)
            raise _convert_system_error(error, options) from error


def _add_flags(error: DefsenseError, words: Sequence[str]) -> None:
    """Replace the argument that an error of the library names by its flag, and add the remedy."""
    flag = f"--{error.where.replace('_', '-').replace(' ', '-')}"
    if error.where and any(word.partition("=")[0] == flag for word in words):
        error.where = flag
    option = _FIXING_OPTIONS.get(error.code)
    if option and error.action and option not in error.action:
        error.action = f"{error.action.rstrip('.')} ({option})"


def _log_to_standard_error(verbose: bool) -> None:
    level = logging.DEBUG if verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    for library in ("matplotlib", "numba", "trimesh", "build123d", "PIL"):
        logging.getLogger(library).setLevel(logging.WARNING)


def _is_foreign_import(error: Exception) -> bool:
    """Return whether another package failed to import; in our own it is a programming error."""
    package = __name__.partition(".")[0]
    return isinstance(error, ImportError) and (error.name or "").partition(".")[0] != package


def _convert_system_error(error: Exception, options: argparse.Namespace) -> DefsenseError:
    """Return an error that names the file, or else the command and its current step."""
    activity = " ".join(
        ["defsense", options.command, *filter(None, [getattr(options, "step", "")])]
    )
    if "doing" in options:
        activity += f", {options.doing}"
    if isinstance(error, ImportError):
        try:
            with optional(DeviceError, activity, CORE):
                raise error
        except DeviceError as converted:
            return converted
    if isinstance(error, MemoryError):
        return CapacityError(
            "not enough memory",
            code="memory-insufficient",
            where=activity,
            action=_MEMORY_ACTIONS.get(options.command, _MEMORY_ACTIONS["build"]),
            command=options.command,
        )
    assert isinstance(error, OSError)
    path = None if error.filename is None else os.fsdecode(error.filename)
    return StorageError(
        str(error.strerror or error),
        code="file-unusable",
        where=activity if path is None else path,
        action="Check the path, its permissions and the disk",
        path=path,
        command=options.command,
    )


def _prepare_streams() -> None:
    """Replace closed streams by empty ones, and characters that the terminal lacks by `?`."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            empty = Path(os.devnull).open(mode, encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, empty)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")


@contextlib.contextmanager
def _record_interrupts() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt on Ctrl-C and record it: native modules convert the exception."""
    interrupts: list[int] = []

    def interrupt(number: int, _: object) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield interrupts
    finally:
        signal.signal(signal.SIGINT, before)


def _print_error_line(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write(f"{line}\n")


def make_parser(command: str | None = None) -> CommandParser:
    """Return the parser of all commands.

    Args:
        command: Add only the commands of this command's module, which starts faster.
    """
    parser = CommandParser(
        prog="defsense",
        description="Design, build and run soft objects that sense their own deformation: from a"
        " device folder to printable parts with a predicted accuracy.",
        epilog="Exit codes: 0 success; 1 the answer is no; 2 an error, with one line that states"
        " what to do; 130 interrupted by Ctrl-C, with one line that states what is kept"
        " (docs/commands.md).",
        examples=["defsense build fixtures/devices/bar"],
        tasks={task: [c for m in modules for c in m.commands] for task, modules in TASKS.items()},
    )
    parser.add_argument(
        "--version",
        action="version",
        version=f"defsense-fab {__version__}",
        help="Show the version and exit",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    module = module_of(command) if command else None
    names = [module] if module else [m.name for modules in TASKS.values() for m in modules]
    for name in names:
        importlib.import_module(f"{__package__}.{name}").add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
