"""The command `defsense twin`: simulate training sessions."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.train.options import TwinOptions
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
    from ...workflow.train.twin import TwinTraits, WrittenTwin

_NO_OPTIONS = TwinOptions()
_NO_OUTPUT = OutputOptions()

twin = command(
    "twin",
    "defsense twin my-device",
    "defsense twin my-device --minutes 20 --sessions 3 --unit 2 --off drift,mullins",
    "defsense twin my-device --minutes 5 --cameras webcam",
)


@twin.default
def _twin(
    folder: DeviceFolder,
    /,
    *,
    overrides: Overrides = (),
    options: Annotated[TwinOptions, Parameter(name="*")] = _NO_OPTIONS,
    out: Annotated[Path | None, Parameter(metavar="DIR")] = None,
    list_assumptions: bool = False,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Simulate training sessions of a device without hardware.

    Simulate a built device that a hand moves, its cords, its read-out board and its markers. Write
    sessions in the format of 'capture process', with the true values (truth.npz) and all
    assumptions (assumptions.md). The device is solved again, with a finer mesh and another
    material law. This takes minutes the first time; the result is stored in its build.

    Args:
        folder: Folder that contains device.toml.
        out: Set the session folder (default: twin-UNIT-SEED, in the device folder).
        list_assumptions: Print every assumed number with its source, and the names of the traits
            that can be turned off.
    """
    from ...core.device.device_file import load_device
    from ...workflow.train.twin import simulate_recordings, twin_traits

    device = load_device(folder, parse_overrides(overrides))
    if list_assumptions:
        _print_assumptions(twin_traits(device, options), output)
        return
    with silent_stdout(), progress_bars(output) as progress:
        written = simulate_recordings(device, options, out=out, progress=progress)
    with standard_output():
        if output.json:
            print_json(written.to_json())
        else:
            _print_sessions(written, folder)


def _print_sessions(written: WrittenTwin, device: Path) -> None:
    dataset, fields = written.runs.dataset, written.runs.fields
    print_lines(f"note: {warning}" for warning in fields.warnings)
    session = quote(str(written.folders[0]))
    print_lines(
        [
            f"{written.frames} pictures of {len(dataset.ids)} markers, {len(dataset.channels)}"
            f" cords; shapes interpolated between {len(fields.space.states)} solved states, error"
            f" {fields.error:.2g} mm when one is omitted",
            f"Look at: {written.assumptions}",
            f"Next:    defsense train {session} --device {quote(str(device))}",
        ]
    )


def _print_assumptions(traits: TwinTraits, output: OutputOptions) -> None:
    with standard_output():
        if output.json:
            print_json([vars(a) for a in traits.assumptions])
            return
        from rich.table import Table

        table = Table(title=f"Traits for --off: {', '.join(traits.names)}")
        for column in ("trait", "number", "value", "unit", "meaning", "source"):
            table.add_column(column)
        for a in traits.assumptions:
            table.add_row(a.trait, a.name, str(a.value), a.unit, a.meaning, a.source)
        console().print(table)
