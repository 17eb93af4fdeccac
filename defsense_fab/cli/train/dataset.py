"""The command `defsense dataset`: export sessions as a dataset."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.train.options import DataFiles, ExportOptions
from ..app import command
from ..output import OutputOptions, print_json, print_lines, progress_bars, standard_output
from .data_options import DeviceOption, Files, load_optional_device

if TYPE_CHECKING:
    from ...workflow.train.export import ExportedDataset

_NO_FILES = DataFiles()
_NO_OPTIONS = ExportOptions()
_NO_OUTPUT = OutputOptions()

dataset = command(
    "dataset",
    "defsense dataset my-device/session --device my-device --out my-device/data",
    "defsense dataset --signals signals.csv --tracks take.c3d --offset auto --out data",
    "defsense dataset my-device/session --lerobot policy-data --rate 30",
)


@dataset.default
def _dataset(
    files: Files = _NO_FILES,
    *,
    options: Annotated[ExportOptions, Parameter(name="*")] = _NO_OPTIONS,
    device: DeviceOption = None,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Export sessions and files as a dataset (Parquet, or LeRobot's format).

    Write the data that training uses to a folder: all samples of the read-out board and all marker
    positions, with units, R0, clocks, poses and provenance. The commands train, evaluate and
    dataset accept the folder instead of sessions. Problems of the data are reported; no data are
    left out.
    """
    from ...workflow.train.export import export_files

    with progress_bars(output) as progress:
        exported = export_files(files, load_optional_device(device), options, progress)
    with standard_output():
        if output.json:
            print_json(_to_json(exported, options), allow_nan=False)
            return
        _print_exported(exported, options)
        if options.out is not None:
            device_words = f" --device {quote(str(device))}" if device else ""
            print_lines([f"Next:    defsense train {quote(str(options.out))}{device_words}"])


def _to_json(exported: ExportedDataset, options: ExportOptions) -> dict[str, object]:
    data = exported.dataset
    return {
        "parquet": str(options.out) if options.out else None,
        "lerobot": str(options.lerobot) if options.lerobot else None,
        "device": data.device,
        "layout": data.layout,
        "channels": list(data.channels),
        "markers": data.ids.tolist(),
        "recordings": [
            {"name": r.name, "unit": r.unit, "samples": len(r.sample_time), "frames": len(r.time)}
            for r in data.recordings
        ],
        "problems": [
            {"kind": p.kind, "fatal": p.is_fatal, "what": p.message, "remedy": p.action}
            for p in exported.problems
        ],
        "notes": list(exported.notes),
    }


def _print_exported(exported: ExportedDataset, options: ExportOptions) -> None:
    data = exported.dataset
    samples = sum(len(r.sample_time) for r in data.recordings)
    lines = [
        f"{data.device}: {data.frame_count} pictures of {len(data.ids)} markers and {samples}"
        f" samples of {len(data.channels)} channels, in {len(data.recordings)} recordings"
    ]
    lines += [f"note: {note}" for note in exported.notes]
    lines += [
        f"{'training is not possible' if p.is_fatal else 'note'}: {p}" for p in exported.problems
    ]
    print_lines(lines)
    print_lines(f"Wrote:   {folder}" for folder in (options.out, options.lerobot) if folder)
