"""Commands `defsense capture markers | board`: sheets for printing."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import CaptureError, DeviceError
from ..device import device_folder
from ..options import add_output_options, parse_numbers
from ..output import print_json, print_lines

if TYPE_CHECKING:
    from ...core.arrays import Float
    from ..options import Bars, Commands

_PAPER = "a4 (default), letter or a3"
#: Options of the board's design, which cannot be combined with --measured.
_DESIGN_OPTIONS = (
    "square", "columns", "rows", "dictionary", "marker", "printed", "inverted", "legacy", "paper",
)  # fmt: skip


def add(steps: Commands, bars: Bars) -> None:
    """Add the commands to `capture`; `bars` shows progress."""
    sub = steps.add_parser(
        "markers",
        help="Write the tags of a device for printing, and where to glue them",
        description="Choose places for camera tags on the device: the seats that its build has "
        "cut, or else flat places on its skin, three or more on its anchor. Write "
        "markers.pdf, with tags at true scale and pictures of their places, and "
        "markers.json for the other commands.",
        examples=[
            "defsense capture markers my-device",
            "defsense capture markers my-device --count 16 --size 10 --dictionary 36h11",
        ],
    )
    sub.add_argument(
        "device", type=device_folder, metavar="DEVICE", help="Folder that contains device.toml"
    )
    sub.add_argument("--count", type=int, metavar="N", help="Set the number of tags (default: 12)")
    sub.add_argument(
        "--size",
        type=float,
        metavar="MM",
        help="Set the side of a tag's black square in mm (default: the largest of 20, 15, "
        "12, 10, 8, 6 that fits)",
    )
    sub.add_argument(
        "--dictionary",
        default="4X4_50",
        metavar="NAME",
        help="Set the dictionary of the tags, such as APRILTAG_36H11 (default: 4X4_50)",
    )
    sub.add_argument(
        "--side",
        metavar="X,Y,Z",
        help="Place tags only where cameras looking from this direction see them, such as "
        "0,-1,1 (default: all around)",
    )
    sub.add_argument(
        "--skin", action="store_true", help="Choose places on the skin even if the device has seats"
    )
    sub.add_argument("--paper", default="a4", metavar="NAME", help=f"Set the paper size: {_PAPER}")
    sub.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="Set the output folder (default: markers, in the device folder)",
    )
    add_output_options(sub)
    sub.set_defaults(run=lambda options: _markers(options, bars))
    sub = steps.add_parser(
        "board",
        help="Write the ChArUco board for calibrating the cameras",
        description="Write board.pdf, a chessboard with tags at true scale, and board.json. Print "
        "it, measure a square, and store the measurement with the same command and "
        "--measured: all lengths measured by the cameras scale with it.",
        examples=[
            "defsense capture board my-cameras",
            "defsense capture board my-cameras --measured 29.95",
            "defsense capture board other --columns 4 --rows 5 --square 54 --marker 40.5"
            " --dictionary 4X4_1000 --inverted",
        ],
    )
    sub.add_argument(
        "folder",
        type=Path,
        nargs="?",
        default=Path(),
        metavar="OUT",
        help="Output folder (default: current folder)",
    )
    sub.add_argument(
        "--square", type=float, metavar="MM", help="Set the side of a square in mm (default: 30)"
    )
    sub.add_argument(
        "--columns", type=int, metavar="N", help="Set the number of squares across (default: 7)"
    )
    sub.add_argument(
        "--rows", type=int, metavar="N", help="Set the number of squares down (default: 5)"
    )
    sub.add_argument(
        "--dictionary",
        metavar="NAME",
        help="Set the dictionary of the board's tags; it must differ from that of the "
        "device's tags (default: 5X5_100)",
    )
    sub.add_argument(
        "--marker",
        type=float,
        metavar="MM",
        help="Set the side of a tag in mm (default: 11/15 of a square)",
    )
    sub.add_argument(
        "--printed",
        action="store_true",
        help="Describe a board that exists already: write only board.json, with nothing to print",
    )
    sub.add_argument(
        "--inverted",
        action="store_true",
        help="Describe a board of another program that is white where ours is black; "
        "implies --printed",
    )
    sub.add_argument(
        "--legacy",
        action="store_true",
        help="Describe a board drawn by OpenCV before 4.6, which starts with white if the "
        "number of rows is even; implies --printed",
    )
    sub.add_argument("--paper", metavar="NAME", help=f"Set the paper size: {_PAPER}")
    sub.add_argument(
        "--measured",
        type=float,
        metavar="MM",
        help="Store the measured side of a printed square in mm in the board.json of OUT",
    )
    add_output_options(sub)
    sub.set_defaults(run=_board)


def _parse_direction(text: str | None) -> Float | None:
    """Return X,Y,Z as a vector of shape (3,), or None if omitted."""
    if text is None:
        return None
    import numpy as np

    values = np.array(parse_numbers("--side", text, "any unit"))
    if values.shape != (3,) or not np.linalg.norm(values) > 0:
        raise DeviceError(
            f"{text} is not a direction",
            code="direction-invalid",
            where="--side",
            action="Give a direction x,y,z, such as 0,-1,1",
            value=text,
        )
    return values


def _markers(options: argparse.Namespace, bars: Bars) -> int:
    from ...core.device.device_file import load_device
    from ...workflow.tags.markers import SHEETS, write_markers

    device = load_device(options.device, complete=False)
    with bars(options) as progress:
        result = write_markers(
            device,
            options.out,
            count=options.count,
            size=options.size,
            family=options.dictionary,
            paper=options.paper,
            skin=options.skin,
            side=_parse_direction(options.side),
            progress=progress,
        )
    m = result.markers
    if options.json:
        data = {
            "folder": str(result.folder),
            "dictionary": m.dictionary,
            "size": m.size,
            "ids": m.ids.tolist(),
            "anchor": m.ids[m.anchor].tolist(),
            "notes": list(result.notes),
        }
        print_json(data)
        return 0
    on_anchor = f", {m.anchor.sum()} of them on {device.outputs.anchor}" if m.anchor.any() else ""
    print_lines(
        [
            f"{len(m.ids)} tags of {m.size:g} mm, {m.dictionary}{on_anchor}",
            *(f"note: {n}" for n in result.notes),
            f"Look at: {result.folder / SHEETS}",
            "Next:    print it at 100 % (the rulers must be 100 mm), cut out the tags with their"
            " white margins, glue them on as shown; for the cameras: defsense capture board",
        ]
    )
    return 0


_PRINT_BOARD = "print it at 100 % (the rulers must be 100 mm), glue it flat on a stiff plate, "


def _board(options: argparse.Namespace) -> int:
    from ...capture.tags.print_sheets import write_board
    from ...capture.tags.tag_patterns import FILE, MARKER, CharucoBoard, load_board, save_board
    from ...core.storage.files import storage_errors

    folder: Path = options.folder
    path = folder / FILE
    given = {
        k: v for k in _DESIGN_OPTIONS if (v := getattr(options, k)) is not None and v is not False
    }
    if options.measured is not None:
        if given:
            option = next(iter(given))
            raise CaptureError(
                f"cannot be combined with --{option}, since {path} describes the measured board",
                code="options-conflict",
                where="--measured",
                action=f"Omit --{option}",
                option=f"--{option}",
            )
        board = load_board(path).measure(options.measured)
        save_board(board, path)
        lines = [
            f"measured: squares of {board.measured:g} mm, drawn as {board.square:g} mm"
            f" ({board.scale - 1:+.2%})",
            f"Wrote:   {path}",
            f"Next:    defsense capture camera calibrate --board {path}",
        ]
    else:
        paper = given.pop("paper", "a4")
        printed = given.pop("printed", False) or "inverted" in given or "legacy" in given
        square = given.get("square", CharucoBoard().square)
        board = CharucoBoard(**{"marker": round(MARKER * square, 1), **given})
        with storage_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        had_measurement = path.is_file() and _was_measured(path)
        if not printed:
            write_board(board, path.with_suffix(".pdf"), paper)
        save_board(board, path)
        lines = [
            f"{board.columns} x {board.rows} squares of {board.square:g} mm, tags of"
            f" {board.marker:g} mm, {board.family.name}",
            *(
                ["note: the measurement of the earlier print was removed"]
                if had_measurement
                else []
            ),
            f"Wrote:   {path}" if printed else f"Look at: {path.with_suffix('.pdf')}",
            "Next:    "
            + ("" if printed else _PRINT_BOARD)
            + "measure squares with a caliper, and store the side of one with"
            f" defsense capture board {folder} --measured MM",
        ]
    if options.json:
        print_json({"file": str(path), **asdict(board)})
    else:
        print_lines(lines)
    return 0


def _was_measured(path: Path) -> bool:
    from ...capture.tags.tag_patterns import load_board

    try:
        return load_board(path).measured is not None
    except CaptureError:
        return False
