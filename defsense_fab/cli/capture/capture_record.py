"""The command `defsense capture record`, and processing what it recorded."""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..device import device_folder
from ..exit_codes import DONE, STOPPED
from ..options import REFERENCE, references, twin_values, within

if TYPE_CHECKING:
    from ...capture.sessions.guided_recording import CaptureScreen
    from ...capture.sessions.session import CaptureSession
    from ...twin.live.capture_setup import CaptureOptions
    from ..options import Commands

_CAMERAS = (
    "one for each of the calibration: 0, /dev/video0; a twin's (twin:webcam, twin:phone or"
    " twin:industrial, twin:seed=1,cameras=3; twin alone has webcams); or none, where another"
    " system records the markers"
)


def add(steps: Commands) -> None:
    """Add `record` to the commands of `capture`."""
    sub = steps.add_parser(
        "record",
        help="record a device's movement and signals, step by step",
        description="Record a device before calibrated cameras, with its read-out board: says"
        " which pose is next, shows the pictures with the tags found, the signals, and how much of"
        " each pose was seen. Everything is written as it comes, so that nothing is lost when the"
        " program dies;"
        " the same command goes on with a session that was stopped.",
        examples=[
            "defsense capture record my-device --cameras 0 2 --calibration cameras.toml"
            " --port /dev/ttyUSB0",
            "defsense capture record my-device --cameras twin --port twin",
        ],
    )
    sub.add_argument("device", type=device_folder, metavar="DEVICE", help="folder with device.toml")
    sub.add_argument("--cameras", nargs="+", required=True, metavar="CAMERA", help=_CAMERAS)
    sub.add_argument("--calibration", type=Path, metavar="TOML",
                     help="of the cameras (cameras.toml; a twin's are known)")  # fmt: skip
    sub.add_argument(
        "--port", required=True, metavar="PORT",
        help="of the read-out board: /dev/ttyUSB0, COM3, socket://host:port, twin, or none"
        " (markers alone)",
    )  # fmt: skip
    sub.add_argument(
        "--markers", type=Path, metavar="JSON",
        help="what 'capture markers' wrote (markers, in the device's folder)",
    )  # fmt: skip
    sub.add_argument("--out", type=Path, metavar="SESSION",
                     help="the session's folder (session, in the device's)")  # fmt: skip
    sub.add_argument("--rounds", type=int, default=2, metavar="N", help="through all poses (2)")
    sub.add_argument("--seconds", type=float, default=8.0, metavar="S", help="for each pose (8)")
    sub.add_argument("--free", type=float, default=15.0, metavar="S",
                     help="of free movement at the end of each round (15)")  # fmt: skip
    sub.add_argument("--rest", type=float, default=4.0, metavar="S",
                     help="of rest at the beginning and the end (4)")  # fmt: skip
    sub.add_argument("--reference", metavar="OHM,...", help="of the dividers, or one for all"
                     f" ({REFERENCE:g})")  # fmt: skip
    sub.add_argument("--rate", type=int, default=50, metavar="HZ", help="samples per second (50)")
    sub.add_argument("--unit", metavar="NAME", help="which device this is, of several built alike")
    sub.add_argument("--video", action="store_true",
                     help="keep the pictures, too: lossless, some 10 MB a second")  # fmt: skip
    sub.add_argument("--auto", action="store_true", help="take no keys: steps follow by themselves")
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_record)


def _record(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device
    from ...core.markers import read_markers
    from ...twin.live.capture_setup import set_up_capture
    from ..terminal.guided_recording import CaptureLines, CaptureTerminal

    for name, low, high in (("rounds", 1, 100), ("seconds", 1, 600), ("free", 0, 600),
                            ("rest", 1, 60), ("rate", 1, 500)):  # fmt: skip
        within(f"--{name}", getattr(options, name), low, high)
    device = load_device(options.device)
    markers = read_markers(options.markers or device.source / "markers")
    folder = options.out or device.source / "session"
    with ExitStack() as stack:
        setup = set_up_capture(device, markers, folder, _asked(options), stack, _note)
        if options.auto:
            screen: CaptureScreen = CaptureLines()
            done = setup.record(screen, auto=True)
        else:
            with CaptureTerminal() as screen:
                done = setup.record(screen)
    return _told(options, setup.session, done)


def _asked(options: argparse.Namespace) -> CaptureOptions:
    from ...twin.live.capture_setup import CaptureOptions

    word = options.cameras[0]
    simulated = word.partition(":")[0] == "twin"
    given = options.reference
    return CaptureOptions(
        tuple(options.cameras), options.port, options.calibration,
        twin_values("--cameras", word) if simulated else None,
        options.rounds, options.seconds, options.free, options.rest, options.rate,
        partial(references, given) if given is not None else None, options.unit, options.video,
    )  # fmt: skip


def _note(text: str) -> None:
    sys.stderr.write(f"note: {text}\n")
    sys.stderr.flush()


def _told(options: argparse.Namespace, session: CaptureSession, done: bool) -> int:
    from ...capture.sessions.session import as_mapping, ending, finished

    if options.json:
        sys.stdout.write(json.dumps(as_mapping(session), indent=1) + "\n")
        return DONE if done else STOPPED
    run = session.runs[-1]
    lines = [f"{run}: {ending(run)}; {len(finished(session))} of {len(session.steps)} steps"]
    if done:
        lines.append(f"Next:    defsense capture process {session.folder}")
    else:
        lines.append(
            "Next:    the same command goes on; or defsense capture process"
            f" {session.folder} takes what there is"
        )
    sys.stdout.write("\n".join(lines) + "\n")
    return DONE if done else STOPPED
