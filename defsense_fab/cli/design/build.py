"""The commands `defsense build | mesh | simulate | optimize | fabricate | report`."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...core.errors import DeviceError
from ...workflow.build.options import BuildOptions
from ..app import Command, command
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
    from ...core.device.device import Device
    from ...workflow.build.build import BuildResult
    from ...workflow.build.results import LayoutRecord, Manifest, MeshRecord

_NO_OPTIONS = BuildOptions()
_NO_OUTPUT = OutputOptions()


def _stage_command(name: str, last_stage: str) -> Command:
    """Return the command that runs all stages up to one."""
    app = command(name, f"defsense {name} fixtures/devices/bar --set width=32")

    @app.default
    def run(
        folder: DeviceFolder = Path(),
        /,
        *,
        overrides: Overrides = (),
        options: Annotated[BuildOptions, Parameter(name="*")] = _NO_OPTIONS,
        output: OutputOptions = _NO_OUTPUT,
    ) -> None:
        """Run the stages of a build. Results that are up to date are reused.

        Args:
            folder: Folder that contains device.toml; the current folder if omitted.
        """
        from ...core.device.device_file import load_device
        from ...core.storage.typed_json import to_json
        from ...workflow.build.build import build as run_stages
        from ...workflow.build.build import summary
        from ...workflow.build.part_changes import load_changes
        from ...workflow.build.recorded_options import recorded_options
        from ...workflow.build.results import model_of_other_cords
        from ...workflow.build.stages import STAGES, STAGES_WITHOUT_CORDS
        from ...workflow.fabrication.effort import find_effort

        _refuse_unused(name, options)
        needs_cords = last_stage not in STAGES_WITHOUT_CORDS
        device = load_device(folder, parse_overrides(overrides), cords=needs_cords)
        previous = recorded_options(device, device.source / "build")
        names = [stage.name for stage in STAGES]
        stages = names[: names.index(last_stage) + 1]
        with silent_stdout(), progress_bars(output, stages) as progress:
            result = run_stages(device, last_stage, progress, options=options)
        old_model = model_of_other_cords(device, result.results)
        with standard_output():
            if output.json:
                summarized = summary(result.folder)
                summarized["model_of_other_cords"] = None if old_model is None else str(old_model)
                if result.results.has_parts:
                    effort = find_effort(device, result.results.manifest)
                    summarized["effort"] = {**to_json(effort), "print_hours": effort.print_hours}
                    summarized["changes"] = to_json(load_changes(result.folder))
                print_json({**summarized, "made": result.made, "reused": result.reused})
                return
            _print_result(result, options.apply(device))
            changes = load_changes(result.folder)
            if changes is not None and "fabricate" in result.made:
                print_lines(changes.describe())
            if old_model is not None:
                print_lines(
                    [
                        f"note: {old_model} was trained on other cords. Train again; recordings of"
                        " the former cords cannot be used."
                    ]
                )
            _print_next_step(name, last_stage, result.folder, folder, options)
            is_other = "fabricate" in result.made and str(options) != str(previous)
            if is_other and previous.overrides:
                values = str(options) or "the values of device.toml"
                print_lines(
                    [
                        f"note: the previous plates were made with {previous}, these with {values}."
                        " Repeat the option, or set it in device.toml."
                    ]
                )

    return app


def _refuse_unused(name: str, options: BuildOptions) -> None:
    """Raise an error for options that the stages up to the last one do not use."""
    has_plates = name in ("build", "fabricate", "report")
    unused = [] if has_plates else list(options.overrides)
    if name == "mesh" and options.scheduler is not None:
        unused.append("scheduler")
    if name in ("mesh", "simulate") and options.search:
        unused.append("search")
    if unused:
        raise DeviceError(
            f"does not apply to defsense {name}",
            code="options-conflict",
            where=unused[0],
            action="Leave it out, or use defsense build",
            options=tuple(unused),
        )


build = _stage_command("build", "report")
mesh = _stage_command("mesh", "mesh")
simulate = _stage_command("simulate", "simulate")
optimize = _stage_command("optimize", "optimize")
fabricate = _stage_command("fabricate", "fabricate")
report = _stage_command("report", "report")


def _print_result(result: BuildResult, device: Device) -> None:
    from ...workflow.board.wiring import plan_if_possible
    from ...workflow.build.load_cases import describe_states
    from ...workflow.build.pose_errors import warn_of_poor_poses
    from ...workflow.build.results import describe_error, has_layout, has_poses
    from ...workflow.fabrication.effort import find_effort

    if not result.made:
        print_lines(["Everything is up to date."])
    results = result.results
    if results.has_parts:
        print_lines([f"{find_effort(device, results.manifest).describe()}."])
    mesh = results.mesh_record
    print_lines(_describe_mesh(mesh))
    if "body" in result.made:
        # STL files have no shared vertices: merging them is not a repair.
        repairs = [line for line in results.body.repairs if not line.startswith("merged")]
        print_lines(f"body: {line}" for line in repairs)
    if mesh.note:
        print_lines([f"note: {mesh.note}"])
    if has_poses(results):
        print_lines(f"note: {warning}" for warning in results.field_index.warnings)
        print_lines([describe_states(results.field_index.states, device.states)])
    if has_layout(results):
        print_lines(f"note: {warning}" for warning in results.layout.warnings)
        print_lines(f"note: {warning}" for warning in warn_of_poor_poses(results, device.cord.noun))
        error = results.layout.band.trained.median
        print_lines([f"after training: {describe_error(error, results.travel, results.size)}"])
        _print_layout(results.layout, device.cord.noun)
        print_lines(f"force: {pose.describe()}" for pose in results.forces.poses)
        print_lines(f"note: {warning}" for warning in results.forces.warnings)
    if results.has_parts:
        _print_parts(results.manifest)
        _print_offers(device, results.layout)
        print_lines(f"note: {note}" for note in plan_if_possible(device, results.manifest)[1])


def _describe_mesh(mesh: MeshRecord) -> list[str]:
    """Return a line on the density of the mesh, if an accuracy was requested."""
    accuracy = mesh.accuracy
    if accuracy is None:
        return []
    reached = "unknown size" if accuracy.reached is None else f"{accuracy.reached:.2%}"
    return [
        f"mesh: an edge length of {mesh.edge_length:.3g} mm ({mesh.tets} tetrahedra)"
        f" has a signal error of {reached}; {accuracy.asked:.2%} was requested"
    ]


def _print_layout(layout: LayoutRecord, noun: str) -> None:
    """Print the predicted errors of a layout of cords or traces, and notes on them."""
    from rich.table import Table

    from ...workflow.build.results import MEANING

    initial, best, band = layout.initial, layout.prediction, layout.band
    table = Table(title=f"Predicted RMSE (mm), {best.decoder} decoder")
    for column in ("", layout.initial_label, "optimized"):
        table.add_column(column, justify="right" if column else "left")
    table.add_row("after training, in a session", "", f"[bold]{band.trained.median:.2f}[/bold]")
    table.add_row("  90 % of devices", "", f"{band.trained.low:.2f} to {band.trained.high:.2f}")
    for family, errors in band.families.items():
        limits = f"{errors.median:.2f} ({errors.low:.2f} to {errors.high:.2f})"
        table.add_row(f"  with {family} {noun}s", "", limits)
    table.add_row("  by noise and tolerances alone", "", f"{band.noise_part:.2f}")
    table.add_row("  with the affine decoder", "", f"{band.affine.median:.2f}")
    table.add_row("by tolerances, unseen states", "", f"{band.median:.2f}")
    table.add_row("  90 % of devices", "", f"{band.low:.2f} to {band.high:.2f}")
    table.add_row(
        "in the parts, with noise, unseen states", f"{initial.unseen:.3f}", f"{best.unseen:.3f}"
    )
    if best.held_out:
        ranges = (_format_range(p.held_out.values()) for p in (initial, best))
        table.add_row("  best state to worst", *ranges)
    for label, key in (
        ("  without noise", "unseen_noise_free"),
        ("in the parts, with noise, fitted states", "rmse"),
        ("  without noise", "rmse_noise_free"),
    ):
        table.add_row(label, *(f"{getattr(p, key):.3f}" for p in (initial, best)))
    table.add_row("lower limit of affine maps without noise, all states", "", f"{best.floor:.3f}")
    console().print(table)
    print_lines(
        [
            f"{band.describe_trained(noun)}.",
            f"note: {MEANING[best.how]}",
            *_note_continued(layout),
            *note_worse_than_start(layout),
            *_describe_response(layout, noun),
            *note_better_decoder(layout),
            *_describe_trials(layout, noun),
        ]
    )


def _format_range(errors: Iterable[float]) -> str:
    values = list(errors)
    return f"{min(values):.2f} to {max(values):.2f}" if values else ""


def _note_continued(layout: LayoutRecord) -> list[str]:
    if not layout.continued:
        return []
    text = {
        "kept": "still keeps all limits and was kept",
        "improved": "was improved from where it was",
    }[layout.continued]
    return [
        f"note: the earlier layout {text}, without a search. To search again: defsense build"
        " --search."
    ]


def note_better_decoder(layout: LayoutRecord) -> list[str]:
    """Return a note if another decoder than the chosen affine map is better on unseen states."""
    from ...workflow.build.results import NONE

    errors, chosen = layout.unseen, layout.prediction.decoder
    best = min(errors, key=lambda k: errors[k])
    if layout.prediction.how == NONE or chosen != "affine" or best == chosen:
        return []
    return [
        f"note: on unseen states the affine map has {errors[chosen]:.2f} mm and {best}"
        f" {errors[best]:.2f} mm. Set [design] decoder to change it."
    ]


def note_worse_than_start(layout: LayoutRecord) -> list[str]:
    """Return a note if the start of the search is better on unseen states than its result."""
    initial, final = layout.initial.unseen, layout.prediction.unseen
    if round(initial, 3) >= round(final, 3):
        return []
    return [
        f"note: on unseen states the chosen layout ({final:.3f} mm) is worse than the start of the"
        f" search ({initial:.3f} mm). The start is rated by its paths only, without the"
        " requirements of fabrication."
    ]


def _describe_response(layout: LayoutRecord, noun: str) -> list[str]:
    """Return a line on the measured response of the cords or traces, if one was used."""
    response = layout.response
    if response is None:
        return []
    low, high = response.interval
    return [
        f"response of the {noun}s: {response.file}, k_res {response.k_res:.2f} (95 %:"
        f" {low:.2f} to {high:.2f}), pieces differ by {response.spread:.1%}"
    ]


def _describe_trials(layout: LayoutRecord, noun: str) -> list[str]:
    """Return a line on the layouts that were made for comparison, if there were several."""
    if len(layout.weighed) < 2:
        return []
    results = []
    for t in layout.weighed:
        if t.problem is not None:
            results.append(f"{t.designed:.2f} mm, cannot be made")
            continue
        if noun == "trace":  # one part, and no planes
            results.append(f"{t.built:.2f} mm{' (chosen)' if t.chosen else ''}")
            continue
        planes = f"on {t.planes} plane{'' if t.planes == 1 else 's'}"
        slanted = "" if t.slanted else ", none slanted"
        parts = "" if t.parts is None else f" in {t.parts} parts"
        results.append(
            f"{t.built:.2f} mm{parts} {planes}{slanted}{' (chosen)' if t.chosen else ''}"
        )
    return [f"compared layouts, unseen states as built: {'; '.join(dict.fromkeys(results))}"]


def _print_offers(device: Device, layout: LayoutRecord) -> None:
    """Print the layouts to choose from, with their errors and the times to print them."""
    from ...workflow.fabrication.offers import find_offers

    offers = find_offers(device, layout)
    if len(offers) > 1:
        texts = (f"{o.describe()}{' (chosen)' if o.is_chosen else ''}" for o in offers)
        print_lines(
            [
                f"layouts to choose from: {'; '.join(texts)}. --parts N takes another one"
                " without a search."
            ]
        )


def _print_parts(manifest: Manifest) -> None:
    """Print the parts, the cords to cut, and the plates."""
    from rich.table import Table

    table = Table(title="Parts")
    for column in ("part", "volume (cm3)", "size (mm)"):
        table.add_column(column, justify="left" if column == "part" else "right")
    for part in manifest.parts:
        size = " x ".join(f"{length:.1f}" for length in part.bbox[1] - part.bbox[0])
        table.add_row(part.name, f"{part.volume / 1000:.2f}", size)
    console().print(table)
    if manifest.traces:
        console().print(_tabulate_traces(manifest))
        print_lines(f"note: {warning}" for warning in manifest.warnings)
        return
    table = Table(title="Cut list")
    for column in ("cord", "cut length (mm)", "loose (ohm)", "inserted (ohm)"):
        table.add_column(column, justify="left" if column == "cord" else "right")
    for cord in manifest.cords:
        ohm = (f"{value:.0f}" for value in (cord.resistance_before, cord.resistance))
        table.add_row(cord.sensor, f"{cord.cut_length:.0f}", *ohm)
    console().print(table)
    print_lines(_describe_plates(manifest))
    print_lines(f"note: {warning}" for warning in manifest.warnings)


def _tabulate_traces(manifest: Manifest) -> Any:
    """Return the table of printed traces."""
    from rich.table import Table

    table = Table(title="Traces")
    for column in ("trace", "length (mm)", "at rest (ohm)", "in use (ohm)"):
        table.add_column(column, justify="left" if column == "trace" else "right")
    for trace in manifest.traces:
        low, high = trace.range
        in_use = f"{low:.0f} to {high:.0f}"
        table.add_row(trace.name, f"{trace.length:.0f}", f"{trace.resistance:.0f}", in_use)
    return table


def _describe_plates(manifest: Manifest) -> list[str]:
    """Return lines on the plates to print and the moulds to cast."""
    pieces = sum(len(plate.parts) for plate in manifest.plates)
    copies = f" of {manifest.copies} devices" if manifest.copies > 1 else ""
    lines = [
        f"plates: {len(manifest.plates)} with {pieces} pieces{copies} (at least"
        f" {manifest.least_plates})"
    ]
    cast = manifest.casting
    if cast:
        mould_pieces = sum(len(mould.pieces) for mould in manifest.moulds)
        lines.append(
            f"moulds: {len(manifest.moulds)} in {mould_pieces} pieces; mix"
            f" {cast.mass_a:.0f} g of A and {cast.mass_b:.0f} g of B of {cast.silicone}"
        )
    return lines


def _print_next_step(
    name: str, last_stage: str, build: Path, device: Path, options: BuildOptions
) -> None:
    has_traces = (build / "parts" / "prusaslicer.3mf").exists()
    files = "prusaslicer.3mf" if has_traces else "plate*.3mf"
    print_parts = f"slice {build}/parts/{files}, follow {build}/guide.html"
    next_step = {
        "build": print_parts,
        "mesh": f"defsense simulate {device}",
        "simulate": f"defsense optimize {device}",
        "optimize": f"defsense fabricate {device}",
        "fabricate": f"defsense report {device} {options}".rstrip(),
        "report": print_parts,
    }[name]
    page = f"{build}/report.html" if last_stage == "report" else build
    print_lines([f"Look at: {page}", f"Next:    {next_step}"])
