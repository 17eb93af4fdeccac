"""Command `defsense modes`: propose poses from natural modes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.study.options import ModesOptions
from ..app import command
from ..device import DeviceFolder, Overrides, parse_overrides
from ..output import (
    OutputOptions,
    console,
    print_json,
    print_lines,
    progress_bars,
    silent_stdout,
    standard_output,
)

if TYPE_CHECKING:
    from ...workflow.study.propose_poses import Proposal

_NO_OUTPUT = OutputOptions()

modes = command("modes", "defsense modes fixtures/devices/bar --fixed base")


@modes.default
def _modes(
    folder: DeviceFolder,
    /,
    *,
    options: Annotated[ModesOptions, Parameter(name="*")],
    write: bool = False,
    overrides: Overrides = (),
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Propose poses from the lowest vibration modes of a body with one region fixed.

    Bends, twists and stretches become poses for device.toml. The device needs no poses yet.

    Args:
        folder: Set the folder that contains device.toml.
        write: Add the poses to device.toml.
    """
    from ...core.device.device_file import load_device
    from ...workflow.study.propose_poses import append_poses, propose_poses

    device = load_device(folder, parse_overrides(overrides), complete=False)
    with silent_stdout(), progress_bars(output) as progress:
        proposal = propose_poses(device, options, progress)
    if write:
        append_poses(folder / "device.toml", proposal, tuple(p.name for p in device.poses))
    with standard_output():
        if output.json:
            rows = [
                {"frequency": m.frequency, "kind": m.kind, "order": m.order} for m in proposal.modes
            ]
            result = {"modes": rows, "toml": proposal.text, "picture": str(proposal.picture)}
            print_json(result | {"notes": list(proposal.notes)})
            return
        _print_modes(proposal, options.fixed)
        next_step = (
            f"defsense build {folder}"
            if write
            else f"defsense modes {folder} --fixed {options.fixed} --write, or paste the text into"
            " device.toml"
        )
        print_lines([f"Look at: {proposal.picture}", f"Next:    {next_step}"])
        states = device.states
        given = [
            name
            for name, is_given in (
                ("mixtures", states.mixtures_given),
                ("held_out", states.held_out_given),
            )
            if is_given
        ]
        if write and device.poses and given:
            note = (
                f"note: [states] {' and '.join(given)} of device.toml does not contain the new"
                " poses. Add mixtures of them, or remove the key to propose mixtures of all poses."
            )
            print_lines([note])


def _print_modes(proposal: Proposal, fixed: str) -> None:
    from rich.table import Table

    table = Table(title=f"Modes with {fixed!r} fixed")
    for column in ("frequency (Hz)", "kind", "order"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    for mode in proposal.modes:
        table.add_row(f"{mode.frequency:.3g}", mode.kind, str(mode.order))
    console().print(table)
    print_lines([proposal.text, *(f"note: {note}" for note in proposal.notes)])
