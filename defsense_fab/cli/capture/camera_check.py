"""The command `defsense capture camera check`: is a calibration still valid?"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...workflow.cameras.options import CameraOptions, CheckOptions
from ..app import command
from ..exit_codes import DONE, NO
from ..output import OutputOptions, print_json, print_lines, progress_bars
from .camera import Flags, Sources, open_screen, print_size_note

if TYPE_CHECKING:
    from ...workflow.cameras.cameras import CameraCheck

_DEFAULTS = CheckOptions()
_NO_OUTPUT = OutputOptions()

check = command("check", "defsense capture camera check a.mkv b.mkv --board my-cameras")


@check.default
def _check(
    sources: Sources,
    /,
    *,
    cameras: Annotated[CameraOptions, Flags],
    options: Annotated[CheckOptions, Flags] = _DEFAULTS,
    output: OutputOptions = _NO_OUTPUT,
) -> int:
    """View the board with calibrated cameras and report whether the calibration is still valid.

    The exit code is 1 if it is not.

    Args:
        sources: Sources, one per camera, or twin (twin:phone,seed=1,cameras=2).
    """
    from ...workflow.cameras.cameras import check_cameras

    print_size_note(cameras, output)
    with progress_bars(output) as progress:
        result = check_cameras(
            sources, cameras, options, open_screen=open_screen, progress=progress
        )
    if output.json:
        print_json(_plain(result))
    else:
        print_lines(describe_check(result, cameras.board))
    return DONE if result.is_valid else NO


def _plain(result: CameraCheck) -> dict[str, Any]:
    check, cause = result.diagnosis.check, result.diagnosis.cause
    return {
        "holds": check.holds,
        "own": [_finite(x) for x in check.camera_errors],
        "boards": check.boards,
        "together": _finite(check.ray_error),
        "length": _finite(check.corner_error),
        "cause": cause and cause.kind,
        "square": cause and cause.square,
        "order": result.source_order,
    }


def _finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def describe_check(result: CameraCheck, board: Path) -> list[str]:
    """Return lines on the errors of cameras, and on what to do if their calibration is not valid.

    Args:
        result: The check.
        board: Path of the board, for the commands to run.
    """
    check, names = result.diagnosis.check, result.diagnosis.names
    errors = ", ".join(
        f"{name} {f'{x:.2f} px' if isfinite(x) else 'does not see the board'}"
        for name, x in zip(names, check.camera_errors, strict=True)
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
    if result.is_valid:
        return [*lines, "The calibration is valid."]
    return [*lines, f"The calibration is not valid: {_describe_cause(result, board)}"]


def _describe_cause(result: CameraCheck, board: Path) -> str:
    cause = result.diagnosis.cause
    assert cause is not None
    if cause.kind == "order" and result.source_order is not None:
        order = result.source_order
        pairs = zip(order, result.diagnosis.names, strict=True)
        text = (
            f"the sources are swapped: {', '.join(f'{s} is camera {n}' for s, n in pairs)}. Give"
            f" them in this order: {' '.join(order)}."
        )
        return f"{text} In addition, {_describe_size(result, board)}" if cause.square else text
    if cause.kind == "board":
        return _describe_size(result, board)
    if cause.kind == "lens":
        return (
            f"zoom, focus or resolution of {' and '.join(result.inaccurate_cameras)} has changed."
            " Calibrate again, then arrange."
        )
    moved = result.moved_cameras
    camera = f"camera {moved[0]}" if len(moved) == 1 else "a camera"
    return f"{camera} has been moved. Arrange the cameras again."


def _describe_size(result: CameraCheck, board: Path) -> str:
    """Describe squares whose size differs from the stated one."""
    cause, stated = result.diagnosis.cause, result.stated_square
    assert cause is not None
    if result.is_board_plausible:
        action = f"store it: defsense capture board {board} --measured MM"
    else:  # the difference is larger than a printer causes
        action = (
            "print the board again at 100 %, or describe this one: defsense capture board"
            f" {board} --printed --square MM"
        )
    return (
        f"the cameras measure squares of {cause.square:.2f} mm on the printed board, but"
        f" {stated:.2f} mm is stated; everything else agrees. Measure several squares in a row with"
        f" a ruler, and {action}. If they measure {stated:.2f} mm, a camera has been moved: arrange"
        " the cameras again."
    )
