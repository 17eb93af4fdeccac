"""What commands print: progress on standard error, results on standard output."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

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
            f"standard output: {error.strerror}; the build is finished, its results are in its"
            " folder"
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
        yield _Lines(options.verbose)
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


class _Lines:
    """Progress as lines: the beginning and end of each stage, or everything with -v."""

    def __init__(self, everything: bool) -> None:
        self._everything, self._stage = everything, ""

    def __call__(self, stage: str, fraction: float, message: str) -> None:
        if self._everything or stage != self._stage or message == "done":
            self._stage = stage
            sys.stderr.write(f"{stage:<10} {100 * fraction:3.0f} %  {message}\n")
