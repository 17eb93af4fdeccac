"""How `defsense run` ends: everything closed, animations written, what came of it told."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..output import print_lines

if TYPE_CHECKING:
    from ...runtime.live.live_run import LiveRun


@contextlib.contextmanager
def ending(runs: Sequence[LiveRun], options: argparse.Namespace) -> Iterator[None]:
    """Ends all `runs` that are there by then, writes their animations, and tells what was written,
    whatever ended them. A reader of standard output that left is no error. Raises what ended them,
    or else what could not be written."""
    first: BaseException | None = None
    try:
        yield
    except BrokenPipeError:
        _leave()
    except BaseException as error:  # raised again below
        first = error
    with uninterrupted():
        failures = _end(runs, begun=first is None)
        try:
            _say_written(runs, options)
        except BrokenPipeError:
            _leave()
    told, raised = (failures, first) if first is not None else (failures[:-1], failures[-1:])
    for failure in told:
        tell(f"error: {failure}")
    if isinstance(raised, BaseException):
        raise raised
    for failure in raised:
        raise failure


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Without Ctrl-C, which would leave files half-written."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def tell(line: str) -> None:
    """On standard error, if someone reads it."""
    with contextlib.suppress(BrokenPipeError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def _end(runs: Sequence[LiveRun], *, begun: bool) -> list[Exception]:
    """All of them first, so that none goes on while another's animation is written; what went
    wrong. An animation without frames is that only where the runs had `begun`."""
    failures = list[Exception]()
    for run in runs:
        try:
            run.end()
        except Exception as error:  # told by `ending`: the others are ended all the same
            failures.append(error)
    for run in runs:
        animations = run.animations
        if animations is None or animations.recording is None:
            continue
        if animations.is_empty and not begun:
            animations.discard()
            continue
        tell(f"writing {animations.recording}; Ctrl-C does not stop that")
        try:
            animations.finish()
        except Exception as error:  # as above
            failures.append(error)
        finally:
            animations.discard()
    return failures


def _say_written(runs: Sequence[LiveRun], options: argparse.Namespace) -> None:
    written = [each for run in runs if run.animations for each in run.animations.written]
    if not options.json:
        print_lines(f"Wrote:   {each.summary}" for each in written)
        return
    for each in written:
        file = each.file
        about = {"wrote": str(file.path), "frames": file.frames, "seconds": file.seconds,
                 "bytes": file.size, "error": file.error, "instead": each.instead}  # fmt: skip
        sys.stdout.write(json.dumps(about) + "\n")
    sys.stdout.flush()


def _leave() -> None:
    """What is still to be printed goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
