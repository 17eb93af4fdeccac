"""The commands `defsense capture markers | board`: what users print."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import CaptureError, DeviceError
from ..device import device_folder
from ..options import numbers

if TYPE_CHECKING:
    from ...core.arrays import Float
    from ..options import Bars, Commands

_PAPER = "a4 (default), letter or a3"
#: Options of a board's design, which a print that is measured has already.
_DESIGN = (
    "square", "columns", "rows", "dictionary", "marker", "printed", "inverted", "legacy", "paper",
)  # fmt: skip


def add(steps: Commands, bars: Bars) -> None:
    """Add the commands to those of `capture`; `bars` shows progress."""
    sub = steps.add_parser(
        "markers",
        help="the tags of a device to print, and where they go",
        description="Choose places for camera tags on the device (the seats that its build has"
        " cut, or else flat places on its skin, three or more on its anchor) and write markers.pdf,"
        " tags at true scale and pictures of where they go, and markers.json, which says so to the"
        " other commands.",
        examples=[
            "defsense capture markers my-device",
            "defsense capture markers my-device --count 16 --size 10 --dictionary 36h11",
        ],
    )
    sub.add_argument("device", type=device_folder, metavar="DEVICE", help="folder with device.toml")
    sub.add_argument("--count", type=int, metavar="N", help="how many tags (12)")
    sub.add_argument(
        "--size", type=float, metavar="MM",
        help="side of a tag's black square (the largest of 20, 15, 12, 10, 8, 6 that fits)",
    )  # fmt: skip
    sub.add_argument(
        "--dictionary", default="4X4_50", metavar="NAME",
        help="family of tags: 4X4_50 (default), APRILTAG_36H11, ...",
    )  # fmt: skip
    sub.add_argument(
        "--side", metavar="X,Y,Z",
        help="only where cameras see them that look from this direction, as in 0,-1,1 (all round)",
    )  # fmt: skip
    sub.add_argument("--skin", action="store_true", help="choose places even where there are seats")
    sub.add_argument("--paper", default="a4", metavar="NAME", help=_PAPER)
    sub.add_argument(
        "--out", type=Path, metavar="DIR", help="where to write (markers, in the device's folder)"
    )
    _common(sub)
    sub.set_defaults(run=lambda options: _markers(options, bars))
    sub = steps.add_parser(
        "board",
        help="the ChArUco board to print, which calibrates the cameras",
        description="Write board.pdf, a chessboard with tags at true scale, and board.json. Print"
        " it, measure a square, and store that by the same command with --measured: all lengths"
        " that the cameras give scale by it.",
        examples=[
            "defsense capture board my-cameras",
            "defsense capture board my-cameras --measured 29.95",
            "defsense capture board other --columns 4 --rows 5 --square 54 --marker 40.5"
            " --dictionary 4X4_1000 --inverted",
        ],
    )
    sub.add_argument(
        "folder", type=Path, nargs="?", default=Path(), metavar="OUT", help="a folder (this one)"
    )
    sub.add_argument("--square", type=float, metavar="MM", help="side of a square (30)")
    sub.add_argument("--columns", type=int, metavar="N", help="squares across (7)")
    sub.add_argument("--rows", type=int, metavar="N", help="squares down (5)")
    sub.add_argument(
        "--dictionary", metavar="NAME",
        help="family of its tags (5X5_100): another than that of the device's tags",
    )  # fmt: skip
    sub.add_argument("--marker", type=float, metavar="MM", help="side of a tag (11/15 of a square)")
    sub.add_argument(
        "--printed", action="store_true",
        help="a board that is there already: write board.json alone, nothing to print",
    )  # fmt: skip
    sub.add_argument(
        "--inverted", action="store_true",
        help="a board of another program, white where ours is black; implies --printed",
    )  # fmt: skip
    sub.add_argument(
        "--legacy", action="store_true",
        help="a board as OpenCV drew it before 4.6, which begins with white where the number of"
        " rows is even; implies --printed",
    )  # fmt: skip
    sub.add_argument("--paper", metavar="NAME", help=_PAPER)
    sub.add_argument(
        "--measured", type=float, metavar="MM",
        help="store the side of a square as printed in the board.json of OUT",
    )  # fmt: skip
    _common(sub)
    sub.set_defaults(run=_board)


def _common(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")


def _direction(text: str | None) -> Float | None:
    """X,Y,Z as (3,), or None. Raises DeviceError for what is no direction."""
    if text is None:
        return None
    import numpy as np

    values = np.array(numbers("--side", text, "any unit"))
    if values.shape != (3,) or not np.linalg.norm(values) > 0:
        raise DeviceError(f"--side {text}: give a direction x,y,z, as in 0,-1,1")
    return values


def _markers(options: argparse.Namespace, bars: Bars) -> int:
    from ...core.device.device_file import load_device
    from ...workflow.tags.markers import SHEETS, write_markers

    device = load_device(options.device, complete=False)
    with bars(options) as progress:
        found = write_markers(
            device,
            options.out,
            count=options.count,
            size=options.size,
            family=options.dictionary,
            paper=options.paper,
            skin=options.skin,
            side=_direction(options.side),
            progress=progress,
        )
    m = found.markers
    if options.json:
        data = {
            "folder": str(found.folder),
            "dictionary": m.dictionary,
            "size": m.size,
            "ids": m.ids.tolist(),
            "anchor": m.ids[m.anchor].tolist(),
            "notes": list(found.notes),
        }
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
        return 0
    on = f", {m.anchor.sum()} of them on {device.outputs.anchor}" if m.anchor.any() else ""
    _say(
        [
            f"{len(m.ids)} tags of {m.size:g} mm, {m.dictionary}{on}",
            *(f"note: {n}" for n in found.notes),
            f"Look at: {found.folder / SHEETS}",
            "Next:    print it at 100 % (the rulers must be 100 mm), cut the tags out with their"
            " white, glue them on as pictured; then the cameras: defsense capture board",
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
    given = {k: v for k in _DESIGN if (v := getattr(options, k)) is not None and v is not False}
    if options.measured is not None:
        if given:
            raise CaptureError(
                f"--measured goes without --{next(iter(given))}: it belongs to the board that"
                f" {path} describes"
            )
        board = load_board(path).measure(options.measured)
        save_board(board, path)
        lines = [
            f"measured: squares of {board.measured:g} mm, drawn as {board.square:g} mm"
            f" ({board.scale - 1:+.2%})",
            f"Written: {path}",
            f"Next:    defsense capture camera calibrate --board {path}",
        ]
    else:
        paper = given.pop("paper", "a4")
        printed = given.pop("printed", False) or "inverted" in given or "legacy" in given
        square = given.get("square", CharucoBoard().square)
        board = CharucoBoard(**{"marker": round(MARKER * square, 1), **given})
        with storage_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        forgotten = path.is_file() and _was_measured(path)
        if not printed:
            write_board(board, path.with_suffix(".pdf"), paper)
        save_board(board, path)
        lines = [
            f"{board.columns} x {board.rows} squares of {board.square:g} mm, tags of"
            f" {board.marker:g} mm, {board.family.name}",
            *(["note: what was measured of an earlier print is forgotten"] if forgotten else []),
            f"Written: {path}" if printed else f"Look at: {path.with_suffix('.pdf')}",
            "Next:    "
            + ("" if printed else _PRINT_BOARD)
            + "measure squares with a caliper, and store the side of one:"
            f" defsense capture board {folder} --measured MM",
        ]
    if options.json:
        sys.stdout.write(json.dumps({"file": str(path), **asdict(board)}, indent=1) + "\n")
    else:
        _say(lines)
    return 0


def _was_measured(path: Path) -> bool:
    from ...capture.tags.tag_patterns import load_board

    try:
        return load_board(path).measured is not None
    except CaptureError:
        return False


def _say(lines: Sequence[str]) -> None:
    from rich.console import Console

    console = Console()
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
