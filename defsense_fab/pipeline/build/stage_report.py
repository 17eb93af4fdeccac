"""Stage 6: a self-contained page with pictures and predicted errors, and the assembly guide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device import Device
from ...core.mesh import Surface
from ...decoding.unseen import MEANING
from ..artifacts.body import load_surface
from ..artifacts.fields import field_path, load_index, load_strain
from ..artifacts.layout import load_layout
from ..artifacts.manifest import load_manifest
from ..artifacts.mesh import load_mesh_record
from ..artifacts.part_files import load_parts
from ..report import pictures
from ..report.guide import assembly_guide
from ..report.guide_pdf import write_pdf
from ..report.html import write_page
from ..report.surface_errors import SurfaceErrors, surface_errors
from ..report.viewer.page import view3d
from ..report.viewer.scene import scene
from .stages import Report


def run(device: Device, folder: Path, report: Report) -> None:
    """Write the report and the assembly guide."""
    layout = load_layout(folder)
    manifest = load_manifest(folder)
    surface = load_surface(folder)
    view = _view(surface)
    paths = [s.points for s in layout.sensors]
    report(0.05, "routing")
    images: dict[str, Any] = {
        "routing": pictures.routing(
            surface,
            paths,
            list(layout.drawn),
            device.cord.diameter / 2,
            view,
        )
    }
    report(0.2, "parts")
    parts = load_parts(folder, manifest)
    found = surface_errors(folder, layout)
    turning = view3d(scene(device, folder, layout, manifest, parts, found, _frame(surface)))
    guide = assembly_guide(device, layout, manifest, parts, view)
    write_page(folder / "guide.html", "guide", guide=guide, view3d=turning)
    write_pdf(guide, folder / "guide.pdf")
    images["parts"] = guide.exploded
    images["front"] = pictures.front(layout.weighed)
    images["poses"] = _poses(folder, found, view, report)
    write_page(
        folder / "report.html",
        "report",
        device=device,
        layout=layout,
        poses=load_index(folder).warnings,
        manifest=manifest,
        mesh=load_mesh_record(folder),
        meaning=MEANING,
        images=images,
        view3d=turning,
        colors=pictures.COLORS,
        max=max,
    )


def _view(surface: Surface) -> Float:
    """Camera direction that shows a long body from the side and above."""
    long = int(np.ptp(surface.bounds, axis=0).argmax())
    return np.array([1.0, 0.35, 0.55]) if long == 1 else np.array([0.35, -1.0, 0.55])


def _frame(surface: Surface) -> Float:
    """In its rows what is to the right, up and towards the viewer for a body as it stands."""
    long = int(np.ptp(surface.bounds, axis=0).argmax())
    right, front = ([0, 1.0, 0], [1.0, 0, 0]) if long == 1 else ([1.0, 0, 0], [0, -1.0, 0])
    return np.array([right, [0, 0, 1.0], front])


def _section(rest: Float, u: Float) -> Float:
    """Normal of the section: of the two short axes the one along which the body moves least."""
    axes = np.argsort(np.ptp(rest, axis=0))[:2]
    return np.asarray(np.eye(3)[axes[(u[:, axes] ** 2).sum(0).argmin()]])


def _poses(folder: Path, found: SurfaceErrors, view: Float, report: Report) -> list[dict[str, Any]]:
    """Strain section and error map of each pose and mixture that was designed for, at its fullest,
    and of the held-out state that is sensed worst."""
    rest, out = found.rest, []
    center = np.asarray(rest.min(0) + rest.max(0)) / 2
    for k, i in enumerate(found.shown):
        name = found.names[i]
        report(0.3 + 0.7 * k / len(found.shown), name)
        strain = 100 * float(np.percentile(load_strain(folder, name), 99.5))
        out.append(
            {
                "name": name,
                "strain": pictures.strain_section(
                    field_path(folder, name), name, center, _section(rest, found.moved[i]), strain
                ),
                "error": pictures.error_map(
                    Surface(rest + found.moved[i], found.faces),
                    found.error[i],
                    name,
                    view,
                    found.highest,
                ),
                "mean_error": found.mean(i),
            }
        )
    return out
