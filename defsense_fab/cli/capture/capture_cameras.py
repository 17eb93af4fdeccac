"""Commands `defsense capture camera calibrate | arrange | check`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import CaptureError, DeviceError
from ..exit_codes import DONE, NO
from ..options import add_output_options, parse_twin_cameras
from ..output import print_json, print_lines

if TYPE_CHECKING:
    from ...capture.cameras.rig_check import Diagnosis
    from ...capture.tags.tag_patterns import CharucoBoard
    from ...twin.live.board_twin import BoardTwin
    from ..options import Bars, Commands
    from ..terminal.camera_calibration import BoardLines, BoardTerminal


def add(steps: Commands, bars: Bars) -> None:
    """Add the commands to `capture`; `bars` shows progress."""
    parent = steps.add_parser(
        "camera",
        help="Calibrate cameras with a printed board, arrange them, check them",
        description="Determine the lenses of cameras (calibrate) and their positions (arrange), "
        "and test whether both are still valid (check), with a board of 'defsense "
        "capture board'. A SOURCE is a connected camera (0, /dev/video0), a video, or "
        "a folder of images. The single source twin (twin:webcam,seed=1,cameras=2) "
        "stands for simulated cameras that see a board.",
    )
    kinds = parent.add_subparsers(dest="what", required=True, metavar="WHAT")
    sub = kinds.add_parser(
        "calibrate",
        help="Measure focal length, center and distortion of each camera",
        description="Calibrate each camera from its own views of the board. Hold the board in all "
        "parts of the picture, at small and large distances, tilted in every "
        "direction. Live cameras take a view automatically when the board is still and"
        " in a new place, and show what is missing. The file lists the cameras by "
        "name; a report is written next to it.",
        examples=[
            "defsense capture camera calibrate 0 2 --board my-cameras --name left right",
            "defsense capture camera calibrate a.mkv b.mkv --board my-cameras",
            "defsense capture camera calibrate twin --board my-cameras",
        ],
    )
    sub.usage = f"{sub.prog} SOURCE [SOURCE ...] --board DIR [--name NAME ...] [options]"
    _add_common_arguments(sub)
    sub.add_argument(
        "--name",
        action="extend",
        nargs="+",
        metavar="NAME",
        help="Set the names of the cameras, one per SOURCE (default: the files' names, or "
        "cam_0, cam_1)",
    )
    sub.add_argument(
        "--views",
        type=int,
        default=25,
        metavar="N",
        help="Set the number of views that a live camera takes (default: 25)",
    )
    sub.add_argument(
        "--lens",
        choices=("pinhole", "fisheye"),
        default="pinhole",
        help="Choose the lens model: pinhole (default), or fisheye for lenses that show "
        "more than 110 degrees",
    )
    sub.set_defaults(run=lambda options: _calibrate(options, bars))
    sub = kinds.add_parser(
        "arrange",
        help="Measure the positions of 2 to 6 cameras",
        description="Find the positions of the cameras from views of the board that several of "
        "them see at the same time, and write them to the calibration file; the first "
        "camera is the origin. Videos must have been started together. Hold the board "
        "still from time to time.",
        examples=[
            "defsense capture camera arrange a.mkv b.mkv --board my-cameras"
            " --calibration cameras.toml"
        ],
    )
    _add_common_arguments(sub)
    sub.add_argument(
        "--views",
        type=int,
        default=15,
        metavar="N",
        help="Set the number of views that live cameras take together (default: 15)",
    )
    sub.add_argument(
        "--keep-world",
        action="store_true",
        help="Keep the first camera where the calibration file has it, if another program "
        "(aniposelib) wrote it (default: it becomes the origin)",
    )
    sub.set_defaults(run=lambda options: _arrange(options, bars))
    sub = kinds.add_parser(
        "check",
        help="Check whether a calibration is still valid",
        description="View the board with calibrated cameras and report whether the calibration is "
        "still valid. The exit code is 1 if it is not.",
        examples=["defsense capture camera check a.mkv b.mkv --board my-cameras"],
    )
    _add_common_arguments(sub)
    sub.add_argument(
        "--views",
        type=int,
        default=3,
        metavar="N",
        help="Set the number of views that live cameras take (default: 3)",
    )
    sub.set_defaults(run=lambda options: _check(options, bars))


def _add_common_arguments(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="Sources, one per camera, or twin (twin:phone,seed=1,cameras=2)",
    )
    sub.add_argument(
        "--board",
        type=Path,
        required=True,
        metavar="DIR",
        help="Set the folder that 'capture board' wrote, or its board.json",
    )
    sub.add_argument(
        "--calibration",
        "--out",
        type=Path,
        default=Path("cameras.toml"),
        metavar="TOML",
        help="Set the calibration file of the cameras (default: cameras.toml)",
    )
    sub.add_argument("--rate", type=float, metavar="HZ", help="Set the frame rate of images in Hz")
    add_output_options(sub)


def _are_live(sources: Sequence[str]) -> bool:
    """Return whether the sources are live cameras, or raise DeviceError if only some are."""
    live = [s.isdigit() or s.startswith("/dev/") for s in sources]
    if any(live) and not all(live):
        raise DeviceError(
            "cameras and recordings are mixed",
            code="sources-mixed",
            where="SOURCE",
            action="Give either cameras (0, /dev/video0) or recordings",
        )
    return all(live)


def _load_board(options: argparse.Namespace) -> CharucoBoard:
    """Return the board that the sources show, after checking the other options."""
    if not _is_twin_source(options) and any(_is_twin(s) for s in options.sources):
        raise DeviceError(
            "twin stands for all cameras and cannot be combined with other sources",
            code="twin-not-alone",
            where="SOURCE",
            action="Give it alone; twin:cameras=3 has three cameras",
        )
    if options.rate is not None and not 0 < options.rate <= 10_000:
        raise DeviceError(
            f"{options.rate:g} is out of range",
            code="out-of-range",
            where="--rate",
            action="Give frames per second, above 0",
            value=options.rate,
        )
    if not 1 <= options.views <= 80:
        raise DeviceError(
            f"{options.views} is out of range",
            code="out-of-range",
            where="--views",
            action="Give a number from 1 to 80",
            value=options.views,
        )
    if not options.calibration.parent.is_dir():
        raise DeviceError(
            f"the folder {options.calibration.parent} does not exist",
            code="folder-not-result",
            where=options.calibration,
            action="Create it, or choose another",
        )
    from ...capture.tags.tag_patterns import load_board

    board = load_board(options.board)
    if board.measured is None and not options.json:
        sys.stderr.write(
            "note: the squares of the board were not measured, so lengths are as accurate as the"
            f" printer. Run: defsense capture board {options.board} --measured MM\n"
        )
    return board


def _is_twin(source: str) -> bool:
    return source.partition(":")[0] == "twin"


def _is_twin_source(options: argparse.Namespace) -> bool:
    return len(options.sources) == 1 and _is_twin(options.sources[0])


def _create_twin(options: argparse.Namespace, board: CharucoBoard) -> BoardTwin | None:
    """Return the twin if it is the source, and replace the sources by its cameras."""
    if not _is_twin_source(options):
        return None
    seed, count, kind = parse_twin_cameras("SOURCE", options.sources[0])
    from ...twin.live.board_twin import BoardTwin

    twin = BoardTwin(board, seed, count, kind)
    options.sources = [c.name for c in twin.cameras]
    return twin


def _screen(twin: BoardTwin | None) -> BoardTerminal | BoardLines:
    """Return the display of live cameras: plain lines for a twin without a terminal."""
    from ..terminal.camera_calibration import BoardLines, BoardTerminal

    terminal = twin is None or (sys.stdin.isatty() and sys.stdout.isatty())
    return BoardTerminal() if terminal else BoardLines()


def _camera_names(options: argparse.Namespace) -> list[str]:
    given = options.name or []
    if given and len(given) != len(options.sources):
        raise DeviceError(
            f"{' '.join(given)} names {len(given)} cameras, but there are"
            f" {len(options.sources)} sources ({' '.join(options.sources)})",
            code="camera-count-differs",
            where="--name",
            action="Give one name per source, in their order",
            count=len(given),
        )
    names = given or [
        f"cam_{k}" if s.isdigit() or s.startswith("/dev/") else Path(s).stem
        for k, s in enumerate(options.sources)
    ]
    from ...core.camera import check_names

    check_names(names)
    return names


def _calibrate(options: argparse.Namespace, bars: Bars) -> int:
    board, given = _load_board(options), options.sources[0]
    twin = _create_twin(options, board)
    names = _camera_names(options)
    if twin or _are_live(options.sources):
        from ...capture.cameras.image_sources import Webcam
        from ...workflow.cameras.live_views import Opener, calibrate_live

        done = []
        opener: Opener = twin.alone if twin else Webcam
        for source, name in zip(options.sources, names, strict=True):
            with _screen(twin) as screen:
                done += calibrate_live(
                    source, name, board, options.calibration, options.views, screen, opener,
                    fisheye=options.lens == "fisheye",
                )  # fmt: skip
    else:
        from ...workflow.cameras.recorded_views import calibrate_cameras

        with bars(options) as progress:
            done = calibrate_cameras(
                [Path(s) for s in options.sources], names, board, options.calibration,
                options.rate, progress, fisheye=options.lens == "fisheye",
            )  # fmt: skip
    data = [d.data for d in done]
    for d, true in zip(data, twin.cameras if twin else (), strict=False):
        d["true_focal"] = true.focal.tolist()
    if options.json:
        print_json(data)
        return 0
    lines = []
    for d in data:
        lines.append(
            f"{d['name']}: {d['error']:.3f} px over {d['views'] - d['left_out']} views"
            f" ({d['left_out']} excluded), focal length {d['focal'][0]:.1f} +-"
            f" {d['focal_sigma'][0]:.1f} px, {d['coverage']:.0%} of the image covered"
        )
        lines += [f"  improvement: {h}" for h in d["hints"][:3]]
        if "true_focal" in d:
            deviation = d["focal"][0] / d["true_focal"][0] - 1
            lines.append(f"  true focal length {d['true_focal'][0]:.1f} px, error {deviation:+.2%}")
    lines += [
        f"Look at: {options.calibration.with_suffix('.html')}",
        f"Next:    defsense capture camera arrange {given if twin else 'SOURCE SOURCE'} --board"
        f" {options.board} --calibration {options.calibration}",
    ]
    print_lines(lines)
    return 0


def _arrange(options: argparse.Namespace, bars: Bars) -> int:
    board, given = _load_board(options), options.sources[0]
    twin = _create_twin(options, board)
    if not 2 <= len(options.sources) <= 6:
        raise DeviceError(
            f"{len(options.sources)} cameras cannot be arranged",
            code="camera-count-invalid",
            where="SOURCE",
            action="Give 2 to 6 cameras; a single camera need not be arranged",
            count=len(options.sources),
        )
    if twin or _are_live(options.sources):
        from ...capture.cameras.image_sources import Webcam
        from ...workflow.cameras.live_views import Opener, arrange_live

        opener: Opener = twin.together() if twin else Webcam
        with _screen(twin) as screen:
            data = arrange_live(
                options.sources, board, options.calibration, options.views, screen, opener,
                keep=options.keep_world,
            )  # fmt: skip
    else:
        from ...workflow.cameras.recorded_views import arrange_cameras

        with bars(options) as progress:
            data = arrange_cameras(
                [Path(s) for s in options.sources], board, options.calibration, options.rate,
                progress, keep=options.keep_world,
            )  # fmt: skip
    if twin is not None:
        data["true_distances"] = twin.distances
    if options.json:
        print_json(data)
        return 0
    lines = [
        f"{data['boards']} boards, {data['error']:.3f} px; error of the board's corners:"
        f" {data['length_error']:.3f} mm"
    ]
    true = [f" (true: {x:.1f} mm)" for x in data.get("true_distances", [])]
    lines += [
        f"{name}: {distance:.1f} mm from {data['names'][0]}{more}, {error:.3f} px"
        for name, distance, error, more in zip(
            data["names"], data["distances"], data["errors"],
            true or [""] * len(data["names"]), strict=True,
        )
    ]  # fmt: skip
    lines.append(f"frame: {data['frame']}")
    lines += [f"warning: {w}" for w in data["warnings"]]
    lines.append(
        f"Next:    defsense capture camera check {given} --board {options.board} --calibration"
        f" {options.calibration}"
        if twin
        else "Next:    defsense capture process --videos FILE FILE --calibration"
        f" {options.calibration} --tag-size MM"
    )
    print_lines(lines)
    return 0


def _check(options: argparse.Namespace, bars: Bars) -> int:
    board = _load_board(options)
    twin = _create_twin(options, board)
    if twin or _are_live(options.sources):
        from ...capture.cameras.image_sources import Webcam
        from ...workflow.cameras.live_views import Opener, check_live

        opener: Opener = twin.together(again=True) if twin else Webcam
        with _screen(twin) as screen:
            result = check_live(
                options.sources, board, options.calibration, options.views, screen, opener
            )
    else:
        from ...workflow.cameras.recorded_views import check_cameras

        with bars(options) as progress:
            result = check_cameras(
                [Path(s) for s in options.sources], board, options.calibration, options.rate,
                progress,
            )  # fmt: skip
    check, cause = result.check, result.cause
    if options.json:
        data = {
            "holds": check.holds,
            "own": [_finite(x) for x in check.camera_errors], "boards": check.boards,
            "together": _finite(check.ray_error), "length": _finite(check.corner_error),
            "cause": cause and cause.kind, "square": cause and cause.square,
            "order": cause and cause.order and [options.sources[k] for k in cause.order],
        }  # fmt: skip
        print_json(data)
        return DONE if check.holds else NO
    errors = ", ".join(
        f"{name} {f'{x:.2f} px' if isfinite(x) else 'does not see the board'}"
        for name, x in zip(result.names, check.camera_errors, strict=True)
    )
    lines = [f"each camera: {errors}"]
    if isfinite(check.ray_error):
        corners = (
            f"corners of the board by {check.corner_error:.3f} mm"
            if isfinite(check.corner_error)
            else "and do not meet in a board"
        )
        lines.append(
            f"all cameras: rays miss by {check.ray_error:.2f} px, {corners} ({check.boards} views)"
        )
    verdict = "The calibration is valid."
    if cause:
        verdict = "The calibration is not valid: " + _describe_cause(options, board, result)
    print_lines([*lines, verdict])
    return DONE if check.holds else NO


def _finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _describe_cause(options: argparse.Namespace, board: CharucoBoard, result: Diagnosis) -> str:
    """Describe why a calibration is not valid, and what to do."""
    from ...capture.cameras.rig_check import MAX_ERROR_PX

    cause, names = result.cause, result.names
    assert cause is not None
    if cause.kind == "order" and cause.order is not None:
        given = [options.sources[k] for k in cause.order]
        pairs = ", ".join(f"{s} is camera {n}" for s, n in zip(given, names, strict=True))
        text = f"the sources are swapped: {pairs}. Give them in this order: {' '.join(given)}."
        return text + (
            f" In addition, {_describe_size(options, board, cause.square)}" if cause.square else ""
        )
    if cause.kind == "board" and cause.square is not None:
        return _describe_size(options, board, cause.square)
    if cause.kind == "lens":
        bad = [
            n for n, x in zip(names, result.check.camera_errors, strict=True) if x > MAX_ERROR_PX
        ]
        return (
            f"zoom, focus or resolution of {' and '.join(bad)} has changed. Calibrate again, then"
            " arrange."
        )
    moved = [n for n, x in zip(names, result.check.disagreeing, strict=True) if x]
    camera = f"camera {moved[0]}" if len(moved) == 1 else "a camera"
    return f"{camera} has been moved. Arrange the cameras again."


def _describe_size(options: argparse.Namespace, board: CharucoBoard, square: float) -> str:
    """Describe squares whose size, in mm, differs from the stated one."""
    stated = board.scale * board.square
    action = f"store it: defsense capture board {options.board} --measured MM"
    try:
        board.measure(square)
    except CaptureError:  # the difference is larger than a printer causes
        action = (
            "print the board again at 100 %, or describe this one: defsense capture board"
            f" {options.board} --printed --square MM"
        )
    return (
        f"the cameras measure squares of {square:.2f} mm on the printed board, but {stated:.2f} mm"
        " is stated; everything else agrees. Measure several squares in a row with a ruler, and"
        f" {action}. If they measure {stated:.2f} mm, a camera has been moved: arrange the cameras"
        " again."
    )
