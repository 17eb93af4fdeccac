"""Command `defsense capture record`: record a device with cameras and read-out board."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..device import device_folder
from ..exit_codes import DONE, STOPPED
from ..options import (
    REFERENCE_OHM,
    add_output_options,
    check_range,
    parse_references,
    parse_twin_cameras,
)
from ..output import print_json

if TYPE_CHECKING:
    from ...capture.sessions.guided_recording import CaptureScreen
    from ...capture.sessions.session import CaptureSession
    from ...twin.live.capture_setup import CaptureOptions
    from ..options import Commands

_CAMERAS = (
    "one per camera of the calibration: 0, /dev/video0; simulated ones (twin:webcam, twin:phone or"
    " twin:industrial, twin:seed=1,cameras=3; twin alone has webcams); or none, if another system"
    " records the markers"
)


def add(steps: Commands) -> None:
    """Add `record` to `capture`."""
    sub = steps.add_parser(
        "record",
        help="Record a device's movement and signals, step by step",
        description="Record a device with calibrated cameras and its read-out board. The screen "
        "shows the next pose, the pictures with the detected tags, the signals, and "
        "how much of each pose was seen. Everything is written immediately, so that "
        "nothing is lost if the program stops. Rerun the command to resume a session.",
        examples=[
            "defsense capture record my-device --cameras 0 2 --calibration cameras.toml"
            " --port /dev/ttyUSB0",
            "defsense capture record my-device --cameras twin --port twin",
        ],
    )
    sub.add_argument(
        "device", type=device_folder, metavar="DEVICE", help="Folder that contains device.toml"
    )
    sub.add_argument(
        "--cameras", nargs="+", required=True, metavar="CAMERA", help=f"Set the cameras, {_CAMERAS}"
    )
    sub.add_argument(
        "--calibration",
        type=Path,
        metavar="TOML",
        help="Set the calibration of the cameras (default: cameras.toml; not needed for a twin)",
    )
    sub.add_argument(
        "--port",
        required=True,
        metavar="PORT",
        help="Set the port of the read-out board: /dev/ttyUSB0, COM3, socket://host:port, "
        "twin, or none (markers only)",
    )
    sub.add_argument(
        "--markers",
        type=Path,
        metavar="JSON",
        help="Set the folder that 'capture markers' wrote, or its markers.json (default: "
        "markers, in the device folder)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="SESSION",
        help="Set the session folder (default: session, in the device folder)",
    )
    sub.add_argument(
        "--rounds",
        type=int,
        default=2,
        metavar="N",
        help="Set the number of rounds through all poses (default: 2)",
    )
    sub.add_argument(
        "--seconds",
        type=float,
        default=8.0,
        metavar="S",
        help="Set the time for each pose in s (default: 8)",
    )
    sub.add_argument(
        "--free",
        type=float,
        default=15.0,
        metavar="S",
        help="Set the time of free movement at the end of each round in s (default: 15)",
    )
    sub.add_argument(
        "--rest",
        type=float,
        default=4.0,
        metavar="S",
        help="Set the time of rest at the start and the end in s (default: 4)",
    )
    sub.add_argument(
        "--reference",
        metavar="OHM,...",
        help="Set the reference resistors of the voltage dividers in ohm, or one for all "
        f"(default: {REFERENCE_OHM:g})",
    )
    sub.add_argument(
        "--rate",
        type=int,
        default=50,
        metavar="HZ",
        help="Set the sampling rate in Hz (default: 50)",
    )
    sub.add_argument(
        "--unit",
        metavar="NAME",
        help="Set the name of the unit, if several devices are built alike",
    )
    sub.add_argument(
        "--video",
        action="store_true",
        help="Keep the pictures too: lossless, about 10 MB per second",
    )
    sub.add_argument("--auto", action="store_true", help="Read no keys: steps follow automatically")
    add_output_options(sub)
    sub.set_defaults(run=_record)


def _record(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device
    from ...core.markers import read_markers
    from ...twin.live.capture_setup import set_up_capture
    from ..terminal.guided_recording import CaptureLines, CaptureTerminal

    for name, low, high in (("rounds", 1, 100), ("seconds", 1, 600), ("free", 0, 600),
                            ("rest", 1, 60), ("rate", 1, 500)):  # fmt: skip
        check_range(f"--{name}", getattr(options, name), low, high)
    device = load_device(options.device)
    markers = read_markers(options.markers or device.source / "markers")
    folder = options.out or device.source / "session"
    with ExitStack() as stack:
        setup = set_up_capture(device, markers, folder, _capture_options(options), stack, _note)
        if options.auto:
            screen: CaptureScreen = CaptureLines()
            done = setup.record(screen, auto=True)
        else:
            with CaptureTerminal() as screen:
                done = setup.record(screen)
    return _print_recorded(options, setup.session, done)


def _capture_options(options: argparse.Namespace) -> CaptureOptions:
    from ...twin.live.capture_setup import CaptureOptions

    word = options.cameras[0]
    simulated = word.partition(":")[0] == "twin"
    given = options.reference
    return CaptureOptions(
        tuple(options.cameras), options.port, options.calibration,
        parse_twin_cameras("--cameras", word) if simulated else None,
        options.rounds, options.seconds, options.free, options.rest, options.rate,
        partial(parse_references, given) if given is not None else None,
        options.unit, options.video,
    )  # fmt: skip


def _note(text: str) -> None:
    sys.stderr.write(f"note: {text}\n")
    sys.stderr.flush()


def _print_recorded(options: argparse.Namespace, session: CaptureSession, done: bool) -> int:
    from ...capture.sessions.session import finished_steps, run_ending, session_summary

    if options.json:
        print_json(session_summary(session))
        return DONE if done else STOPPED
    run = session.runs[-1]
    lines = [
        f"{run}: {run_ending(run)}; {len(finished_steps(session))} of {len(session.steps)} steps"
    ]
    if done:
        lines.append(f"Next:    defsense capture process {session.folder}")
    else:
        lines.append(
            "Next:    rerun the command to resume; defsense capture process"
            f" {session.folder} also accepts incomplete sessions"
        )
    sys.stdout.write("\n".join(lines) + "\n")
    return DONE if done else STOPPED
