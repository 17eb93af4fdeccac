"""The command `defsense capture record`, and processing what it recorded."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import CaptureError, DefsenseError, DeviceError
from .options import REFERENCE, references, twin_values, within

if TYPE_CHECKING:
    from ..capture.cameras.webcam import Images, Webcam
    from ..core.device import Device
    from ..core.markers import Markers
    from ..pipeline.sessions.guided_recording import CaptureScreen
    from ..pipeline.sessions.session import CaptureSession
    from ..pipeline.twin.live_twin import LiveTwin
    from .options import Commands

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
    sub.add_argument("device", type=Path, metavar="DEVICE", help="folder with device.toml")
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
    from ..core.device_file import load_device
    from ..core.markers import read_markers

    for name, low, high in (("rounds", 1, 100), ("seconds", 1, 600), ("free", 0, 600),
                            ("rest", 1, 60), ("rate", 1, 500)):  # fmt: skip
        within(f"--{name}", getattr(options, name), low, high)
    device = load_device(options.device)
    markers = read_markers(options.markers or device.source / "markers")
    folder = options.out or device.source / "session"
    if options.cameras == ["none"] and options.port == "none":
        raise DeviceError("--cameras none --port none: there would be nothing to record")
    simulated = options.cameras[0].partition(":")[0] == "twin" or options.port == "twin"
    with ExitStack() as stack:
        twin = _twin(options, device, markers, stack) if simulated else None
        done, session = _run(options, device, markers, folder, twin)
    return _told(options, session, done)


def _twin(
    options: argparse.Namespace, device: Device, markers: Markers, stack: ExitStack
) -> LiveTwin:
    """The twin. Raises DeviceError where only one of cameras and read-out board is one."""
    from ..pipeline.twin.live_twin import start_live_twin

    word = options.cameras[0]
    others = len(options.cameras) > 1
    if word.partition(":")[0] != "twin" or others or options.port not in ("twin", "none"):
        raise DeviceError(
            "a twin has its own cameras and read-out board: give --cameras twin --port twin"
        )
    seed, count, kind = twin_values("--cameras", word)
    twin = start_live_twin(device, markers, seed, count, kind=kind)
    stack.callback(twin.close)
    return twin


def _run(
    options: argparse.Namespace,
    device: Device,
    markers: Markers,
    folder: Path,
    twin: LiveTwin | None,
) -> tuple[bool, CaptureSession]:
    """Record; whether the session is finished, and the session."""
    import numpy as np

    from ..capture.cameras.webcam import Webcam
    from ..capture.clocks.led_schedule import LED_PERIOD
    from ..capture.readout.reader import Settings
    from ..capture.tags.tag_dictionary import dictionary
    from ..pipeline.artifacts.session_manifest import manifest_path
    from ..pipeline.sessions import session as sessions
    from ..pipeline.sessions.guided_recording import GuidedRecording
    from ..pipeline.tracking.detector_compilation import compile_detector
    from ..pipeline.twin.live_twin import levels_of
    from ..pipeline.twin.sample_sources import open_source
    from ..terminal.guided_recording import CaptureLines, CaptureTerminal

    begun = manifest_path(folder) is not None
    if begun:
        session = sessions.load(folder)
        if session.device != device.name:
            raise CaptureError(
                f"{folder}: is a session of {session.device}, not of {device.name}; choose another"
                " folder with --out"
            )
        if options.unit is not None and options.unit != session.unit:
            raise CaptureError(
                f"{folder}: is a session of the unit {session.unit!r}, not of {options.unit!r};"
                " choose another folder with --out"
            )
        if not np.array_equal(session.markers.ids, markers.ids) or not np.allclose(
            session.markers.centers, markers.centers
        ):
            raise CaptureError(
                f"{folder}: was begun with other tags than the device has now; begin another"
                " session with --out"
            )
        if len(sessions.finished(session)) == len(session.steps):
            raise CaptureError(
                f"{folder}: this session is finished; process it (defsense capture process"
                f" {folder}), or begin another with --out"
            )
    else:
        session = _begin(options, device, markers, folder, twin)
    try:
        openers = _openers(options.cameras, session, twin, Webcam)
        board = None
        if options.port != "none":
            settings = Settings(channels=len(session.channels), rate=options.rate, led=LED_PERIOD)
            port = twin.port() if twin is not None else options.port
            board = open_source(port, settings).source
        if session.rig.cameras:  # before a screen is there, and the first pictures come
            tags = dictionary(session.markers.dictionary)
            compile_detector(session.rig.cameras[0], tags, _note)
        levels = levels_of(device, session.markers)
        hands = twin.perform if twin is not None else None
        if options.auto:
            screen: CaptureScreen = CaptureLines()
            done = GuidedRecording(session, openers, board, screen, levels, auto=True,
                             video=options.video, hands=hands).run()  # fmt: skip
        else:
            with CaptureTerminal() as screen:
                done = GuidedRecording(session, openers, board, screen, levels, video=options.video,
                                 hands=hands).run()  # fmt: skip
    except DefsenseError:
        if not begun:
            sessions.discard_empty(session)
        raise
    return done, session


def _begin(
    options: argparse.Namespace, device: Device, markers: Markers, folder: Path,
    twin: LiveTwin | None,
) -> CaptureSession:  # fmt: skip
    """A new session."""
    from ..core.errors import CaptureError
    from ..pipeline.artifacts.build_folder import build_folder
    from ..pipeline.artifacts.layout import LAYOUT, layout_hash, load_layout
    from ..pipeline.sessions import session as sessions
    from ..pipeline.twin.live_twin import known_cameras

    built = build_folder(device)
    if (built / LAYOUT).exists():
        layout = load_layout(built, CaptureError)
        channels: Sequence[str] = [cord.name for cord in layout.by_channel()]
        known_layout = layout_hash(layout)
    else:
        channels, known_layout = [s.name for s in device.sensors], ""
    if options.port == "none":
        channels = []
    reference = references(options.reference or f"{REFERENCE:g}", max(len(channels), 1))
    if twin is not None and options.reference is None:
        reference = [twin.extra["reference"]] * max(len(channels), 1)
    calibration = options.calibration or Path("cameras.toml")
    if options.cameras == ["none"]:
        calibration = None
    if twin is not None and options.calibration is None:
        calibration = device.source / "twin-cameras.toml"
        known_cameras(twin, calibration)
    return sessions.create(
        folder, device=device.name,
        steps=sessions.plan([p.name for p in device.poses], options.rounds, options.seconds,
                            options.free, options.rest),
        channels=channels, reference=reference[: len(channels)], calibration=calibration,
        markers=markers, unit=_unit(options), layout=known_layout,
    )  # fmt: skip


def _unit(options: argparse.Namespace) -> str:
    """The name of the built device; a twin's seed makes another one."""
    if options.unit is None and options.port == "twin":
        return f"twin-{twin_values('--cameras', options.cameras[0])[0]}"
    return options.unit or ""


