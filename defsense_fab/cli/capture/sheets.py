"""The commands `defsense capture markers | board`: sheets for printing."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...core.errors import CaptureError
from ...core.schema.options import changed_options
from ...workflow.tags.options import CharucoOptions, MarkerOptions
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, print_json, print_lines, progress_bars

if TYPE_CHECKING:
    from ...workflow.tags.boards import BoardFiles

_DEFAULT_MARKERS = MarkerOptions()
_DEFAULT_BOARD = CharucoOptions()
_NO_OUTPUT = OutputOptions()
_PRINT = "print it at 100 % (the rulers must be 100 mm), "

markers = command(
    "markers",
    "defsense capture markers my-device",
    "defsense capture markers my-device --count 16 --size 10 --dictionary 36h11",
)
board = command(
    "board",
    "defsense capture board my-cameras",
    "defsense capture board my-cameras --measured 29.95",
    "defsense capture board other --columns 4 --rows 5 --square 54 --marker 40.5"
    " --dictionary 4X4_1000 --inverted",
)


@markers.default
def _markers(
    device: DeviceFolder,
    /,
    *,
    options: Annotated[MarkerOptions, Parameter(name="*", negative=())] = _DEFAULT_MARKERS,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Write the tags of a device for printing, and where to glue them.

    Places are the seats that the device's build has cut, or else flat places on its skin, three or
    more on its anchor. The result is markers.pdf, with tags at true scale and pictures of their
    places, and markers.json for the other commands.

    Args:
        device: Folder that contains device.toml.
    """
    from ...core.device.device_file import load_device
    from ...workflow.tags.markers import SHEETS, write_markers

    loaded = load_device(device, complete=False)
    with progress_bars(output) as progress:
        result = write_markers(loaded, options, progress)
    tags = result.markers
    if output.json:
        print_json(
            {
                "folder": str(result.folder),
                "dictionary": tags.dictionary,
                "size": tags.size,
                "ids": tags.ids.tolist(),
                "anchor": tags.ids[tags.anchor].tolist(),
                "notes": list(result.notes),
            }
        )
        return
    anchored = int(tags.anchor.sum())
    on_anchor = f", {anchored} of them on {loaded.outputs.anchor}" if anchored else ""
    print_lines(
        [
            f"{len(tags.ids)} tags of {tags.size:g} mm, {tags.dictionary}{on_anchor}",
            *(f"note: {note}" for note in result.notes),
            f"Look at: {result.folder / SHEETS}",
            f"Next:    {_PRINT}cut out the tags with their white margins, glue them on as shown;"
            " for the cameras: defsense capture board",
        ]
    )


@board.default
def _board(
    folder: Path = Path(),
    /,
    *,
    options: Annotated[CharucoOptions, Parameter(name="*", negative=())] = _DEFAULT_BOARD,
    measured: float | None = None,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Write the ChArUco board for calibrating the cameras.

    The result is board.pdf, a chessboard with tags at true scale, and board.json. Print it, measure
    a square, and store the measurement with the same command and --measured: all lengths measured
    by the cameras scale with it.

    Args:
        folder: Output folder.
        measured: Store the measured side of a printed square in mm in the board.json of the folder.
    """
    from ...workflow.tags.boards import store_measurement, write_board

    if measured is None:
        result = write_board(folder, options)
        lines = _describe_board(result)
    else:
        for name in changed_options(options):
            raise CaptureError(
                f"cannot be combined with --{name}, since the board of {folder} has its own",
                code="options-conflict",
                where="--measured",
                action=f"Omit --{name}",
                option=f"--{name}",
            )
        result = store_measurement(folder, measured)
        lines = [
            f"measured: squares of {measured:g} mm, drawn as {result.board.square:g} mm"
            f" ({result.board.scale - 1:+.2%})",
            f"Wrote:   {result.file}",
            f"Next:    defsense capture camera calibrate --board {result.file}",
        ]
    if output.json:
        print_json({"file": str(result.file), **asdict(result.board)})
    else:
        print_lines(lines)


def _describe_board(result: BoardFiles) -> list[str]:
    board = result.board
    lines = [
        f"{board.columns} x {board.rows} squares of {board.square:g} mm, tags of"
        f" {board.marker:g} mm, {board.family.name}"
    ]
    if result.lost_measurement:
        lines.append("note: the measurement of the earlier print was removed")
    to_print = f"{_PRINT}glue it flat on a stiff plate, " if result.sheet else ""
    return [
        *lines,
        f"Look at: {result.sheet}" if result.sheet else f"Wrote:   {result.file}",
        f"Next:    {to_print}measure squares with a caliper, and store the side of one with"
        f" defsense capture board {result.file.parent} --measured MM",
    ]
