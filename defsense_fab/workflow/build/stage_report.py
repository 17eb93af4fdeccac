"""Stage 6: write the report, a page with pictures and predicted errors, and the guide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.device import Device
from ...core.mesh import Surface
from ...core.progress import describe_duration
from ...decoding.error_scale import SCALE, describe_error
from ...decoding.expected_errors import MEANING
from ...geometry.bodies.orientation import viewing_axes
from ...report.guide.guide import assembly_guide, write_guide
from ...report.html import write_page
from ...report.pictures import color_bar
from ...report.pictures.body_views import draw_routing
from ...report.pictures.pose_pictures import PLANES, StrainField, draw_error_map, strain_sections
from ...report.pictures.proposals import draw_trial_errors
from ...report.pictures.sections import sections
from ...report.pictures.sheet import COLORS
from ...report.surface_errors import SurfaceErrors, state_words, surface_errors
from ...report.viewer.scene import scene, view3d
from ...store.build import Build
from ...store.layout import WeighedRecord
from ..board.wiring import plan_if_possible, write_wiring_files
from ..fabrication.effort import effort_table
from ..fabrication.offers import find_offers
from ..fabrication.print_time import print_hours
from .pose_errors import warn_of_poor_poses
from .stage_fabricate import COMPRESSION_RESPONSES
from .stages import Report

# Percentile of the strains of a state at which the scale ends; few places exceed it.
_SCALE_PERCENTILE = 99.5


def run(device: Device, build: Build, report: Report) -> None:
    """Write the report and the assembly guide.

    Args:
        device: The device.
        build: Results of the earlier stages.
        report: Receives the completed fraction and a message.
    """
    layout, manifest, surface, folder = build.layout, build.manifest, build.surface, build.folder
    frame = viewing_axes(surface)
    paths = [s.points for s in layout.sensors]
    report(0.05, "routing")
    images: dict[str, Any] = {
        "routing": draw_routing(surface, paths, list(layout.drawn), device.cord.diameter / 2, frame)
    }
    report(0.2, "parts")
    errors = surface_errors(build)
    viewer = view3d(scene(device, build, errors, frame))
    wiring, wiring_notes = plan_if_possible(device, manifest)
    if wiring is not None:
        write_wiring_files(wiring, folder)
    warnings = (*build.field_index.warnings, *build.forces.warnings, *wiring_notes)
    notes = (*warn_of_poor_poses(build, device.cord.noun), *warnings)
    guide = assembly_guide(device, layout, manifest, build.parts, frame, notes, wiring)
    judged = describe_error(layout.band.trained.median, build.travel, build.size)
    effort = effort_table(device, manifest)
    guide = replace(
        guide,
        effort=effort,
        forces=tuple(p.describe() for p in build.forces.poses),
        accuracy=f"Expected error after training: {judged}. {SCALE}",
    )
    if manifest.traces:
        guide = replace(guide, exploded=images["routing"])
    write_guide(guide, folder, viewer)
    images["parts"] = guide.exploded
    images["wiring"] = None if guide.wiring is None else guide.wiring.drawing
    images["front"] = draw_trial_errors(layout.weighed)
    images["poses"] = _pose_pictures(device, build, errors, frame, report)
    write_page(
        folder / "report.html",
        "report",
        device=device,
        layout=layout,
        notes=notes,
        forces=build.forces,
        manifest=manifest,
        effort=effort,
        offers=find_offers(device, layout),
        hours=[_print_time(device, record) for record in layout.weighed],
        mesh=build.mesh_record,
        meaning=MEANING,
        judged={
            "trained": judged,
            "parts": describe_error(layout.prediction.unseen, build.travel),
            "scale": SCALE,
        },
        states=_state_rows(device, build),
        state_words={s.state: state_words(s.weights) for s in build.field_index.states},
        answers=COMPRESSION_RESPONSES,
        images=images,
        view3d=viewer,
        colors=COLORS,
        size=np.abs(frame[[0, 2, 1]]) @ np.ptp(surface.bounds, axis=0),
    )


def _print_time(device: Device, record: WeighedRecord) -> str:
    """Return the time to print the parts of a compared layout; empty without an estimate."""
    fabrication = device.fabrication
    hours = print_hours(fabrication, record.pieces * fabrication.copies)
    return describe_duration(3600 * hours) if record.pieces and hours is not None else ""


def _state_rows(device: Device, build: Build) -> list[dict[str, Any]]:
    """Return the rows of the table of states: shares of poses, use, and errors in mm."""
    initial, final = build.layout.initial, build.layout.prediction
    before = {**initial.per_state, **initial.held_out}
    after = {**final.per_state, **final.held_out}
    errors = {name: {"initial": before[name], "final": after[name]} for name in after}
    rows = [{"name": "rest", "shares": "", "use": "fitted", **errors["rest"]}]
    for state in build.field_index.states:
        is_proposed = len(state.weights) > 1 and not device.states.mixtures_given
        if state.held_out:
            is_proposed = not device.states.held_out_given
        use = "held out" if state.held_out else "fitted"
        rows.append(
            {
                "name": state.state,
                "shares": ", ".join(f"{n} {100 * w:.4g} %" for n, w in state.weights.items()),
                "use": f"{use} (proposed)" if is_proposed else use,
                **errors[state.state],
            }
        )
    return rows


def _pose_pictures(
    device: Device, build: Build, errors: SurfaceErrors, frame: Float, report: Report
) -> list[dict[str, Any]]:
    """Return pictures and numbers of the strain and error in the states that are shown.

    These are each pose and mixture that was designed for, at its largest amplitude, and the
    held-out state with the largest error.
    """
    regions = build.region_nodes
    fields = {i: _field(build, i) for i in errors.shown}
    strain_scale = color_bar.scale(
        color_bar.STRAIN,
        "largest principal strain (%)",
        100 * max(float(np.percentile(f.strain, _SCALE_PERCENTILE)) for f in fields.values()),
        beyond=True,
    )
    error_scale = color_bar.scale(
        color_bar.ERROR, "error of the predicted surface (mm)", errors.highest, beyond=True
    )
    prediction = build.layout.prediction
    with_noise = {**prediction.per_state, **prediction.held_out}
    rest, pictures = Surface(errors.rest, errors.faces), []
    for k, i in enumerate(errors.shown):
        name = state_words(errors.weights[i])
        report(0.3 + 0.7 * k / len(errors.shown), name)
        field, handles = fields[i], _handles(device, errors.weights[i])
        planes = sections(
            field.nodes, field.displacement, field.strain, _moved(field, regions, handles)
        )
        pictures.append(
            {
                "name": name,
                "is_trained": not errors.held_out[i],
                "strain": strain_sections(
                    field, rest, errors.moved[i], planes, frame, strain_scale
                ),
                "error": draw_error_map(
                    Surface(errors.rest + errors.moved[i], errors.faces),
                    errors.error[i],
                    frame,
                    error_scale,
                ),
                "judged": describe_error(with_noise[errors.names[i]], errors.travel(i)),
                "without_noise": errors.mean(i),
                "peak": planes.peak,
                "cuts": [
                    f"{letter} {plane.words()}"
                    for (letter, _), plane in zip(PLANES, planes.all, strict=True)
                ],
                "handles": handles,
                "largest_strain": 100 * float(field.strain.max()),
            }
        )
    return pictures


def _field(build: Build, state: int) -> StrainField:
    mesh, fields = build.quadratic_mesh, build.fields
    return StrainField(mesh.nodes, mesh.cells, fields.displacements[state], fields.strains[state])


def _handles(device: Device, weights: Mapping[str, float]) -> tuple[str, ...]:
    """Return the names of the regions that a state moves."""
    return tuple(
        dict.fromkeys(h.region for p in device.poses if weights.get(p.name) for h in p.handles)
    )


def _moved(field: StrainField, regions: Mapping[str, Bool], handles: Sequence[str]) -> Bool:
    """Return which nodes (n,) of a field belong to handles, of the corners of tetrahedra."""
    is_moved = np.zeros(len(field.nodes), bool)
    for name in handles:
        is_moved[: len(regions[name])] |= regions[name]
    return is_moved
