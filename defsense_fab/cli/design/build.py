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

_STAGES = {
    "build": ("report", "all stages: body, mesh, poses, cords, parts, report"),
    "mesh": ("mesh", "load the body and make tetrahedra"),
    "simulate": ("simulate", "solve every pose, after what it needs"),
    "optimize": ("optimize", "route the cords, after what they need"),
    "fabricate": ("fabricate", "make the parts, after what they need"),
    "report": ("report", "write the report, after what it needs"),
}


_BEFORE_POSES = ("mesh",)


def add(commands: Commands) -> None:
    """`build` and its stages."""
    for name, (until, text) in _STAGES.items():
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
        if name not in _BEFORE_POSES:
            sub.add_argument(
                "--scheduler",
                metavar="ADDRESS",
                help="Solve the poses on a Dask cluster with this scheduler address, such as "
                "tcp://HOST:8786 (default: solve them locally)",
            )
        sub.set_defaults(until=until, run=_build)


def _build(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    device, requested = load_device(options.folder, parse_overrides(options.set)), _options(options)
    from ...workflow.build.build import build, summary
    from ...workflow.build.options import describe_options, recorded_options

    before = recorded_options(device, device.source / "build")
    with silent_stdout(), progress_bars(options) as progress:
        solve = _solve_elsewhere(options, progress)
        result = build(device, options.until, progress, options=requested, solve=solve)
    data = {**summary(result.folder), "made": result.made, "reused": result.reused}
    with standard_output():
        if options.json:
            print_json(data)
        else:
            _show(data, options, describe_options(requested))
            if not before.is_empty and "fabricate" in result.made and requested != before:
                print_lines([
                    f"note: the previous plates were made with {describe_options(before)}, these"
                    f" with {describe_options(requested) or 'the values of device.toml'}. Repeat the"
                    " option, or set it under [fabrication] in device.toml."
                ])  # fmt: skip
    return 0


def _solve_elsewhere(options: argparse.Namespace, progress: Progress) -> Solve | None:
    """What solves the poses where a cluster is given."""
    address = getattr(options, "scheduler", None)
    if address is None:
        return None
    from ...workflow.study.runs.cluster import cluster_solver

    return cluster_solver(address, lambda told: progress("simulate", 0.0, told))


def _options(options: argparse.Namespace) -> BuildOptions:
    """Return the options of the command line. Raises DeviceError for invalid values."""
    from ...core.device.fabrication_table import MAX_COPIES
    from ...workflow.build.options import BuildOptions

    copies, bed = getattr(options, "copies", None), getattr(options, "bed", None)
    if copies is not None:
        check_range("--copies", copies, 1, MAX_COPIES)
    if bed is None:
        return BuildOptions(copies)
    sizes = parse_numbers("--bed", bed)
    if len(sizes) != 3 or not all(30 <= n <= 5000 for n in sizes):
        raise DeviceError(
            f"--bed {bed}: give width, depth and height, 30 to 5000 mm each, as in 220,220,250"
        )
    return BuildOptions(copies, (sizes[0], sizes[1], sizes[2]))


def _percent(error: float | None) -> str:
    return "an unknown error" if error is None else f"{error:.2%}"


def _told(error: float | dict[str, float]) -> str:
    """An error, or the least and the largest of several states."""
    if isinstance(error, dict):
        return f"{min(error.values()):.2f} to {max(error.values()):.2f}"
    return f"{error:.3f}"


def _cost_of_affine(layout: dict[str, Any]) -> list[str]:
    """What it costs to keep the affine map where another decoder does better on unseen states."""
    from ...decoding.expected_errors import NONE

    tried = layout["unseen"]
    if layout["prediction"]["how"] == NONE:
        return []
    kept, best = layout["prediction"]["decoder"], min(tried, key=lambda k: tried[k])
    if kept != "affine" or best == kept:
        return []
    return [f"note: on unseen states the affine map has {tried[kept]:.2f} mm and {best}"
            f" {tried[best]:.2f} mm; [design] decoder chooses"]  # fmt: skip


def _begun_better(layout: dict[str, Any]) -> list[str]:
    """Where the search set out from what tells unseen states better than the layout taken."""
    begun, taken = (layout[k]["unseen"] for k in ("initial", "prediction"))
    if round(begun, 3) >= round(taken, 3):
        return []
    return [
        f"note: on unseen states the layout taken ({taken:.3f} mm) is worse than what the search"
        f" set out from ({begun:.3f} mm), which is scored by its paths alone, not by what it takes"
        " to make"
    ]


def _measured(response: dict[str, Any] | None) -> list[str]:
    """The cords' response that was used, where it was measured."""
    if response is None:
        return []
    low, high = response["interval"]
    return [
        f"cords' response: {response['file']}, k_res {response['k_res']:.2f} (95 %: {low:.2f} to"
        f" {high:.2f}), pieces differ by {response['spread']:.1%}"
    ]


def _weighed(trials: list[dict[str, Any]]) -> list[str]:
    """The layouts that were made on trial, where there were several."""
    if len(trials) < 2:
        return []
    said = [
        f"{t['built']:.2f} mm in {t['parts']} parts"
        f"{'' if t['slanted'] else ', no plane slanted'}{' (taken)' if t['chosen'] else ''}"
        if t["problem"] is None
        else f"{t['designed']:.2f} mm, which cannot be made"
        for t in trials
    ]
    return [f"layouts weighed, unseen states as built: {'; '.join(dict.fromkeys(said))}"]


def _plates(manifest: dict[str, Any]) -> list[str]:
    """How much there is to print, and to cast."""
    plates, copies = len(manifest["plates"]), manifest.get("copies", 1)
    things = sum(len(p["parts"]) for p in manifest["plates"])
    said = [
        f"plates: {plates} with {things} pieces"
        + (f" of {copies} devices" if copies > 1 else "")
        + f" (at least {manifest.get('least_plates', 1)})"
    ]
    cast = manifest.get("casting")
    if cast:
        pieces = sum(len(m["pieces"]) for m in manifest["moulds"])
        said.append(
            f"moulds: {len(manifest['moulds'])} in {pieces}"
            f" pieces; mix {cast['mass_a']:.0f} g of A and {cast['mass_b']:.0f} g of B of"
            f" {cast['silicone']}"
        )
    return said


def _show(data: dict[str, Any], options: argparse.Namespace, requested: str) -> None:
    from rich.table import Table

    from ...decoding.expected_errors import MEANING

    out = console()
    if not data["made"]:
        print_lines(["Everything is up to date."])
    folder = data["build"]
    chosen = data.get("mesh", {}).get("accuracy")
    if chosen:
        print_lines([
            f"mesh: an edge length of {data['mesh']['edge_length']:.3g} mm"
            f" ({data['mesh']['tets']} tets) keeps signals within {_percent(chosen['reached'])};"
            f" {chosen['asked']:.2%} was asked"
        ])  # fmt: skip
    if "body" in data["made"]:
        repairs = data.get("body", {}).get("repairs", [])
        # STL has no common vertices: to merge them is no repair.
        print_lines(f"body: {line}" for line in repairs if not line.startswith("merged"))
    if data.get("mesh", {}).get("note"):
        print_lines([f"note: {data['mesh']['note']}"])
    print_lines(
        f"note: {w}" for k in ("simulation", "layout") for w in data.get(k, {}).get("warnings", [])
    )
    if "layout" in data:
        layout = data["layout"]
        first, best = layout["initial"], layout["prediction"]
        table = Table(title=f"predicted RMSE, mm, {best['decoder']} decoder")
        for column in ("", "as proposed" if layout["proposed"] else "as drawn", "optimised"):
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
                table.add_row(label, *(_told(p[key]) for p in (first, best)))
        table.add_row("floor of affine maps, all states", "", f"{best['floor']:.3f}")
        out.print(table)
        print_lines([f"note: {MEANING[best['how']]}"])
        print_lines(_begun_better(layout))
        print_lines(_measured(layout["response"]))
        print_lines(_cost_of_affine(layout))
        print_lines(_weighed(layout["weighed"]))
    if "manifest" in data:
        manifest = data["manifest"]
        table = Table(title="parts")
        for column in ("part", "volume, cm3", "size, mm"):
            table.add_column(column, justify="left" if column == "part" else "right")
        for p in manifest["parts"]:
            low, high = p["bbox"]
            size = " x ".join(f"{b - a:.1f}" for a, b in zip(low, high, strict=True))
            table.add_row(p["name"], f"{p['volume'] / 1000:.2f}", size)
        out.print(table)
        table = Table(title="cut list")
        for column in ("cord", "cut to, mm", "ohm, loose", "ohm, laid"):
            table.add_column(column, justify="left" if column == "cord" else "right")
        for c in manifest["cords"]:
            ohm = (f"{c[key]:.0f}" for key in ("resistance_before", "resistance"))
            table.add_row(c["sensor"], f"{c['cut_length']:.0f}", *ohm)
        out.print(table)
        print_lines(_plates(manifest))
        print_lines(f"note: {w}" for w in manifest["warnings"])
    where = f"{folder}/report.html" if options.until == "report" else folder
    following = {
        "build": f"slice {folder}/parts/plate*.3mf, follow {folder}/guide.html",
        "mesh": f"defsense simulate {options.folder}",
        "simulate": f"defsense optimize {options.folder}",
        "optimize": f"defsense fabricate {options.folder}",
        "fabricate": f"defsense report {options.folder} {requested}".rstrip(),
        "report": f"slice {folder}/parts/plate*.3mf, follow {folder}/guide.html",
    }[options.command]
    text = f"Look at: {where}\nNext:    {following}"
    print_lines([text])
