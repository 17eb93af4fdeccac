"""The command `defsense`: parse the arguments, run the command, print errors."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from inspect import BoundArguments
from pathlib import Path
from types import UnionType
from typing import Union, get_args, get_origin

from cyclopts import App, ArgumentCollection, CycloptsError

from ..core.errors import CapacityError, DefsenseError, DeviceError, StorageError
from ..core.machine.optional_libraries import CORE, optional
from .app import make_app
from .exit_codes import DONE, REFUSED, STOPPED
from .interrupts import handle_interrupts
from .output import OutputOptions, activity
from .usage_errors import usage_error, wrong_count

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
#: State of the files after an interruption, by command.
_INTERRUPTED = {
    "build": "The previous build is unchanged; rerun the command to resume. Completed stages and"
    " solved poses are kept.",
    "capture": "Completed recordings are kept; files that were being written are not.",
    "board": "Rerun the command to start again; a board's boot loader is never overwritten.",
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
    "cache": "Some files were deleted; rerun the command to delete the others.",
    "licences": "Nothing was changed.",
    "list": "Nothing was changed.",
    "open": "Nothing was changed.",
    "completion": "Nothing was changed.",
    "traces": "Nothing was written.",
    "twin": "No incomplete session is kept; solved states are reused by the next run.",
}

#: Options that fix an error of the library when they are added, by the code of the error.
_FIXING_OPTIONS = {
    "unit-doubtful": "--units or --size",
    "out-of-step": "--shift auto",
    "device-missing": "--device",
    "stream-ambiguous": "--signals-stream, --tracks-stream",
    "clock-unknown": "--offset auto",
    "sources-missing": "--signals, --tracks, --device",
    "length-unit-unknown": "--tracks-unit mm",
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
        DefsenseError: The input or the machine does not allow the command. Wrong words are
            converted (DeviceError, see `parse`), and so are errors of the operating system: a lack
            of memory (CapacityError, `memory-insufficient`), a file that cannot be used
            (StorageError, `file-unusable`), a missing library (DeviceError, `library-missing` or
            `library-broken`).
        KeyboardInterrupt: Ctrl-C was pressed, or the process was asked to end (SIGTERM).
    """
    activity.start(words[:1])
    with _record_interrupts() as interrupts:
        try:
            run, bound = parse(words)
            _log_to_standard_error(_is_verbose(bound))
            code = run(*bound.args, **bound.kwargs)
            return code if isinstance(code, int) else DONE
        except DefsenseError as error:
            _add_flags(error)
            raise
        except Exception as error:
            if interrupts:
                raise KeyboardInterrupt from error
            if not isinstance(error, MemoryError | OSError) and _import_failure(error) is None:
                raise
            _log.debug("traceback of the error", exc_info=True)
            raise _convert_system_error(error) from error


def parse(words: Sequence[str]) -> tuple[Callable[..., object], BoundArguments]:
    """Return the function that a command line calls, and its arguments.

    Args:
        words: The command and its arguments. The items of a list may be separated by commas.

    Raises:
        DeviceError: A word is not a known command or option (`unknown-command`, `unknown-option`),
            a value is missing, not valid or repeated (`argument-missing`, `argument-invalid`,
            `argument-repeated`), or there are more arguments than the command accepts
            (`argument-unexpected`).
        DefsenseError: The values of an options record are not valid.
    """
    app = make_app()
    try:
        chain, apps, rest = app.parse_commands(words)
        activity.start(chain)
        if not _is_group(apps[-1]):
            arguments = apps[-1].assemble_argument_collection(parse_docstring=False)
            activity.options = frozenset(name for a in arguments for name in a.names)
            options = _split_lists(arguments, rest, " ".join(("defsense", *chain)))
            words = [*words[: len(words) - len(rest)], *options]
        run, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        raise usage_error(error, words) from None
    return run, bound


def _is_group(app: App) -> bool:
    """Return whether a command only has further commands, or prints help or the version."""
    run = app.default_command
    return run is None or run.__name__ in ("help_print", "version_print")


