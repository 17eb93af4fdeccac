"""Stop the devices of `defsense run`: close everything, write animations, report files."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..interrupts import handle_interrupts
from ..output import discard_standard_output, print_error_line, print_lines

if TYPE_CHECKING:
    from ...workflow.run.run import LiveRun


@contextlib.contextmanager
def stop_at_end(runs: Sequence[LiveRun], *, as_json: bool) -> Iterator[None]:
    """Stop all runs when the block ends for whatever reason, and write their animations.

    A reader that has closed standard output is not an error.

    Args:
        runs: The runs; the block may add to them.
        as_json: Report the files as JSON.

    Raises:
        BaseException: The error that ended the block, or else an error of the animations.
    """
    first: BaseException | None = None
    try:
        yield
    except BrokenPipeError:
        discard_standard_output()
    except BaseException as error:  # raised again below
        first = error
    with handle_interrupts(signal.SIG_IGN):  # it would leave incomplete files
        failures = _stop_runs(runs, is_started=first is None)
        try:
            _print_written(runs, as_json=as_json)
        except BrokenPipeError:
            discard_standard_output()
    reported, raised = (failures, first) if first is not None else (failures[:-1], failures[-1:])
    for failure in reported:
        print_error_line(f"error: {failure}")
    if isinstance(raised, BaseException):
        raise raised
    for failure in raised:
        raise failure


def _stop_runs(runs: Sequence[LiveRun], *, is_started: bool) -> list[Exception]:
    """Stop all runs, then write their animations, and return the errors.

    An animation without frames is an error only if the runs were started.
    """
    failures = list[Exception]()
    for run in runs:
        try:
            run.end()
        except Exception as error:  # reported by `stop_at_end`; stop the others too
            failures.append(error)
    for run in runs:
        animations = run.animations
        if animations is None or animations.recording is None:
            continue
        if animations.is_empty and not is_started:
            animations.discard()
            continue
        print_error_line(f"writing {animations.recording}; this is not interrupted")
        try:
            animations.finish()
        except Exception as error:  # as above
            failures.append(error)
        finally:
            animations.discard()
    return failures


def _print_written(runs: Sequence[LiveRun], *, as_json: bool) -> None:
    written = [each for run in runs if run.animations for each in run.animations.written]
    if not as_json:
        print_lines(f"Wrote:   {each.summary}" for each in written)
        return
    for each in written:
        file = each.file
        data = {
            "wrote": str(file.path),
            "frames": file.frames,
            "seconds": file.seconds,
            "bytes": file.size,
            "error": file.error,
            "instead": each.instead,
        }
        sys.stdout.write(json.dumps(data) + "\n")
    sys.stdout.flush()
