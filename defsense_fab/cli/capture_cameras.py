"""The commands `defsense capture camera calibrate | arrange | check`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import DeviceError
from .output import say

if TYPE_CHECKING:
    from ..capture.tags.charuco_board import CharucoBoard
    from .options import Bars, Commands


def add(steps: Commands, bars: Bars) -> None:
    """Add the commands to those of `capture`; `bars` shows progress."""
    parent = steps.add_parser(
        "camera",
        help="calibrate cameras on a printed board, arrange them, check them",
        description="Find out how cameras see (calibrate), where they stand (arrange), and whether"
        " that still holds (check), with a board of 'defsense capture board'. A SOURCE is a camera"
        " that is plugged in (0, /dev/video0), a video, or a folder of images.",
    )
    kinds = parent.add_subparsers(dest="what", required=True, metavar="WHAT")
    sub = kinds.add_parser(
        "calibrate",
        help="focal length, centre and distortion of each camera",
        description="Calibrate cameras, each by its own views of the board: hold it in all parts of"
        " the picture, near and far, tilted each way. Live cameras take a view by themselves when"
        " the board is still and somewhere new, and say what is missing. The file gets the cameras"
        " by name; a report goes beside it.",
        examples=[
            "defsense capture camera calibrate 0 --board my-cameras --name left",
            "defsense capture camera calibrate a.mkv b.mkv --board my-cameras",
        ],
    )
    _common(sub)
    sub.add_argument("--name", action="append", metavar="NAME",
                     help="of the camera, once for each (the file's name, or cam_0)")  # fmt: skip
    sub.add_argument("--views", type=int, default=25, metavar="N",
                     help="that a live camera is to take (25)")  # fmt: skip
    sub.set_defaults(run=lambda options: _calibrate(options, bars))
    sub = kinds.add_parser(
        "arrange",
        help="where 2 to 6 cameras stand",
        description="Find where cameras stand, from views of the board that several of them see at"
        " the same time, and write it to their file; the first camera is the origin. Videos must"
        " have been started together; hold the board still now and then.",
        examples=[
            "defsense capture camera arrange a.mkv b.mkv --board my-cameras"
            " --calibration cameras.toml"
        ],
    )
    _common(sub)
    sub.add_argument("--views", type=int, default=15, metavar="N",
                     help="that live cameras are to take together (15)")  # fmt: skip
    sub.set_defaults(run=lambda options: _arrange(options, bars))
    sub = kinds.add_parser(
        "check",
        help="whether a calibration still holds",
        description="Look at the board with calibrated cameras and say whether the calibration"
        " still holds; exit code 1 where it does not.",
        examples=["defsense capture camera check a.mkv b.mkv --board my-cameras"],
    )
    _common(sub)
    sub.add_argument("--views", type=int, default=3, metavar="N",
                     help="that live cameras are to take (3)")  # fmt: skip
    sub.set_defaults(run=lambda options: _check(options, bars))


def _common(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("sources", nargs="+", metavar="SOURCE", help="one for each camera")
    sub.add_argument("--board", type=Path, required=True, metavar="DIR",
                     help="what 'capture board' wrote (folder, or its board.json)")  # fmt: skip
    sub.add_argument("--calibration", "--out", type=Path, default=Path("cameras.toml"),
                     metavar="TOML", help="the file of the cameras (cameras.toml)")  # fmt: skip
    sub.add_argument("--rate", type=float, metavar="HZ", help="of frames, for images")
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")


def _live(sources: Sequence[str]) -> bool:
    """Whether the sources are cameras. Raises DeviceError where only some are."""
    live = [s.isdigit() or s.startswith("/dev/") for s in sources]
    if any(live) and not all(live):
        raise DeviceError("give either cameras (0, /dev/video0) or recordings, not both")
    return all(live)


def _board(options: argparse.Namespace) -> CharucoBoard:
    """What the sources show, after a look at the other options. Raises DeviceError."""
    if options.rate is not None and not 0 < options.rate <= 10_000:
        raise DeviceError(f"--rate {options.rate:g}: give frames per second, above 0")
    if not 1 <= options.views <= 80:
        raise DeviceError(f"--views {options.views}: give a number from 1 to 80")
    if not options.calibration.parent.is_dir():
        raise DeviceError(f"{options.calibration}: there is no folder {options.calibration.parent}")
    from ..capture.tags.charuco_board import load_board

    board = load_board(options.board)
    if board.measured is None and not options.json:
        sys.stderr.write(
            "note: the board's squares were never measured: lengths are as exact as the printer;"
            f" defsense capture board {options.board} --measured MM\n"
        )
    return board


def _names(options: argparse.Namespace) -> list[str]:
    given = options.name or []
    if given and len(given) != len(options.sources):
        raise DeviceError(f"--name: {len(given)} given for {len(options.sources)} cameras")
    names = given or [
        f"cam_{k}" if s.isdigit() or s.startswith("/dev/") else Path(s).stem
        for k, s in enumerate(options.sources)
    ]
    from ..core.camera import check_names

    check_names(names)
    return names


def _calibrate(options: argparse.Namespace, bars: Bars) -> int:
    board, names = _board(options), _names(options)
    if _live(options.sources):
        from ..pipeline.cameras.live_views import calibrate_live
        from ..terminal.camera_calibration import BoardTerminal

        done = []
        for source, name in zip(options.sources, names, strict=True):
            with BoardTerminal() as screen:
                done += calibrate_live(
                    source, name, board, options.calibration, options.views, screen
                )
    else:
        from ..pipeline.cameras.recorded_views import calibrate_cameras

        with bars(options) as progress:
            done = calibrate_cameras(
                [Path(s) for s in options.sources], names, board, options.calibration,
                options.rate, progress,
            )  # fmt: skip
    data = [d.data for d in done]
    if options.json:
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
        return 0
    lines = []
    for d in data:
        lines.append(
            f"{d['name']}: {d['error']:.3f} px over {d['views'] - d['left_out']} views"
            f" ({d['left_out']} left out), focal length {d['focal'][0]:.1f} +-"
            f" {d['focal_sigma'][0]:.1f} px, {d['coverage']:.0%} of the picture covered"
        )
        lines += [f"  better: {h}" for h in d["hints"][:3]]
    lines += [
        f"Look at: {options.calibration.with_suffix('.html')}",
        f"Next:    defsense capture camera arrange SOURCE SOURCE --board {options.board}"
        f" --calibration {options.calibration}",
    ]
    say(lines)
    return 0


def _arrange(options: argparse.Namespace, bars: Bars) -> int:
    if not 2 <= len(options.sources) <= 6:
        raise DeviceError("arrange takes 2 to 6 cameras; one alone needs no arranging")
    board = _board(options)
    if _live(options.sources):
        from ..pipeline.cameras.live_views import arrange_live
        from ..terminal.camera_calibration import BoardTerminal

        with BoardTerminal() as screen:
            data = arrange_live(options.sources, board, options.calibration, options.views, screen)
    else:
        from ..pipeline.cameras.recorded_views import arrange_cameras

        with bars(options) as progress:
            data = arrange_cameras(
                [Path(s) for s in options.sources], board, options.calibration, options.rate,
                progress,
            )  # fmt: skip
    if options.json:
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
        return 0
    lines = [
        f"{data['boards']} boards, {data['error']:.3f} px; their corners are where they should be"
        f" to {data['length_error']:.3f} mm"
    ]
    lines += [
        f"{name}: {distance:.1f} mm from {data['names'][0]}, {error:.3f} px"
        for name, distance, error in zip(
            data["names"], data["distances"], data["errors"], strict=True
        )
    ]
    lines += [f"warning: {w}" for w in data["warnings"]]
    lines.append("Next:    defsense capture process --videos FILE FILE --calibration"
                 f" {options.calibration} --tag-size MM")  # fmt: skip
    say(lines)
    return 0


def _check(options: argparse.Namespace, bars: Bars) -> int:
    board = _board(options)
    if _live(options.sources):
        from ..pipeline.cameras.live_views import check_live
        from ..terminal.camera_calibration import BoardTerminal

        with BoardTerminal() as screen:
            found = check_live(options.sources, board, options.calibration, options.views, screen)
    else:
        from ..pipeline.cameras.recorded_views import check_cameras

        with bars(options) as progress:
            found = check_cameras(
                [Path(s) for s in options.sources], board, options.calibration, options.rate,
                progress,
            )  # fmt: skip
    if options.json:
        own = [float(x) if x == x else None for x in found.own]
        pair = {
            name: value if value == value else None
            for name, value in (("together", found.together), ("length", found.length))
        }
        data = {"holds": found.holds, "own": own, "boards": found.boards} | pair
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
        return 0 if found.holds else 1
    lines = [f"alone: {', '.join(f'{x:.2f}' for x in found.own)} px"]
    if found.together == found.together:
        lines.append(
            f"together: rays miss by {found.together:.2f} px, corners of the board by"
            f" {found.length:.3f} mm ({found.boards} views)"
        )
    if found.holds:
        lines.append("The calibration holds.")
    elif any(x > 0.5 for x in found.own):
        lines.append(
            "The calibration does not hold: a camera's zoom, focus or resolution has changed."
            " Calibrate it again, then arrange."
        )
    else:
        lines.append("The calibration does not hold: a camera has been moved. Arrange them again.")
    say(lines)
    return 0 if found.holds else 1
