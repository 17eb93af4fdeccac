"""Command `defsense modes`: propose poses from natural modes."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ...core.errors import DeviceError
from ..device import add_device_arguments, parse_overrides
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...workflow.study.propose_poses import Proposal
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `modes`."""
    sub = commands.add_parser(
        "modes",
        help="Propose poses from the body's natural modes",
        description="Find the lowest vibration modes of the body with one region fixed, and "
        "convert bends, twists and stretches to poses for device.toml. The device "
        "needs no poses yet.",
        examples=["defsense modes fixtures/devices/bar --fixed base"],
    )
    add_device_arguments(sub)
    sub.add_argument(
        "--fixed", required=True, metavar="REGION", help="Set the region that is fixed"
    )
    sub.add_argument(
        "--count", type=int, default=8, help="Set the number of modes to compute (default: 8)"
    )
    sub.add_argument("--write", action="store_true", help="Add the poses to device.toml")
    sub.set_defaults(run=_modes)


def _modes(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    if not 1 <= options.count <= 50:
        raise DeviceError(
            f"{options.count} is out of range",
            code="out-of-range",
            where="--count",
            action="Give a number from 1 to 50",
            value=options.count,
        )
    device = load_device(options.folder, parse_overrides(options.set), complete=False)
    from ...workflow.study import propose_poses

    with silent_stdout(), progress_bars(options) as progress:
        proposal = propose_poses.propose_poses(device, options.fixed, options.count, progress)
    if options.write:
        propose_poses.append_poses(
            options.folder / "device.toml", proposal, tuple(p.name for p in device.poses)
        )
    with standard_output():
        if options.json:
            rows = [
                {"frequency": m.frequency, "kind": m.kind, "order": m.order} for m in proposal.modes
            ]
            data = {"modes": rows, "toml": proposal.text, "picture": str(proposal.picture)}
            print_json(data)
        else:
            _print_modes(proposal, options)
            if options.write and device.poses and device.states.given:
                print_lines([
                    "note: [states] in device.toml lists mixtures. Add mixtures of the new poses,"
                    " or remove the lists to mix all poses."
                ])  # fmt: skip
    return 0


def _print_modes(proposal: Proposal, options: argparse.Namespace) -> None:
    from rich.table import Table

    out = console()
    table = Table(title=f"Modes with {options.fixed!r} fixed")
    for column in ("frequency (Hz)", "kind", "order"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    for mode in proposal.modes:
        table.add_row(f"{mode.frequency:.3g}", mode.kind, str(mode.order))
    out.print(table)
    print_lines([proposal.text])
    next_step = (
        f"defsense build {options.folder}"
        if options.write
        else f"defsense modes {options.folder} --fixed {options.fixed} --write, or paste the text"
        " into device.toml"
    )
    print_lines([f"Look at: {proposal.picture}", f"Next:    {next_step}"])
