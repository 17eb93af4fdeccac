"""Stage 6: a self-contained page with pictures and predicted errors, and the assembly guide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from ...core.arrays import Bool, Float
from ...core.device import Device
from ...core.mesh import Surface
from ...decoding.decoders import fit_decoder
from ...decoding.unseen import MEANING, unseen_states
from ..artifacts.body import load_surface
from ..artifacts.fields import field_path, load_fields, load_index, load_strain
from ..artifacts.layout import LayoutRecord, load_layout, load_prediction
from ..artifacts.manifest import load_manifest
from ..artifacts.mesh import load_mesh, load_mesh_record
from ..report import pictures
from ..report.guide import assembly_guide
from ..report.guide_pdf import write_pdf
from ..report.html import write_page
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
    parts = {p.name: _stl(folder / "parts" / p.stl) for p in manifest.parts}
    guide = assembly_guide(device, layout, manifest, parts, view)
    write_page(folder / "guide.html", "guide", guide=guide)
    write_pdf(guide, folder / "guide.pdf")
    images["parts"] = guide.exploded
    images["front"] = pictures.front(layout.weighed)
    images["poses"] = _poses(folder, layout, view, report)
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
        colors=pictures.COLORS,
        max=max,
    )


def _stl(path: Path) -> Surface:
    mesh = trimesh.load_mesh(path)
    return Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def _view(surface: Surface) -> Float:
    """Camera direction that shows a long body from the side and above."""
    long = int(np.ptp(surface.bounds, axis=0).argmax())
    return np.array([1.0, 0.35, 0.55]) if long == 1 else np.array([0.35, -1.0, 0.55])


def _section(rest: Float, u: Float) -> Float:
    """Normal of the section: of the two short axes the one along which the body moves least."""
    axes = np.argsort(np.ptp(rest, axis=0))[:2]
    return np.asarray(np.eye(3)[axes[(u[:, axes] ** 2).sum(0).argmin()]])


def _fullest(weights: Sequence[Mapping[str, float]], held_out: Bool) -> list[int]:
    """Of each path of loading among states that are not held out, the one furthest along."""
    seen = np.flatnonzero(~held_out)
    paths = unseen_states(
        ({}, *(w for w, held in zip(weights, held_out, strict=True) if not held)),
        np.zeros(len(seen) + 1, bool),
    ).paths
    return sorted(int(seen[int(k[at.argmax()]) - 1]) for k, at in paths)


def _poses(folder: Path, layout: LayoutRecord, view: Float, report: Report) -> list[dict[str, Any]]:
    """Strain section and error map of each pose and mixture that was designed for, at its fullest,
    and of the held-out state that is sensed worst."""
    found = load_fields(folder)
    names, fields = found.names, found.displacements
    boundary = load_mesh(folder).boundary()
    used = np.unique(boundary.faces)
    index = np.zeros(len(boundary.vertices), int)
    index[used] = np.arange(len(used))
    rest, faces = boundary.vertices[used], index[boundary.faces]
    signals, told = load_prediction(folder).signals, layout.prediction
    moved = np.concatenate([np.zeros((1, *rest.shape)), fields[:, used]])
    seen = ~np.append(False, found.held_out)
    flat = moved.reshape(len(moved), -1)
    decoder = fit_decoder(told.decoder, signals[seen], flat[seen], np.array(told.noise))
    error = np.linalg.norm(decoder(signals).reshape(moved.shape) - moved, axis=2)[1:]
    shown = _fullest(found.weights, found.held_out)
    held_out = np.flatnonzero(found.held_out)
    if len(held_out):
        shown.append(int(held_out[(error[held_out] ** 2).mean(axis=1).argmax()]))
    highest = float(np.percentile(error[shown], 99.5))
    out = []
    center = np.asarray(rest.min(0) + rest.max(0)) / 2
    for k, i in enumerate(shown):
        name = names[i]
        report(0.3 + 0.7 * k / len(shown), name)
        strain = 100 * float(np.percentile(load_strain(folder, name), 99.5))
        out.append(
            {
                "name": name,
                "strain": pictures.strain_section(
                    field_path(folder, name), name, center, _section(rest, fields[i][used]), strain
                ),
                "error": pictures.error_map(
                    Surface(rest + fields[i][used], faces), error[i], name, view, highest
                ),
                "mean_error": float(np.sqrt((error[i] ** 2).mean())),
            }
        )
    return out
