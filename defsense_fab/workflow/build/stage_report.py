"""Stage 6: write the report, a page with pictures and predicted errors, and the guide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.device import Device
from ...core.mesh import Surface
from ...decoding.expected_errors import MEANING
from ...geometry.bodies.orientation import viewing_axes
from ...report.guide.guide import assembly_guide, write_guide_file
from ...report.guide.pdf import write_pdf
from ...report.html import write_page
from ...report.pictures import color_bar
from ...report.pictures.body_views import draw_routing
from ...report.pictures.pose_pictures import PLANES, StrainField, draw_error_map, strain_sections
from ...report.pictures.proposals import draw_trial_errors
from ...report.pictures.sections import sections
from ...report.pictures.sheet import COLORS
from ...report.surface_errors import SurfaceErrors, state_words, surface_errors
from ...report.viewer.page import view3d
from ...report.viewer.scene import scene
from ...store.build import Build
from .stage_fabricate import ANSWERS
from .stages import Report

# End of the strain scale: percentile of the strain in a state. Few places go beyond it.
_SCALE_PERCENTILE = 99.5


def run(device: Device, build: Build, report: Report) -> None:
    """Write the report and the assembly guide."""
    layout, manifest, surface, folder = build.layout, build.manifest, build.surface, build.folder
    frame = viewing_axes(surface)
    paths = [s.points for s in layout.sensors]
    report(0.05, "routing")
    images: dict[str, Any] = {
        "routing": draw_routing(
            surface,
            paths,
            list(layout.drawn),
            device.cord.diameter / 2,
            frame,
        )
    }
    report(0.2, "parts")
    found = surface_errors(build)
    turning = view3d(scene(device, build, found, frame))
    poses = build.field_index.warnings
    guide = assembly_guide(device, layout, manifest, build.parts, frame, poses)
    write_page(folder / "guide.html", "guide", guide=guide, view3d=turning)
    write_pdf(guide, folder / "guide.pdf")
    write_guide_file(guide, folder / "guide.json")
    images["parts"] = guide.exploded
    images["front"] = draw_trial_errors(layout.weighed)
    images["poses"] = _poses(device, build, found, frame, report)
    write_page(
        folder / "report.html",
        "report",
        device=device,
        layout=layout,
        poses=poses,
        manifest=manifest,
        mesh=build.mesh_record,
        meaning=MEANING,
        answers=ANSWERS,
        images=images,
        view3d=turning,
        colors=COLORS,
        size=np.abs(frame[[0, 2, 1]]) @ np.ptp(surface.bounds, axis=0),
    )


def _poses(
    device: Device, build: Build, found: SurfaceErrors, frame: Float, report: Report
) -> list[dict[str, Any]]:
    """Return pictures and numbers of the strain and error in the states that are shown.

    These are each pose and mixture that was designed for, at its largest amplitude, and the
    held-out state with the largest error.
    """
    regions = build.region_nodes
    fields = {i: _field(build, i) for i in found.shown}
    strained = color_bar.scale(
        color_bar.STRAIN,
        "largest principal strain (%)",
        100 * max(float(np.percentile(f.strain, _SCALE_PERCENTILE)) for f in fields.values()),
        beyond=True,
    )
    missed = color_bar.scale(
        color_bar.ERROR, "error of the surface that is read (mm)", found.highest, beyond=True
    )
    rest, out = Surface(found.rest, found.faces), []
    for k, i in enumerate(found.shown):
        name = state_words(found.weights[i])
        report(0.3 + 0.7 * k / len(found.shown), name)
        field, handles = fields[i], _handles(device, found.weights[i])
        planes = sections(
            field.nodes, field.displacement, field.strain, _moved(field, regions, handles)
        )
        out.append(
            {
                "name": name,
                "seen": not found.held_out[i],
                "strain": strain_sections(field, rest, found.moved[i], planes, frame, strained),
                "error": draw_error_map(
                    Surface(found.rest + found.moved[i], found.faces),
                    found.error[i],
                    frame,
                    missed,
                ),
                "mean_error": found.mean(i),
                "moved": float(np.linalg.norm(found.moved[i], axis=1).max()),
                "peak": planes.peak,
                "cuts": [
                    f"{letter} {plane.words()}"
                    for (letter, _), plane in zip(PLANES, planes.all, strict=True)
                ],
                "handles": handles,
                "largest_strain": 100 * float(field.strain.max()),
            }
        )
    return out


def _field(build: Build, state: int) -> StrainField:
    mesh, fields = build.quadratic_mesh, build.fields
    return StrainField(mesh.nodes, mesh.cells, fields.displacements[state], fields.strains[state])


def _handles(device: Device, weights: Mapping[str, float]) -> tuple[str, ...]:
    """The regions that a state moves."""
    return tuple(
        dict.fromkeys(h.region for p in device.poses if weights.get(p.name) for h in p.handles)
    )


def _moved(field: StrainField, regions: Mapping[str, Bool], handles: Sequence[str]) -> Bool:
    """Which nodes (n,) of a field the handles have; only corners of tets are known to."""
    some = np.zeros(len(field.nodes), bool)
    for name in handles:
        some[: len(regions[name])] |= regions[name]
    return some
