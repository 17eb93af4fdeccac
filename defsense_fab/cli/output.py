"""Output of all commands: progress on standard error, results on standard output."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self

from cyclopts import Parameter

from ..core.errors import StorageError
from ..core.progress import Progress, silent

if TYPE_CHECKING:
    from rich.console import Console


@Parameter(name="*")
@dataclass(frozen=True)
class OutputOptions:
    """How a command shows its result.

    Attributes:
        json: Print the result as JSON.
        verbose: Show more detail while working.
    """

    json: bool = False
    verbose: Annotated[bool, Parameter(alias="-v")] = False


class Activity:
    """What the command does now, for errors that do not name a file.

    Attributes:
        command: Name of the command.
        options: Options that the command has, such as `--rate`.
    """

    def __init__(self) -> None:
        self.start(())

    def start(self, words: Sequence[str]) -> None:
        """Start a command, given by its words, such as `capture record`."""
        self._words = tuple(words)
        self.command = words[0] if words else ""
        self.options: frozenset[str] = frozenset()
        self.step = ""

    def __str__(self) -> str:
        text = " ".join(["defsense", *self._words])
        return f"{text}, {self.step}" if self.step else text


#: The activity of the running command.
activity = Activity()


def console() -> Console:
    """Return a console for tables, which raises BrokenPipeError when the reader has closed."""
    from rich.console import Console

    out = Console()
    out.on_broken_pipe = _raise_broken_pipe  # type: ignore[method-assign]
    return out


def _raise_broken_pipe() -> None:
    """Replace rich's own handler, which exits with code 1."""
    raise BrokenPipeError


def print_lines(lines: Iterable[str]) -> None:
    """Print lines unwrapped and without markup: brackets are not read as colors."""
    out = console()
    for line in lines:
        out.print(line, highlight=False, markup=False, soft_wrap=True)


def print_error_line(line: str) -> None:
    """Print a line on standard error, unless it is closed."""
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def print_json(data: object, *, allow_nan: bool = True) -> None:
    """Print data as indented JSON on standard output."""
    sys.stdout.write(json.dumps(data, indent=1, allow_nan=allow_nan) + "\n")


@contextlib.contextmanager
def standard_output() -> Iterator[None]:
    """Handle errors of standard output while results are printed.

    A reader that has closed the pipe (`| head`) is not an error; a full disk is.

    Raises:
        StorageError: Standard output cannot be written (`output-not-writable`).
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        discard_standard_output()
    except OSError as error:
        discard_standard_output()
        raise StorageError(
            f"{error.strerror}. The command has finished, but its result could not be printed",
            code="output-not-writable",
            where="standard output",
        ) from None


def discard_standard_output() -> None:
    """Redirect the rest of standard output to nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def silent_stdout() -> Iterator[None]:
    """Redirect descriptor 1 to standard error, since native libraries print to it."""
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(saved, 1)
        os.close(saved)


@contextlib.contextmanager
def progress_bars(output: OutputOptions, stages: Sequence[str] = ()) -> Iterator[Progress]:
    """Show progress, and keep the last message in `activity` for errors.

    Args:
        output: How the command shows its result.
        stages: Names of all stages in their order, to number them.
    """
    titles = {name: f"[{k}/{len(stages)}] {name}" for k, name in enumerate(stages, 1)}
    with _progress_display(output) as show:

        def report(stage: str, fraction: float, message: str) -> None:
            activity.step = f"{stage}: {message}"
            show(titles.get(stage, stage), fraction, message)

        yield report


@contextlib.contextmanager
def _progress_display(output: OutputOptions) -> Iterator[Progress]:
    """Show one bar per stage on standard error, or plain lines if it is not a terminal."""
    if output.json and not output.verbose:
        yield silent
        return
    if not sys.stderr.isatty():
        with ProgressLines(output.verbose) as lines:
            yield lines
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    with Bars(
        TextColumn("{task.fields[stage]:<15}"),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
        TextColumn("{task.description}"),
        console=Console(stderr=True),
    ) as bars:
        tasks: dict[str, Any] = {}

        def show(stage: str, fraction: float, message: str) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(message, total=1.0, stage=stage)
            bars.update(tasks[stage], completed=fraction, description=message)

        yield show


class ProgressLines:
    """Progress as plain lines on standard error; use it as a context manager.

    Prints the start and the end of each stage. The current step is repeated when nothing was
    printed for a while, so that the reader of a log sees that the command still runs.

    Args:
        everything: Print every message.
        interval: Time without output after which the current step is repeated, in s.
    """

    def __init__(self, everything: bool, interval: float = 10.0) -> None:
        self._everything, self._interval, self._stage = everything, interval, ""
        self._latest = "", 0.0, "done"
        self._step_started = self._last_printed = time.monotonic()
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._repeat, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        self._thread.join()

    def __call__(self, stage: str, fraction: float, message: str) -> None:
        with self._lock:
            if (stage, message) != (self._latest[0], self._latest[2]):
                self._step_started = time.monotonic()
            self._latest = stage, fraction, message
            if self._everything or stage != self._stage or message == "done":
                self._stage = stage
                self._write("")

    def _write(self, suffix: str) -> None:
        stage, fraction, message = self._latest
        sys.stderr.write(f"{stage:<15} {100 * fraction:3.0f} %  {message}{suffix}\n")
        sys.stderr.flush()
        self._last_printed = time.monotonic()

    def _repeat(self) -> None:
        """Repeat the current step whenever nothing was printed for the interval."""
        while not self._stopped.wait(self._interval / 10):
            with self._lock:
                now = time.monotonic()
                is_due = now - self._last_printed >= self._interval
                if self._latest[2] != "done" and is_due:
                    elapsed = now - self._step_started
                    self._write(f" ({elapsed:.0f} s)" if elapsed >= self._interval else "")
