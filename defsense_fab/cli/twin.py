"""The command `defsense twin`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from .device import device_arguments, overrides
from .options import within
from .output import console, progress_bars, results, say, silent_stdout

if TYPE_CHECKING:
    from ..pipeline.twin.twin_traits import TwinTraits
    from .options import Commands


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
    sub.add_argument("--markers", type=Path, metavar="JSON",
                     help="tags of 'capture markers' in place of [outputs] markers")  # fmt: skip
    sub.add_argument("--out", type=Path, metavar="FOLDER",
                     help="the session's folder (twin-UNIT-SEED, in the device's)")  # fmt: skip
    sub.add_argument("--list-assumptions", action="store_true",
                     help="print every number with its source, and do no more")  # fmt: skip
    sub.set_defaults(run=_twin)


def _twin(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from ..core.device_file import load_device
    from ..core.markers import read_markers

    within("--minutes", options.minutes, 0.2, 240)
    within("--sessions", options.sessions, 1, 100)
    within("--grips", options.grips, 0, 4)
    for name in ("seed", "unit"):
        within(f"--{name}", getattr(options, name), 0, 1_000_000_000)
    device = load_device(options.folder, overrides(options.set))
    from ..pipeline.twin.twin_traits import TwinTraits

    off = [name.strip() for name in options.off.split(",") if name.strip()]
    traits = TwinTraits.of(device)
    if options.wrong is not None:
        within("--wrong", options.wrong, 0, 0.5)
        traits = replace(traits, markers=replace(traits.markers, wrong=options.wrong))
    traits.without(off)
    if options.list_assumptions:
        return _list(traits.without(off), options)
    from ..pipeline.twin.twin_recordings import simulate_runs
    from ..pipeline.twin.twin_session import ASSUMPTIONS, check_free, write_sessions

    out = options.out or device.source / f"twin-{options.unit}-{options.seed}"
    check_free(out, options.sessions)
    markers = read_markers(options.markers) if options.markers else None
    with silent_stdout(), progress_bars(options) as progress:
        made = simulate_runs(
            device, seconds=60 * options.minutes, sessions=options.sessions, seed=options.seed,
            unit=options.unit, off=off, traits=traits, markers=markers, grip_count=options.grips,
            progress=progress,
        )  # fmt: skip
        folders = write_sessions(out, device, made, progress)
    data = {
        "sessions": [str(f) for f in folders], "frames": made.dataset.frames,
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
                f"{made.dataset.frames} pictures of {len(made.dataset.ids)} markers,"
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
            sys.stdout.write(json.dumps([vars(a) for a in traits.told], indent=1) + "\n")
            return 0
        from rich.table import Table

        table = Table(title=f"--off takes {', '.join(traits.names)}")
        for column in ("trait", "number", "value", "unit", "meaning", "source"):
            table.add_column(column)
        for a in traits.told:
            table.add_row(a.trait, a.name, str(a.value), a.unit, a.meaning, a.source)
        console().print(table)
    return 0
