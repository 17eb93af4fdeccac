"""The command `defsense twin`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ..device import device_arguments, overrides
from ..options import twin_values, within
from ..output import console, progress_bars, results, say, silent_stdout

if TYPE_CHECKING:
    from ...twin.devices.twin_traits import TwinTraits
    from ..options import Commands


def add(commands: Commands) -> None:
    """`twin`."""
    sub = commands.add_parser(
        "twin",
        help="training sessions of a device without hardware",
        description="Simulate a built device that is moved by a hand, its cords, its read-out board"
        " and its markers, and write sessions as 'capture process' leaves them, with the truth"
        " beside them (truth.npz) and all that was taken for granted (assumptions.md). The device"
        " is solved afresh, finer and by another material law, which takes minutes the first time"
        " and is kept in its build.",
        examples=[
            "defsense twin my-device",
            "defsense twin my-device --minutes 20 --sessions 3 --unit 2 --off drift,mullins",
            "defsense twin my-device --minutes 5 --cameras webcam",
        ],
    )
    device_arguments(sub)
    sub.add_argument("--minutes", type=float, default=10.0, metavar="M",
                     help="of each session (10)")  # fmt: skip
    sub.add_argument("--sessions", type=int, default=1, metavar="N",
                     help="of the same built device, a day apart (1)")  # fmt: skip
    sub.add_argument("--seed", type=int, default=1, metavar="N", help="of the hand's way (1)")
    sub.add_argument("--unit", type=int, default=1, metavar="N",
                     help="which built device: its tolerances and pieces of cord (1)")  # fmt: skip
    sub.add_argument("--off", default="", metavar="TRAIT,...",
                     help="traits to switch off; --list-assumptions names them")  # fmt: skip
    sub.add_argument("--wrong", type=float, default=None, metavar="SHARE",
                     help="of the markers' places that are wrong (0)")  # fmt: skip
    sub.add_argument("--grips", type=int, default=0, metavar="N",
                     help="places that are pulled at besides the poses, at most 4 (0)")  # fmt: skip
    sub.add_argument(
        "--cameras", metavar="KIND,...",
        help="film it with rendered cameras, webcam, phone or industrial (webcam,cameras=3), and"
        " process the session as a recorded one; some minutes for each of the session's. Left out,"
        " markers are seen by cameras that are numbers alone",
    )  # fmt: skip
    sub.add_argument("--rate", type=float, default=15.0, metavar="HZ",
                     help="pictures a second of rendered cameras (15)")  # fmt: skip
    sub.add_argument("--markers", type=Path, metavar="JSON",
                     help="tags of 'capture markers' in place of [outputs] markers; rendered"
                     " cameras need them (markers, in the device's folder)")  # fmt: skip
    sub.add_argument("--out", type=Path, metavar="DIR",
                     help="the session's folder (twin-UNIT-SEED, in the device's)")  # fmt: skip
    sub.add_argument("--list-assumptions", action="store_true",
                     help="print every number with its source, and do no more")  # fmt: skip
    sub.set_defaults(run=_twin)


def _twin(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from ...core.device.device_file import load_device
    from ...core.errors import DeviceError
    from ...core.markers import read_markers

    within("--minutes", options.minutes, 0.2, 240)
    within("--sessions", options.sessions, 1, 100)
    within("--grips", options.grips, 0, 4)
    for name in ("seed", "unit"):
        within(f"--{name}", getattr(options, name), 0, 1_000_000_000)
    device = load_device(options.folder, overrides(options.set))
    from ...twin.devices.twin_traits import TwinTraits

    off = [name.strip() for name in options.off.split(",") if name.strip()]
    traits = TwinTraits.for_device(device)
    if options.wrong is not None:
        within("--wrong", options.wrong, 0, 0.5)
        traits = replace(traits, markers=replace(traits.markers, wrong=options.wrong))
    if options.cameras:
        from ...twin.devices.twin_traits import FilmTraits

        within("--rate", options.rate, 5, 60)
        if "seed" in options.cameras:
            raise DeviceError(f"--cameras {options.cameras}: the seed is given with --seed")
        _, count, kind = twin_values("--cameras", f"twin:{options.cameras}")
        traits = replace(traits, film=FilmTraits(kind, count, options.rate))
    traits.disable_traits(off)
    if options.list_assumptions:
        return _list(traits.disable_traits(off), options)
    from ...capture.sessions.result_files import QUALITY
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
        made = simulate_runs(
            device, seconds=60 * options.minutes, sessions=options.sessions, seed=options.seed,
            unit=options.unit, off=off, traits=traits, markers=markers, grip_count=options.grips,
            progress=progress,
        )  # fmt: skip
        folders = write_sessions(out, device, made, progress)
    qualities = [(f / QUALITY).read_text(encoding="utf-8") for f in folders]
    frames = sum(int(json.loads(text)["frames"]) for text in qualities)
    data = {
        "sessions": [str(f) for f in folders], "frames": frames,
        "channels": list(made.dataset.channels), "markers": len(made.dataset.ids),
        "states": len(made.fields.space.states), "interpolation_mm": made.fields.error,
        "interpolation_signal": made.fields.signal_error, "warnings": list(made.fields.warnings),
        **{k: made.dataset.provenance[k] for k in ("unit", "seed", "off")},
    }  # fmt: skip
    with results():
        if options.json:
            sys.stdout.write(json.dumps(data, indent=1) + "\n")
        else:
            say(f"note: {w}" for w in made.fields.warnings)
            say([
                f"{frames} pictures of {len(made.dataset.ids)} markers,"
                f" {len(made.dataset.channels)} cords; shapes between {data['states']} solved"
                f" states, within {made.fields.error:.2g} mm where one is left out",
                f"Look at: {folders[0] / ASSUMPTIONS}",
                f"Next:    defsense train {quote(str(folders[0]))} --device"
                f" {quote(str(options.folder))}",
            ])  # fmt: skip
    return 0


def _list(traits: TwinTraits, options: argparse.Namespace) -> int:
    with results():
        if options.json:
            sys.stdout.write(json.dumps([vars(a) for a in traits.assumptions], indent=1) + "\n")
            return 0
        from rich.table import Table

        table = Table(title=f"--off takes {', '.join(traits.names)}")
        for column in ("trait", "number", "value", "unit", "meaning", "source"):
            table.add_column(column)
        for a in traits.assumptions:
            table.add_row(a.trait, a.name, str(a.value), a.unit, a.meaning, a.source)
        console().print(table)
    return 0
