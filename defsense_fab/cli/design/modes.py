"""The command `defsense modes`."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from ...core.errors import DeviceError
from ..device import device_arguments, overrides
from ..output import console, progress_bars, results, say, silent_stdout

if TYPE_CHECKING:
    from ...workflow.study.propose_poses import Proposal
    from ..options import Commands


def add(commands: Commands) -> None:
    """`modes`."""
    sub = commands.add_parser(
        "modes",
        help="propose poses from the body's natural modes",
        description="Find the lowest vibration modes of the body with a region held, and turn"
        " bends, twists and stretches into poses for device.toml, which may have none yet.",
        examples=["defsense modes fixtures/devices/bar --fixed base"],
    )
    device_arguments(sub)
    sub.add_argument("--fixed", required=True, metavar="REGION", help="the region that is held")
    sub.add_argument("--count", type=int, default=8, help="how many modes to look at (8)")
    sub.add_argument("--write", action="store_true", help="add the poses to device.toml")
    sub.set_defaults(run=_modes)


def _modes(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    if not 1 <= options.count <= 50:
        raise DeviceError(f"--count {options.count}: give a number from 1 to 50")
    device = load_device(options.folder, overrides(options.set), complete=False)
    from ...workflow.study import propose_poses

    with silent_stdout(), progress_bars(options) as progress:
        found = propose_poses.propose_poses(device, options.fixed, options.count, progress)
    if options.write:
        propose_poses.append(
            options.folder / "device.toml", found, tuple(p.name for p in device.poses)
        )
    with results():
        if options.json:
            rows = [
                {"frequency": m.frequency, "kind": m.kind, "order": m.order} for m in found.modes
            ]
            data = {"modes": rows, "toml": found.text, "picture": str(found.picture)}
            sys.stdout.write(json.dumps(data, indent=1) + "\n")
        else:
            _show_modes(found, options)
            if options.write and device.poses and device.states.given:
                say(["note: [states] in device.toml lists mixtures: add those of the new poses,"
                     " or leave the lists out, so that all poses are mixed"])  # fmt: skip
    return 0


def _show_modes(found: Proposal, options: argparse.Namespace) -> None:
    from rich.table import Table

    out = console()
    table = Table(title=f"modes with {options.fixed!r} held")
    for column in ("Hz", "kind", "order"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    for mode in found.modes:
        table.add_row(f"{mode.frequency:.3g}", mode.kind, str(mode.order))
    out.print(table)
    say([found.text])
    following = (
        f"defsense build {options.folder}"
        if options.write
        else f"defsense modes {options.folder} --fixed {options.fixed} --write, or paste the text"
        " into device.toml"
    )
    say([f"Look at: {found.picture}", f"Next:    {following}"])
