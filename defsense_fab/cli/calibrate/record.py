"""The command `defsense calibrate record`: measure a specimen on its jigs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.board.options import BoardOptions
from ...workflow.calibrate.options import MeasureOptions
from ..app import command
from ..board.ports import Port
from ..exit_codes import DONE, STOPPED
from ..output import OutputOptions, print_json, print_lines, standard_output

if TYPE_CHECKING:
    from ...workflow.calibrate.record_specimen import RecordedSpecimen

_READINGS, _BOARD, _OUTPUT = MeasureOptions(), BoardOptions(), OutputOptions()

record = command(
    "record",
    "defsense calibrate record --port /dev/ttyUSB0 --specimen my-specimen",
    "defsense calibrate record --port twin:speed=20 --specimen my-specimen --rounds 2",
)


@record.default
def _record(
    *,
    port: Port,
    specimen: Path,
    out: Path | None = None,
    auto: bool = False,
    options: Annotated[MeasureOptions, Parameter(name="*")] = _READINGS,
    board: Annotated[BoardOptions, Parameter(name="*")] = _BOARD,
    output: OutputOptions = _OUTPUT,
) -> int:
    """Measure a specimen on its jigs, step by step.

    The screen shows which jig is next and which side lies on it, waits until the reading has
    settled, and plots the points so far. Every frame is written immediately. Press q to stop; rerun
    the command to resume.

    Args:
        port: Set the port of the read-out board.
        specimen: Set the folder that 'calibrate specimen' wrote, or its specimen.json.
        out: Set the session folder (default: session, next to specimen.json).
        auto: Read no keys: for twins, and for machines that bend the specimen.
    """
    from ...workflow.calibrate.record_specimen import record_specimen
    from ..terminal.guided_screen import GuidedLines, GuidedTerminal

    screen = GuidedLines() if auto else GuidedTerminal()
    result = record_specimen(port, specimen, options, board, screen=screen, out=out, auto=auto)
    with standard_output():
        if output.json:
            data = {
                "session": str(result.folder),
                "finished": result.is_finished,
                "left": result.readings - result.finished,
                "steps": result.readings,
            }
            print_json(data)
        else:
            print_lines(_describe_recorded(result))
    return DONE if result.is_finished else STOPPED


def _describe_recorded(result: RecordedSpecimen) -> list[str]:
    folder, count = result.folder, result.readings
    if result.is_finished:
        return [
            f"All {count} readings are complete: {folder}",
            f"Next:    defsense calibrate fit {folder} (and other specimens' sessions)",
        ]
    return [
        f"Stopped after {result.finished} of {count} readings; all frames are in {folder}",
        "Next:    rerun the command to resume; fit accepts incomplete sessions",
    ]
