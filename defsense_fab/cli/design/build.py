"""The commands `defsense build | mesh | simulate | optimize | fabricate | report`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ...core.errors import DeviceError
from ..device import add_device_arguments, parse_overrides
from ..options import check_range, parse_numbers
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...core.progress import Progress
    from ...workflow.build.options import BuildOptions
    from ...workflow.build.stages import Solve
    from ..options import Commands

#: Last stage and description of each command.
_COMMANDS = {
    "build": ("report", "Run all stages: body, mesh, poses, cords, parts, report"),
    "mesh": ("mesh", "Load the body and mesh it with tetrahedra"),
    "simulate": ("simulate", "Solve all poses, and the stages before"),
    "optimize": ("optimize", "Route the cords, and run the stages before"),
    "fabricate": ("fabricate", "Make the parts, and run the stages before"),
    "report": ("report", "Write the report, and run the stages before"),
}


def add(commands: Commands) -> None:
    """Add `build` and the commands of its stages."""
    for name, (last_stage, text) in _COMMANDS.items():
        sub = commands.add_parser(
            name,
            help=text,
            description=f"{text}. Results that are up to date are reused.",
            examples=[f"defsense {name} fixtures/devices/bar --set width=32"],
        )
        add_device_arguments(sub)
        if name in ("build", "fabricate", "report"):
            sub.add_argument(
                "--copies",
                type=int,
                metavar="N",
                help="Set the number of devices on the plates (default: [fabrication] copies)",
            )
            sub.add_argument(
                "--bed",
                metavar="X,Y,Z",
                help="Set the printer bed size in mm (default: [fabrication] bed)",
            )
        if name != "mesh":
            sub.add_argument(
                "--scheduler",
                metavar="ADDRESS",
                help="Solve the poses on a Dask cluster with this scheduler address, such as "
                "tcp://HOST:8786 (default: solve them locally)",
            )
        sub.set_defaults(until=last_stage, run=_build)


def _build(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    device = load_device(options.folder, parse_overrides(options.set))
    requested = _build_options(options)
    from ...workflow.build.build import build, summary
    from ...workflow.build.options import describe_options, recorded_options

    previous = recorded_options(device, device.source / "build")
    with silent_stdout(), progress_bars(options) as progress:
        solve = _cluster_solver(options, progress)
        result = build(device, options.until, progress, options=requested, solve=solve)
    data = {**summary(result.folder), "made": result.made, "reused": result.reused}
    with standard_output():
        if options.json:
            print_json(data)
            return 0
        _print_summary(data)
        _print_next_step(data["build"], options, describe_options(requested))
        if not previous.is_empty and "fabricate" in result.made and requested != previous:
            print_lines([
                f"note: the previous plates were made with {describe_options(previous)}, these"
                f" with {describe_options(requested) or 'the values of device.toml'}. Repeat the"
                " option, or set it under [fabrication] in device.toml."
            ])  # fmt: skip
    return 0


def _cluster_solver(options: argparse.Namespace, progress: Progress) -> Solve | None:
    """Return the function that solves poses on the requested cluster, or None."""
    address = getattr(options, "scheduler", None)
    if address is None:
        return None
    from ...workflow.study.runs.cluster import cluster_solver

    return cluster_solver(address, lambda message: progress("simulate", 0.0, message))


def _build_options(options: argparse.Namespace) -> BuildOptions:
    """Return the build options of the command line, after checking them."""
    from ...core.device.fabrication_table import MAX_COPIES
    from ...workflow.build.options import BuildOptions

    copies, bed = getattr(options, "copies", None), getattr(options, "bed", None)
    if copies is not None:
        check_range("--copies", copies, 1, MAX_COPIES)
    if bed is None:
        return BuildOptions(copies)
    sizes = parse_numbers("--bed", bed)
    if len(sizes) != 3 or not all(30 <= size <= 5000 for size in sizes):
        raise DeviceError(
            f"{bed} is not a valid bed size",
            code="bed-size-invalid",
            where="--bed",
            action="Give width, depth and height, 30 to 5000 mm each, such as 220,220,250",
            value=bed,
        )
    return BuildOptions(copies, (sizes[0], sizes[1], sizes[2]))


def _print_summary(data: dict[str, Any]) -> None:
    if not data["made"]:
        print_lines(["Everything is up to date."])
    print_lines(_describe_mesh(data))
    if "layout" in data:
        _print_layout(data["layout"])
    if "manifest" in data:
        _print_parts(data["manifest"])


def _describe_mesh(data: dict[str, Any]) -> list[str]:
    """Return lines on the mesh and the body, and warnings of the first stages."""
    lines = []
    mesh = data.get("mesh", {})
    accuracy = mesh.get("accuracy")
    if accuracy:
        reached = accuracy["reached"]
        lines.append(
            f"mesh: an edge length of {mesh['edge_length']:.3g} mm ({mesh['tets']} tetrahedra)"
            f" has a signal error of {'unknown size' if reached is None else f'{reached:.2%}'};"
            f" {accuracy['asked']:.2%} was requested"
        )
    if "body" in data["made"]:
        repairs = data.get("body", {}).get("repairs", [])
        # STL files have no shared vertices: merging them is not a repair.
        lines += [f"body: {line}" for line in repairs if not line.startswith("merged")]
    if mesh.get("note"):
        lines.append(f"note: {mesh['note']}")
    warnings = [
        w for key in ("simulation", "layout") for w in data.get(key, {}).get("warnings", [])
    ]
    return lines + [f"note: {warning}" for warning in warnings]


def _print_layout(layout: dict[str, Any]) -> None:
    """Print the predicted errors of the layout, and notes on them."""
    from rich.table import Table

    from ...decoding.expected_errors import MEANING

    initial, best = layout["initial"], layout["prediction"]
    table = Table(title=f"Predicted RMSE (mm), {best['decoder']} decoder")
    for column in ("", "as proposed" if layout["proposed"] else "as drawn", "optimized"):
        table.add_column(column, justify="right" if column else "left")
    band = layout["band"]
    table.add_row("built devices, unseen states", "", f"[bold]{band['median']:.2f}[/bold]")
    table.add_row("  90 % of devices", "", f"{band['low']:.2f} to {band['high']:.2f}")
    for label, key in (
        ("as designed, unseen states", "unseen"),
        ("  best state to worst", "held_out"),
        ("  without noise", "unseen_noise_free"),
        ("as designed, fitted states", "rmse"),
        ("  without noise", "rmse_noise_free"),
    ):
        if best[key] != {}:
            table.add_row(label, *(_format_error(p[key]) for p in (initial, best)))
    table.add_row("lower limit of affine maps, all states", "", f"{best['floor']:.3f}")
    console().print(table)
    print_lines([
        f"note: {MEANING[best['how']]}",
        *_note_worse_than_start(layout),
        *_describe_response(layout["response"]),
        *_note_better_decoder(layout),
        *_describe_trials(layout["weighed"]),
    ])  # fmt: skip


def _format_error(error: float | dict[str, float]) -> str:
    """Format an error, or the range of the errors of several states."""
    if isinstance(error, dict):
        return f"{min(error.values()):.2f} to {max(error.values()):.2f}"
    return f"{error:.3f}"


def _note_better_decoder(layout: dict[str, Any]) -> list[str]:
    """Return a note if another decoder than the chosen affine map is better on unseen states."""
    from ...decoding.expected_errors import NONE

    errors = layout["unseen"]
    if layout["prediction"]["how"] == NONE:
        return []
    chosen, best = layout["prediction"]["decoder"], min(errors, key=lambda k: errors[k])
    if chosen != "affine" or best == chosen:
        return []
    return [
        f"note: on unseen states the affine map has {errors[chosen]:.2f} mm and {best}"
        f" {errors[best]:.2f} mm. Set [design] decoder to change it."
    ]


def _note_worse_than_start(layout: dict[str, Any]) -> list[str]:
    """Return a note if the start of the search is better on unseen states than its result."""
    initial, final = (layout[k]["unseen"] for k in ("initial", "prediction"))
    if round(initial, 3) >= round(final, 3):
        return []
    return [
        f"note: on unseen states the chosen layout ({final:.3f} mm) is worse than the start of the"
        f" search ({initial:.3f} mm). The start is rated by its paths only, without the"
        " requirements of fabrication."
    ]


def _describe_response(response: dict[str, Any] | None) -> list[str]:
    """Return a line on the measured response of the cords, if one was used."""
    if response is None:
        return []
    low, high = response["interval"]
    return [
        f"response of the cords: {response['file']}, k_res {response['k_res']:.2f} (95 %:"
        f" {low:.2f} to {high:.2f}), pieces differ by {response['spread']:.1%}"
    ]


def _describe_trials(trials: list[dict[str, Any]]) -> list[str]:
    """Return a line on the layouts that were made for comparison, if there were several."""
    if len(trials) < 2:
        return []
    results = [
        f"{t['built']:.2f} mm in {t['parts']} parts"
        f"{'' if t['slanted'] else ', no plane slanted'}{' (chosen)' if t['chosen'] else ''}"
        if t["problem"] is None
        else f"{t['designed']:.2f} mm, cannot be made"
        for t in trials
    ]
    return [f"compared layouts, unseen states as built: {'; '.join(dict.fromkeys(results))}"]


def _print_parts(manifest: dict[str, Any]) -> None:
    """Print the parts, the cords to cut, and the plates."""
    from rich.table import Table

    table = Table(title="Parts")
    for column in ("part", "volume (cm3)", "size (mm)"):
        table.add_column(column, justify="left" if column == "part" else "right")
    for part in manifest["parts"]:
        low, high = part["bbox"]
        size = " x ".join(f"{b - a:.1f}" for a, b in zip(low, high, strict=True))
        table.add_row(part["name"], f"{part['volume'] / 1000:.2f}", size)
    console().print(table)
    table = Table(title="Cut list")
    for column in ("cord", "cut length (mm)", "loose (ohm)", "inserted (ohm)"):
        table.add_column(column, justify="left" if column == "cord" else "right")
    for cord in manifest["cords"]:
        ohm = (f"{cord[key]:.0f}" for key in ("resistance_before", "resistance"))
        table.add_row(cord["sensor"], f"{cord['cut_length']:.0f}", *ohm)
    console().print(table)
    print_lines(_describe_plates(manifest))
    print_lines(f"note: {warning}" for warning in manifest["warnings"])


def _describe_plates(manifest: dict[str, Any]) -> list[str]:
    """Return lines on the plates to print and the moulds to cast."""
    plates, copies = len(manifest["plates"]), manifest.get("copies", 1)
    pieces = sum(len(plate["parts"]) for plate in manifest["plates"])
    lines = [
        f"plates: {plates} with {pieces} pieces"
        + (f" of {copies} devices" if copies > 1 else "")
        + f" (at least {manifest.get('least_plates', 1)})"
    ]
    cast = manifest.get("casting")
    if cast:
        mould_pieces = sum(len(mould["pieces"]) for mould in manifest["moulds"])
        lines.append(
            f"moulds: {len(manifest['moulds'])} in {mould_pieces} pieces; mix"
            f" {cast['mass_a']:.0f} g of A and {cast['mass_b']:.0f} g of B of {cast['silicone']}"
        )
    return lines


def _print_next_step(folder: str, options: argparse.Namespace, requested: str) -> None:
    device = options.folder
    print_parts = f"slice {folder}/parts/plate*.3mf, follow {folder}/guide.html"
    next_step = {
        "build": print_parts,
        "mesh": f"defsense simulate {device}",
        "simulate": f"defsense optimize {device}",
        "optimize": f"defsense fabricate {device}",
        "fabricate": f"defsense report {device} {requested}".rstrip(),
        "report": print_parts,
    }[options.command]
    page = f"{folder}/report.html" if options.until == "report" else folder
    print_lines([f"Look at: {page}", f"Next:    {next_step}"])
