"""Command `defsense run`: run devices live."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..device import device_folder
from ..options import add_verbose_option, check_range, parse_references
from ..output import print_lines, progress_bars
from .run_end import print_error_line, stop_at_end

if TYPE_CHECKING:
    from ...core.progress import Progress
    from ...runtime.live.live_run import LiveRun, RunOptions
    from ...runtime.outputs.output_allocation import OutputAllocator
    from ..options import Commands

_VIEW = 8080


def add(commands: Commands) -> None:
    """Add `run`."""
    sub = commands.add_parser(
        "run",
        help="Run a device live: show its surface and send its poses to programs",
        description="Read a device's cords and show how it is bent, twisted or pulled: as a moving"
        " surface in the browser (--view), and as named controls for other programs "
        "(--output), one per pose or as formulas. Leave the device at rest for two "
        "seconds at the start. New rubber settles in its first cycles, so move the "
        "device through its poses and let it rest once more. All readings are stored "
        "in the device folder (live/); replay them with --port replay:FILE.",
        examples=[
            "defsense run my-device/model.json --port twin --view",
            "defsense run my-device/model.json --port /dev/ttyUSB0 --view --output osc,port=9000",
            "defsense run my-device/model.json --port /dev/ttyUSB0 --live my-device/live.toml",
            "defsense run a/model.json b/model.json --port /dev/ttyUSB0 /dev/ttyUSB1 --view",
            "defsense run my-device/model.json --port twin:seed=7,cut=left@20-30 --seconds 40",
        ],
    )
    sub.add_argument(
        "models",
        nargs="+",
        type=Path,
        metavar="MODEL",
        help="Model files (model.json), or their folders; several run at once",
    )
    sub.add_argument(
        "--port",
        required=True,
        nargs="+",
        metavar="PORT",
        help="Set the port of each read-out board: /dev/ttyUSB0, COM3, socket://host:port; "
        "replay:board.csv or replay:SESSION (with the tracks of its cameras); or twin "
        "(twin:unit=1,seed=7,minutes=5,cut=left@20-30; cut, short, stuck, or swap=a+b)",
    )
    sub.add_argument(
        "--device",
        nargs="+",
        type=device_folder,
        metavar="DIR",
        help="Set the device folder for each model (default: that of the model)",
    )
    sub.add_argument(
        "--view",
        nargs="?",
        type=int,
        const=_VIEW,
        default=None,
        metavar="PORT",
        help=f"Show the surface in the browser on this port (default: {_VIEW}; following "
        "ports for further devices)",
    )
    sub.add_argument(
        "--no-browser",
        action="store_true",
        help="Print the page's address without opening a browser",
    )
    sub.add_argument(
        "--surface",
        choices=("default", "basis", "arap"),
        default="default",
        help="Choose how the surface is computed: from the simulated states and as rigidly "
        "as possible beyond them (default), or by either method alone (basis, arap)",
    )
    sub.add_argument(
        "--output",
        action="append",
        default=[],
        metavar="KIND,...",
        help="Send to osc, websocket, midi, lsl or gamepad, with its settings "
        "(docs/live-outputs.md); may be repeated",
    )
    sub.add_argument(
        "--live",
        type=Path,
        metavar="TOML",
        help="Read outputs and controls from this live.toml (default: that of the device)",
    )
    sub.add_argument(
        "--rest",
        metavar="OHM,...",
        help="Set the resistances at rest in ohm (default: measured at the start)",
    )
    sub.add_argument(
        "--reference",
        metavar="OHM,...",
        help="Set the reference resistors of the voltage dividers in ohm (default: those of"
        " the training)",
    )
    sub.add_argument(
        "--rate",
        type=int,
        default=100,
        metavar="HZ",
        help="Set the sampling rate in Hz (default: 100)",
    )
    sub.add_argument(
        "--no-fallback", action="store_true", help="Decode with a lost cord as if it were connected"
    )
    sub.add_argument(
        "--record",
        type=Path,
        metavar="FOLDER",
        help="Set the folder for the readings (default: live/TIME in the device folder)",
    )
    sub.add_argument("--no-record", action="store_true", help="Store no readings")
    sub.add_argument(
        "--animation",
        type=Path,
        metavar="FILE",
        help="Record the moving surface to this file: .glb, .usdc or .npz",
    )
    sub.add_argument(
        "--seconds",
        type=float,
        default=None,
        metavar="S",
        help="Stop after this time in s (default: at Ctrl-C)",
    )
    sub.add_argument("--json", action="store_true", help="Print one line of JSON per second")
    add_verbose_option(sub)
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ...core.errors import DeviceError
    from ...runtime.outputs.output_allocation import OutputAllocator
    from ..terminal.live_lines import LiveLines

    count = len(options.models)
    for name, given in (("--port", options.port), ("--device", options.device)):
        if given is not None and len(given) != count:
            raise DeviceError(
                f"has {len(given)} values for {count} models",
                code="count-differs",
                where=name,
                action="Give one for each model",
                option=name,
                count=len(given),
            )
    check_range("--rate", options.rate, 10, 500)
    if options.view is not None:
        check_range("--view", options.view, 1024, 65535 - count)
    if options.seconds is not None:
        check_range("--seconds", options.seconds, 0.1, 1e7)
    runs: list[LiveRun] = []
    with stop_at_end(runs, options):
        with progress_bars(options) as progress:
            allocator = OutputAllocator()
            for k in range(count):  # if one fails, those before are stopped
                runs += [_prepare(options, k, progress, allocator)]
        for run in runs:
            run.loop.start()
        with LiveLines(runs, as_json=options.json) as lines:
            _announce(runs, options)
            if options.view is not None and not options.no_browser:
                _open_pages(runs)
            lines.follow(options.seconds)
    return 0


def _prepare(
    options: argparse.Namespace, k: int, progress: Progress, allocator: OutputAllocator
) -> LiveRun:
    from ...runtime.live.live_device import live_device
    from ...runtime.live.live_run import live_run

    folder = options.device[k] if options.device else None
    live = live_device(options.models[k], folder)
    run_options = _run_options(
        options, k, len(live.board_channels), live.device.source if live.device else None
    )
    live = replace(live, model=replace(live.model, device=allocator.unique_name(live.model.device)))
    run_options = replace(run_options, outputs=allocator.allocate(run_options.outputs))
    return live_run(live, run_options, progress)


def _run_options(
    options: argparse.Namespace, k: int, channels: int, device: Path | None
) -> RunOptions:
    import numpy as np

    from ...runtime.live.live_run import RunOptions
    from ...runtime.outputs.live_file import LiveSettings, parse_output, read_live_file

    path = options.live
    if path is None and device is not None and (device / "live.toml").exists():
        path = device / "live.toml"
    settings = read_live_file(path) if path is not None else LiveSettings()
    resistances = {
        name: None if text is None else np.array(parse_references(text, channels, f"--{name}"))
        for name, text in (("rest", options.rest), ("reference", options.reference))
    }
    return RunOptions(
        port=options.port[k], rate=options.rate,
        reference=resistances["reference"], rest=resistances["rest"],
        view=None if options.view is None else options.view + k,
        outputs=(*settings.outputs, *(parse_output(text) for text in options.output)),
        controls=settings.controls, surface=options.surface, fallback=not options.no_fallback,
        keep=not options.no_record,
        record=own_folder(options.record, k), animation=own_file(options.animation, k),
        live_file=path,
    )  # fmt: skip


def own_file(path: Path | None, k: int) -> Path | None:
    """Return the file of device `k`: x.glb for the first, then x-2.glb and so on."""
    return path if path is None or not k else path.parent / f"{path.stem}-{k + 1}{path.suffix}"


def own_folder(path: Path | None, k: int) -> Path | None:
    """Return the folder of device `k`, numbered like files; inside `.` and `..`, a subfolder."""
    if path is None or not k:
        return path
    inside = path.name in ("", "..")
    return path / f"{k + 1}" if inside else path.with_name(f"{path.name}-{k + 1}")


def _announce(runs: Sequence[LiveRun], options: argparse.Namespace) -> None:
    """Print addresses and notes at the start; on standard error with --json."""
    for run in runs:
        lines = [f"note: {note}" for note in run.notes]
        if run.view is not None:
            lines.append(f"View:    {run.view.url}")
        for output in run.outputs:
            output.wait_until_tried(2.0)
            lines.append(f"Output:  {output.trouble or output.about}")
        if run.surface:
            lines.append(f"Surface: {run.surface}")
        if run.recording is not None:
            is_started = run.recording.wait_until_started(2.0)
            state = "" if is_started else " (starts with the first sample)"
            lines.append(f"Record:  {run.recording.path}{state}")
        if run.animations is not None and run.animations.recording is not None:
            lines.append(f"Record:  {run.animations.recording} (animation, written at the end)")
        if options.json:
            for line in lines:
                print_error_line(line)
        else:
            print_lines(lines)
    if not options.json:
        print_lines(["Press Ctrl-C to stop."])
    sys.stdout.flush()


def _open_pages(runs: Sequence[LiveRun]) -> None:
    import webbrowser

    for run in runs:
        if run.view is not None:
            webbrowser.open(run.view.url)