def _split_lists(arguments: ArgumentCollection, words: Sequence[str], command: str) -> list[str]:
    """Separate the items of lists that are written with commas.

    `--bed 220,220,250` becomes `--bed 220 220 250`, and `--radii 75,100`, with any number of items,
    `--radii 75 --radii 100`. Files may also be separated by spaces: `--signals a.csv b.csv` becomes
    `--signals a.csv --signals b.csv`. Options that may be repeated with any text, such as `--set`,
    are declared with a converter of their own and not separated.

    Args:
        arguments: Arguments of the command.
        words: Words after the command.
        command: The command, such as `defsense build`, for errors.

    Raises:
        DeviceError: A list has too few or too many items (`argument-invalid`).
    """
    kinds = {
        name: get_args(kind)
        for argument in arguments
        if argument.parameter.converter is None and (kind := _tuple_type(argument.hint))
        for name in argument.names
    }
    separated: list[str] = []
    waiting = deque(words)
    while waiting:
        word = waiting.popleft()
        name, equals, value = word.partition("=")
        kind = kinds.get(name)
        if kind is None:
            separated.append(word)
            continue
        if not equals:
            value = waiting.popleft() if waiting else ""
        items = _split_list(value, kind[0])
        while kind[0] is Path and waiting and not waiting[0].startswith("-"):
            items += _split_list(waiting.popleft(), Path)
        if ... in kind:
            separated += [part for item in items for part in (name, item)] or [name]
        elif len(items) > 1 and len(items) != len(kind):
            raise wrong_count(name, len(kind), len(items), command)
        else:
            separated += [name, *items]
    return separated


def _split_list(text: str, kind: object) -> list[str]:
    """Return the items of a list; the name of an existing file may have commas."""
    if kind is Path and Path(text).exists():
        return [text]
    return [item for item in map(str.strip, text.split(",")) if item]


def _tuple_type(hint: object) -> object | None:
    """Return the type if it is a tuple, or the tuple of an optional one; otherwise None."""
    options = (hint, *get_args(hint)) if get_origin(hint) in (Union, UnionType) else (hint,)
    return next((option for option in options if get_origin(option) is tuple), None)


def _is_verbose(bound: BoundArguments) -> bool:
    return any(
        isinstance(value, OutputOptions) and value.verbose for value in bound.arguments.values()
    )


def _add_flags(error: DefsenseError) -> None:
    """Replace the argument that an error of the library names by its flag, and add the remedy."""
    flag = f"--{error.where.replace('_', '-').replace(' ', '-')}"
    if error.where and flag in activity.options:
        error.where = flag
    option = _FIXING_OPTIONS.get(error.code)
    if error.code == "length-unit-unknown" and "--tracks-unit" not in activity.options:
        option = "--unit mm"  # of capture convert
    if option and error.action and option not in error.action:
        error.action = f"{error.action.rstrip('.')} ({option})"


def _log_to_standard_error(verbose: bool) -> None:
    level = logging.DEBUG if verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    for library in ("matplotlib", "numba", "trimesh", "build123d", "PIL"):
        logging.getLogger(library).setLevel(logging.WARNING)


def _import_failure(error: BaseException | None) -> ImportError | None:
    """Return the failed import of another package; in our own it is a programming error."""
    if isinstance(error, ImportError) and isinstance(error.__cause__, ImportError):
        error = error.__cause__  # cyclopts replaces errors of a command's module
    if not isinstance(error, ImportError) or "relative import" in str(error):
        return None
    is_own = (error.name or "").partition(".")[0] == __name__.partition(".")[0]
    return None if is_own else error


def _convert_system_error(error: Exception) -> DefsenseError:
    """Return an error that names the file, or else the command and its current step."""
    doing, command = str(activity), activity.command
    failure = _import_failure(error)
    if failure is not None:
        try:
            with optional(DeviceError, doing, CORE):
                raise failure
        except DeviceError as converted:
            return converted
    if isinstance(error, MemoryError):
        return CapacityError(
            "not enough memory",
            code="memory-insufficient",
            where=doing,
            action=_MEMORY_ACTIONS.get(command, _MEMORY_ACTIONS["build"]),
            command=command,
        )
    assert isinstance(error, OSError)
    path = None if error.filename is None else os.fsdecode(error.filename)
    return StorageError(
        str(error.strerror or error),
        code="file-unusable",
        where=doing if path is None else path,
        action="Check the path, its permissions and the disk",
        path=path,
        command=command,
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
    """Raise KeyboardInterrupt on Ctrl-C and SIGTERM.

    They are recorded, because native modules convert the exception.
    """
    interrupts: list[int] = []

    def interrupt(number: int, _: object) -> None:
        interrupts.append(number)
        raise KeyboardInterrupt

    with handle_interrupts(interrupt):
        yield interrupts


def _print_error_line(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write(f"{line}\n")


if __name__ == "__main__":
    sys.exit(main())
