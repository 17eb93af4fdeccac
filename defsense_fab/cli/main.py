"""The command `defsense`: reads arguments, calls the pipeline, shows progress and results."""

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

from ..core.errors import DefsenseError
from ..core.machine.optional_libraries import CORE, missing
from ..core.version import __version__
from .command_parser import CommandParser
from .commands import TASKS, module_of
from .exit_codes import REFUSED, STOPPED

#: What to do where the memory does not suffice.
_LIGHTER = {
    "build": "use a larger [mesh] edge_length in device.toml",
    "study": "use fewer --workers, fewer cords, or a larger [mesh] edge_length in device.toml",
    "capture": "close other programs, or take fewer, smaller or shorter pictures and videos",
    "calibrate": "close other programs, or give fewer sessions at a time",
    "train": "close other programs, or give fewer or shorter sessions",
    "dataset": "close other programs, or give fewer or shorter sessions",
    "evaluate": "close other programs, or give fewer or shorter sessions",
    "reproduce": "give fewer NAMEs at a time, or --quick",
    "twin": "give fewer --minutes or --sessions, or fewer [outputs] markers",
}
#: What is kept where a command is stopped by Ctrl-C.
_KEPT = {
    "build": "the last build is untouched, and the same command goes on from the last finished"
    " stage",
    "capture": "what was recorded is kept, and files that were being written are not",
    "calibrate": "what was recorded is kept, and the same command goes on",
    "dataset": "nothing was written, and a dataset before is untouched",
    "evaluate": "nothing was written, and an evaluation before is untouched",
    "modes": "nothing was written",
    "new": "nothing was written",
    "study": "what was done is kept, and the same command goes on",
    "train": "no model was written, and the one before is untouched",
    "recalibrate": "no model was written, and the one before is untouched",
    "reproduce": "what was made is kept, and the same command goes on from there",
    "run": "what was read is kept",
    "studio": "every change is kept",
    "doctor": "nothing was changed",
    "licences": "nothing was changed",
    "completion": "nothing was changed",
    "twin": "no session is left half-written, and shapes that were solved are kept",
}


_log = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns one of `exit_codes`."""
    _mend_streams()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what could come next
        from .help.completion import complete

        complete(make_parser())
    words = sys.argv[1:] if arguments is None else arguments
    options = argparse.Namespace(command=words[0] if words else "")
    with _interrupts() as interrupted:
        try:
            make_parser(options.command or None).parse_args(words, options)
            _log_to_standard_error(options.verbose)
            return int(options.run(options))
        except DefsenseError as error:
            errors = error.data.get("errors")  # of a file with several problems
            return _refuse(*map(str, errors if isinstance(errors, tuple) else (error,)))
        except KeyboardInterrupt:
            return _stopped(options.command)
        except Exception as error:
            if interrupted:
                return _stopped(options.command)
            if not isinstance(error, MemoryError | OSError) and not _foreign_import(error):
                raise
            _log.debug("where it happened", exc_info=True)
            return _refuse(_refused_by_the_system(error, options))


def _log_to_standard_error(verbose: bool) -> None:
    level = logging.DEBUG if verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    for noisy in ("matplotlib", "numba", "trimesh", "build123d", "PIL"):
        logging.getLogger(noisy).setLevel(logging.WARNING)


def _foreign_import(error: Exception) -> bool:
    """Whether a library is missing or does not load; an import of our own is our mistake."""
    own = __name__.partition(".")[0]
    return isinstance(error, ImportError) and (error.name or "").partition(".")[0] != own


def _refused_by_the_system(error: Exception, options: argparse.Namespace) -> str:
    """What was being done, or which file it was about."""
    doing = " ".join(["defsense", options.command, *filter(None, [getattr(options, "step", "")])])
    if "doing" in options:
        doing += f", {options.doing}"
    if isinstance(error, ImportError):
        return missing(doing, error, CORE)
    if isinstance(error, MemoryError):
        hint = _LIGHTER.get(options.command, _LIGHTER["build"])
        return f"{doing}: the memory does not suffice; {hint}"
    assert isinstance(error, OSError)
    where = doing if error.filename is None else os.fsdecode(error.filename)
    return f"{where}: {error.strerror or error}; check the path, its permissions and the disk"


def _mend_streams() -> None:
    """Streams that were closed are as if empty; letters that the terminal lacks become `?`."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            empty = Path(os.devnull).open(mode, encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, empty)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")


@contextlib.contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Ctrl-C as KeyboardInterrupt, remembered: native modules turn it into other errors."""
    seen: list[int] = []

    def interrupt(number: int, _: object) -> None:
        seen.append(number)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield seen
        return
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield seen
    finally:
        signal.signal(signal.SIGINT, before)


def _refuse(*messages: str) -> int:
    for message in messages:
        _tell("error: " + " ".join(message.split()))
    return REFUSED


def _stopped(command: str) -> int:
    _tell(f"stopped; {_KEPT.get(command, _KEPT['build'])}")
    return STOPPED


def _tell(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write(f"{line}\n")


def make_parser(command: str | None = None) -> CommandParser:
    """Of all commands; of one alone where its name is given, which starts sooner."""
    parser = CommandParser(
        prog="defsense",
        description="Soft objects that sense their own deformation: from a device folder to"
        " printable parts with a predicted accuracy.",
        epilog="exit codes: 0 done; 2 refused, with one line that says what to do; 130 stopped by"
        " Ctrl-C, with one line that says what is kept (docs/commands.md).",
        examples=["defsense build fixtures/devices/bar"],
        tasks={task: [c for m in modules for c in m.commands] for task, modules in TASKS.items()},
    )
    parser.add_argument("--version", action="version", version=f"defsense-fab {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    only = module_of(command) if command else None
    names = [only] if only else [m.name for modules in TASKS.values() for m in modules]
    for name in names:
        importlib.import_module(f"{__package__}.{name}").add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
