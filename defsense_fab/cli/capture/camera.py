"""The commands `defsense capture camera calibrate | arrange`, and the group with `check`."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...workflow.cameras.options import ArrangementOptions, CalibrationOptions, CameraOptions
from ..app import command
from ..output import OutputOptions, print_json, print_lines, progress_bars

if TYPE_CHECKING:
    from ...core.guided_run import Screen

#: Addresses of cameras, one per camera.
Sources = Annotated[tuple[str, ...], Parameter(name="SOURCE")]
Flags = Parameter(name="*", negative=(), consume_multiple=True)
_DEFAULT_CALIBRATION = CalibrationOptions()
_DEFAULT_ARRANGEMENT = ArrangementOptions()
_NO_OUTPUT = OutputOptions()
_MAX_HINTS = 3  # to improve a calibration

camera = command("camera")
_calibrate_command = command(
    "calibrate",
    "defsense capture camera calibrate 0 2 --board my-cameras --name left right",
    "defsense capture camera calibrate a.mkv b.mkv --board my-cameras",
    "defsense capture camera calibrate twin --board my-cameras",
    help="Measure focal length, center and distortion of each camera",
    sort_key=0,
)
_arrange_command = command(
    "arrange",
    "defsense capture camera arrange a.mkv b.mkv --board my-cameras --calibration cameras.toml",
    help="Measure the positions of 2 to 6 cameras",
    sort_key=1,
)
camera.command(_calibrate_command)
camera.command(_arrange_command)
camera.command(
    f"{__package__}.camera_check:check",
    name="check",
    help="Check whether a calibration is still valid",
    sort_key=2,
)


@_calibrate_command.default
def _calibrate(
    sources: Sources,
    /,
    *,
    cameras: Annotated[CameraOptions, Flags],
    options: Annotated[CalibrationOptions, Flags] = _DEFAULT_CALIBRATION,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Calibrate each camera from its own views of the board.

    Hold the board in all parts of the picture, at small and large distances, tilted in every
    direction. Live cameras take a view automatically when the board is still and in a new place,
    and show what is missing. The file lists the cameras by name; a report is written next to it.

    Args:
        sources: Sources, one per camera, or twin (twin:phone,seed=1,cameras=2).
    """
    from ...workflow.cameras.cameras import calibrate_cameras

    print_size_note(cameras, output)
    with progress_bars(output) as progress:
        data = calibrate_cameras(
            sources, cameras, options, open_screen=open_screen, progress=progress
        )
    if output.json:
        print_json(data)
        return
    next_sources = sources[0] if "true_focal" in data[0] else "SOURCE SOURCE"
    print_lines(
        [
            *(line for values in data for line in _describe_lens(values)),
            f"Look at: {cameras.calibration.with_suffix('.html')}",
            f"Next:    defsense capture camera arrange {next_sources} --board {cameras.board}"
            f" --calibration {cameras.calibration}",
        ]
    )


def _describe_lens(data: dict[str, Any]) -> list[str]:
    lines = [
        f"{data['name']}: {data['error']:.3f} px over {data['views'] - data['left_out']} views"
        f" ({data['left_out']} excluded), focal length {data['focal'][0]:.1f} +-"
        f" {data['focal_sigma'][0]:.1f} px, {data['coverage']:.0%} of the image covered",
        *(f"  improvement: {hint}" for hint in data["hints"][:_MAX_HINTS]),
    ]
    if "true_focal" in data:
        true = data["true_focal"][0]
        lines.append(f"  true focal length {true:.1f} px, error {data['focal'][0] / true - 1:+.2%}")
    return lines


@_arrange_command.default
def _arrange(
    sources: Sources,
    /,
    *,
    cameras: Annotated[CameraOptions, Flags],
    options: Annotated[ArrangementOptions, Flags] = _DEFAULT_ARRANGEMENT,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Find the positions of cameras from views of the board that several of them see.

    The positions are written to the calibration file; the first camera is the origin. Videos must
    have been started together. Hold the board still from time to time.

    Args:
        sources: Sources, one per camera, or twin (twin:phone,seed=1,cameras=2).
    """
    from ...workflow.cameras.cameras import arrange_cameras

    print_size_note(cameras, output)
    with progress_bars(output) as progress:
        data = arrange_cameras(
            sources, cameras, options, open_screen=open_screen, progress=progress
        )
    if output.json:
        print_json(data)
        return
    true = [f" (true: {x:.1f} mm)" for x in data.get("true_distances", ())]
    names, notes = data["names"], true or [""] * len(data["names"])
    print_lines(
        [
            f"{data['boards']} boards, {data['error']:.3f} px; error of the board's corners:"
            f" {data['length_error']:.3f} mm",
            *(
                f"{name}: {distance:.1f} mm from {names[0]}{note}, {error:.3f} px"
                for name, distance, note, error in zip(
                    names, data["distances"], notes, data["errors"], strict=True
                )
            ),
            f"frame: {data['frame']}",
            *(f"warning: {w}" for w in data["warnings"]),
            f"Next:    defsense capture camera check {sources[0]} --board {cameras.board}"
            f" --calibration {cameras.calibration}"
            if true
            else "Next:    defsense capture process --videos FILE FILE --calibration"
            f" {cameras.calibration} --tag-size MM",
        ]
    )


def print_size_note(cameras: CameraOptions, output: OutputOptions) -> None:
    """Print a note if the board's printed size was not measured."""
    from ...workflow.cameras.cameras import is_measured

    if not output.json and not is_measured(cameras):
        sys.stderr.write(
            "note: the squares of the board were not measured, so lengths are as accurate as the"
            f" printer. Run: defsense capture board {cameras.board} --measured MM\n"
        )


def open_screen(is_simulated: bool) -> AbstractContextManager[Screen]:
    """Return the screen of live cameras: plain lines for simulated ones without a terminal."""
    from ..terminal.guided_screen import GuidedLines, GuidedTerminal

    has_terminal = sys.stdin.isatty() and sys.stdout.isatty()
    if has_terminal or not is_simulated:
        return GuidedTerminal("give videos or pictures of the board")
    return GuidedLines()
