"""Command `defsense twin`: simulate training sessions."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ..device import add_device_arguments, parse_overrides
from ..options import check_range, parse_twin_cameras
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...twin.devices.twin_traits import TwinTraits
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `twin`."""
    sub = commands.add_parser(
        "twin",
        help="Simulate training sessions of a device without hardware",
        description="Simulate a built device that a hand moves, its cords, its read-out board and "
        "its markers. Write sessions in the format of 'capture process', with the true"
        " values (truth.npz) and all assumptions (assumptions.md). The device is "
        "solved again, with a finer mesh and another material law. This takes minutes "
        "the first time; the result is stored in its build.",
        examples=[
            "defsense twin my-device",
            "defsense twin my-device --minutes 20 --sessions 3 --unit 2 --off drift,mullins",
            "defsense twin my-device --minutes 5 --cameras webcam",
        ],
    )
    add_device_arguments(sub)
    sub.add_argument(
        "--minutes",
        type=float,
        default=10.0,
        metavar="M",
        help="Set the duration of each session in minutes (default: 10)",
    )
    sub.add_argument(
        "--sessions",
        type=int,
        default=1,
        metavar="N",
        help="Set the number of sessions of the same unit, one day apart (default: 1)",
    )
    sub.add_argument(
        "--seed",
        type=int,
        default=1,
        metavar="N",
        help="Set the random seed of the hand's path (default: 1)",
    )
    sub.add_argument(
        "--unit",
        type=int,
        default=1,
        metavar="N",
        help="Choose the built unit, with its tolerances and pieces of cord (default: 1)",
    )
    sub.add_argument(
        "--off",
        default="",
        metavar="TRAIT,...",
        help="Turn these traits off; --list-assumptions lists their names",
    )
    sub.add_argument(
        "--wrong",
        type=float,
        default=None,
        metavar="SHARE",
        help="Set the share of wrong marker positions (default: 0)",
    )
    sub.add_argument(
        "--grips",
        type=int,
        default=0,
        metavar="N",
        help="Set the number of places that are pulled in addition to the poses, at most 4 "
        "(default: 0)",
    )
    sub.add_argument(
        "--cameras",
        metavar="KIND,...",
        help="Film the device with rendered cameras, webcam, phone or industrial (such as "
        "webcam,cameras=3), and process the session like a recorded one; takes some "
        "minutes per minute of the session (default: markers with noise, without "
        "pictures)",
    )
    sub.add_argument(
        "--rate",
        type=float,
        default=15.0,
        metavar="HZ",
        help="Set the frame rate of rendered cameras in Hz (default: 15)",
    )
    sub.add_argument(
        "--markers",
        type=Path,
        metavar="JSON",
        help="Use the tags of 'capture markers' instead of [outputs] markers; rendered "
        "cameras need them (default: markers, in the device folder)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="Set the session folder (default: twin-UNIT-SEED, in the device folder)",
    )
    sub.add_argument(
        "--list-assumptions",
        action="store_true",
        help="Print every assumed number with its source, and exit",
    )
    sub.set_defaults(run=_twin)


def _twin(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from ...core.device.device_file import load_device
    from ...core.errors import DeviceError
    from ...core.markers import read_markers

    check_range("--minutes", options.minutes, 0.2, 240)
    check_range("--sessions", options.sessions, 1, 100)
    check_range("--grips", options.grips, 0, 4)
    for name in ("seed", "unit"):
        check_range(f"--{name}", getattr(options, name), 0, 1_000_000_000)
    device = load_device(options.folder, parse_overrides(options.set))
    from ...twin.devices.twin_traits import TwinTraits

    off = [name.strip() for name in options.off.split(",") if name.strip()]
    traits = TwinTraits.for_device(device)
    if options.wrong is not None:
        check_range("--wrong", options.wrong, 0, 0.5)
        traits = replace(traits, markers=replace(traits.markers, wrong=options.wrong))
    if options.cameras:
        from ...twin.devices.twin_traits import FilmTraits

        check_range("--rate", options.rate, 5, 60)
        if "seed" in options.cameras:
            raise DeviceError(
                f"{options.cameras} contains a seed",
                code="options-conflict",
                where="--cameras",
                action="Set the seed with --seed",
            )
        _, count, kind = parse_twin_cameras("--cameras", f"twin:{options.cameras}")
        traits = replace(traits, film=FilmTraits(kind, count, options.rate))
    traits.disable_traits(off)
    if options.list_assumptions:
        return _print_assumptions(traits.disable_traits(off), options)
    from ...capture.sessions.results import QUALITY
    from ...twin.recordings.twin_recordings import simulate_runs
    from ...workflow.sessions.twin_sessions import (
        ASSUMPTIONS,
        check_free,
        session_folder,
        write_sessions,
    )

    out = options.out or session_folder(device, options.unit, options.seed)
    check_free(out, options.sessions)
    tags = options.markers or (device.source / "markers" if options.cameras else None)
    markers = read_markers(tags) if tags else None
    with silent_stdout(), progress_bars(options) as progress:
        simulated = simulate_runs(
            device, seconds=60 * options.minutes, sessions=options.sessions, seed=options.seed,
            unit=options.unit, off=off, traits=traits, markers=markers, grip_count=options.grips,
            progress=progress,
        )  # fmt: skip
        folders = write_sessions(out, device, simulated, progress)
    qualities = [(f / QUALITY).read_text(encoding="utf-8") for f in folders]
    frames = sum(int(json.loads(text)["frames"]) for text in qualities)
    data = {
        "sessions": [str(f) for f in folders], "frames": frames,
        "channels": list(simulated.dataset.channels), "markers": len(simulated.dataset.ids),
        "states": len(simulated.fields.space.states), "interpolation_mm": simulated.fields.error,
        "interpolation_signal": simulated.fields.signal_error,
        "warnings": list(simulated.fields.warnings),
        **{k: simulated.dataset.provenance[k] for k in ("unit", "seed", "off")},
    }  # fmt: skip
    with standard_output():
        if options.json:
            print_json(data)
        else:
            print_lines(f"note: {w}" for w in simulated.fields.warnings)
            print_lines([
                f"{frames} pictures of {len(simulated.dataset.ids)} markers,"
                f" {len(simulated.dataset.channels)} cords; shapes interpolated between"
                f" {data['states']} solved states, error {simulated.fields.error:.2g} mm when"
                " one is omitted",
                f"Look at: {folders[0] / ASSUMPTIONS}",
                f"Next:    defsense train {quote(str(folders[0]))} --device"
                f" {quote(str(options.folder))}",
            ])  # fmt: skip
    return 0


def _print_assumptions(traits: TwinTraits, options: argparse.Namespace) -> int:
    with standard_output():
        if options.json:
            print_json([vars(a) for a in traits.assumptions])
            return 0
        from rich.table import Table

        table = Table(title=f"Traits for --off: {', '.join(traits.names)}")
        for column in ("trait", "number", "value", "unit", "meaning", "source"):
            table.add_column(column)
        for a in traits.assumptions:
            table.add_row(a.trait, a.name, str(a.value), a.unit, a.meaning, a.source)
        console().print(table)
    return 0
