"""The command `defsense`: reads arguments, calls the pipeline, shows progress and results."""

from __future__ import annotations

import argparse
import contextlib
import logging
import signal
import sys
import threading
from collections.abc import Iterator, Sequence

from .. import __version__
from ..core.errors import DefsenseError
from . import build, calibrate, capture, modes, study
from .output import progress_bars

_OUT_OF_MEMORY = {
    "build": "the memory is full; use a larger [mesh] edge_length in device.toml, or close other"
    " programs",
    "study": "the memory is full; give fewer cords with --sensors, or use a larger [mesh]"
    " edge_length in device.toml",
    "capture": "the memory is full; process shorter recordings or fewer cameras at once, or close"
    " other programs",
    "calibrate": "the memory is full; fit fewer sessions at once, or close other programs",
}
_INTERRUPTED = {
    "build": "interrupted; the last build is untouched, and the same command goes on from the last"
    " finished stage",
    "capture": "interrupted; what was recorded is there, and files that were being written are not",
    "calibrate": "interrupted; what was recorded is there, and the same command goes on",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0, or 2 for an error the user can mend."""
    options = _parser().parse_args(arguments)
    level = logging.DEBUG if options.verbose else logging.WARNING
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    for noisy in ("matplotlib", "numba", "trimesh", "build123d", "PIL"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    with _interrupts() as interrupted:
        try:
            return int(options.run(options))
        except DefsenseError as error:
            return _refuse(str(error))
        except MemoryError:
            return _refuse(_OUT_OF_MEMORY.get(options.command, _OUT_OF_MEMORY["build"]))
        except OSError as error:
            if interrupted:
                return _refuse(_INTERRUPTED.get(options.command, _INTERRUPTED["build"]))
            where = f"{error.filename}: " if error.filename else ""
            return _refuse(f"{where}{error.strerror or error}; check the path and permissions")
        except KeyboardInterrupt:
            return _refuse(_INTERRUPTED.get(options.command, _INTERRUPTED["build"]))
        except Exception:
            if not interrupted:
                raise
            return _refuse(_INTERRUPTED.get(options.command, _INTERRUPTED["build"]))


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


def _refuse(message: str) -> int:
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write("error: " + " ".join(message.split()) + "\n")
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="defsense",
        description="Soft objects that sense their own deformation: from a device folder to"
        " printable parts with a predicted accuracy.",
        epilog="example:  defsense build fixtures/devices/bar",
    )
    parser.add_argument("--version", action="version", version=f"defsense-fab {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    build.add(commands)
    modes.add(commands)
    study.add(commands)
    calibrate.add(commands, progress_bars)
    capture.add(commands, progress_bars)
    return parser


if __name__ == "__main__":
    sys.exit(main())
