"""What commands print: progress on standard error, results on standard output."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Self

from ..core.errors import StorageError
from ..core.progress import Progress, silent

if TYPE_CHECKING:
    from rich.console import Console


def console() -> Console:
    """For tables, whose reader may go (`| head`): that is told as BrokenPipeError."""
    from rich.console import Console

    out = Console()
    out.on_broken_pipe = _leave  # type: ignore[method-assign]
    return out


def _leave() -> None:
    """In place of rich's own exit with code 1."""
    raise BrokenPipeError


def say(lines: Iterable[str]) -> None:
    """Print lines as they are, for terminals of any width: brackets are no colours."""
    out = console()
    for line in lines:
        out.print(line, highlight=False, markup=False, soft_wrap=True)


@contextlib.contextmanager
def results() -> Iterator[None]:
    """Results go to standard output: a reader that left is no error, a full disk is one."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise StorageError(
            f"standard output: {error.strerror}; what was asked for is done, and could not be"
            " printed"
        ) from None


@contextlib.contextmanager
def silent_stdout() -> Iterator[None]:
    """Native libraries print to descriptor 1: send that to standard error meanwhile."""
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
def progress_bars(options: argparse.Namespace) -> Iterator[Progress]:
    """Shows progress; `options.doing` keeps what was told last, for errors."""
    with _shown(options) as show:

        def tell(stage: str, fraction: float, message: str) -> None:
            options.doing = f"{stage}: {message}"
            show(stage, fraction, message)

        yield tell


@contextlib.contextmanager
def _shown(options: argparse.Namespace) -> Iterator[Progress]:
    """A bar for each stage on standard error; plain lines where that is no terminal."""
    if options.json and not options.verbose:
        yield silent
        return
    if not sys.stderr.isatty():
        with ProgressLines(options.verbose) as lines:
            yield lines
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    with Bars(
        TextColumn("{task.fields[stage]:<10}"),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
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
    """Progress as lines, inside of `with`: the beginning and end of each stage, or everything with
    -v; and what is being done whenever nothing was told for `every` s, so that the reader of a log
    sees that it goes on."""

    def __init__(self, everything: bool, every: float = 10.0) -> None:
        self._everything, self._every, self._stage = everything, every, ""
        self._last = "", 0.0, "done"
        self._since = self._told = time.monotonic()
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join()

    def __call__(self, stage: str, fraction: float, message: str) -> None:
        with self._lock:
            if (stage, message) != (self._last[0], self._last[2]):
                self._since = time.monotonic()
            self._last = stage, fraction, message
            if self._everything or stage != self._stage or message == "done":
                self._stage = stage
                self._write("")

    def _write(self, more: str) -> None:
        stage, fraction, message = self._last
        sys.stderr.write(f"{stage:<10} {100 * fraction:3.0f} %  {message}{more}\n")
        sys.stderr.flush()
        self._told = time.monotonic()

    def _go_on(self) -> None:
        while not self._over.wait(self._every / 10):
            with self._lock:
                now = time.monotonic()
                if self._last[2] != "done" and now - self._told >= self._every:
                    passed = now - self._since
                    self._write(f" ({passed:.0f} s)" if passed >= self._every else "")