def _openers(
    words: Sequence[str], session: CaptureSession, twin: LiveTwin | None, webcam: type[Webcam]
) -> list[Callable[[], Images]]:
    cameras = session.rig.cameras
    if words == ["none"] and not cameras:
        return []
    if twin is not None:
        if len(twin.sources) != len(cameras):
            raise CaptureError(
                f"{session.folder}: was begun with {len(cameras)} cameras; give --cameras"
                f" twin:cameras={len(cameras)}"
            )
        return [partial(_given, s) for s in twin.sources]
    if len(words) != len(cameras):
        names = ", ".join(c.name for c in cameras)
        raise CaptureError(
            f"the calibration has {len(cameras)} cameras ({names}), --cameras names {len(words)};"
            " give one for each, in this order"
        )
    if not session.rig.placed:
        raise CaptureError(
            "the calibration does not say where the cameras stand; run 'defsense capture camera"
            " arrange'"
        )
    return [partial(webcam, w, c.size) for w, c in zip(words, cameras, strict=True)]


def _note(text: str) -> None:
    sys.stderr.write(f"note: {text}\n")
    sys.stderr.flush()


def _given(source: Images) -> Images:
    return source


def _told(options: argparse.Namespace, session: CaptureSession, done: bool) -> int:
    from ..pipeline.sessions.session import as_mapping, ending, finished

    if options.json:
        sys.stdout.write(json.dumps(as_mapping(session), indent=1) + "\n")
        return 0
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
    return 0
