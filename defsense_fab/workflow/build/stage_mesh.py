"""Stage 2: tetrahedra and the tags of the regions."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from ...core.device.device import Device
from ...core.errors import DeviceError
from ...core.mesh import Surface, TetMesh
from ...geometry.bodies import regions
from ...geometry.bodies.meshing import mesh_lock, mesh_store
from ...geometry.bodies.meshing.mesh_quality import measure_quality
from ...geometry.bodies.meshing.region_conforming import conform_to_regions
from ...geometry.bodies.meshing.meshers import FTETWILD
from ...geometry.bodies.meshing.tetrahedra import Tetrahedra, tetrahedralize
from ...store.build import Build
from ...store.mesh import Accuracy, DensityTrial, MeshRecord, save_mesh
from . import mesh_density
from .stages import Report


def run(device: Device, build: Build, report: Report) -> None:
    """Make the tetrahedra at the requested density, and tag the nodes of the regions."""
    surface = build.surface
    _check_regions(device, surface)
    limit = device.mesh.time_limit
    kept_before = mesh_lock.read(device.source)
    locked = {k: made for k, made in kept_before.items() if not made.is_outgrown(limit)}
    used: dict[float, Tetrahedra] = {}

    def make(edge_length: float) -> TetMesh:
        key = mesh_lock.key(surface, edge_length)
        if key in locked:
            made: Tetrahedra | None = locked[key]
        else:
            made = mesh_store.recall(surface, edge_length, limit)
        if made is None:
            made = tetrahedralize(surface, edge_length, lambda m: report(0.3, m), limit)
            mesh_store.remember(surface, edge_length, made)
        used[edge_length] = made
        return conform_to_regions(made.mesh, list(device.regions.values()))

    edge_length, accuracy = device.mesh.edge_length, None
    if edge_length is not None:
        mesh = make(edge_length)
    elif not device.poses:  # looking for poses: what they will need is not known yet
        mesh = make(mesh_density.coarse_edge(surface) / mesh_density.RATIO)
    else:
        assert device.mesh.accuracy is not None
        choice = mesh_density.choose(device, surface, device.mesh.accuracy, make, report)
        mesh, edge_length = choice.taken.mesh, choice.taken.edge_length
        accuracy = Accuracy(
            device.mesh.accuracy,
            _known(choice.taken.error),
            tuple(
                DensityTrial(t.edge_length, len(t.mesh.tets), _known(t.error))
                for t in choice.trials
            ),
        )
    report(0.8, "measuring quality")
    tags = {name: shape.contains(mesh.nodes) for name, shape in device.regions.items()}
    for name, inside in tags.items():
        if not inside.any():
            raise DeviceError(
                f"device.toml: regions.{name}: contains no nodes of the mesh, being smaller than"
                " its edges; enlarge it, or use a smaller [mesh] edge_length"
            )
    found = asdict(measure_quality(mesh, surface))
    taken = used[edge_length] if edge_length else next(iter(used.values()))
    record = MeshRecord(
        hash=mesh.digest, edge_length=edge_length, accuracy=accuracy, mesher=taken.mesher,
        note=_note(taken), way=taken.way, tried=taken.tried, surface=taken.surface, **found,
    )  # fmt: skip
    build.mesh, build.region_nodes, build.mesh_record = mesh, tags, record
    save_mesh(build.folder, mesh, tags, record)
    kept = {
        mesh_lock.key(surface, edge): made for edge, made in used.items() if not made.repeatable
    }
    new = kept.keys() - locked.keys()
    if new or len(locked) < len(kept_before):
        mesh_lock.write(device.source, kept if new else locked)
    if new:
        report(0.9, f"{mesh_lock.FILE} keeps the mesh, which cannot be made again: it belongs to"
                    " the device as device.toml does")  # fmt: skip


def _note(made: Tetrahedra) -> str:
    """What a reader of the report should know of how the mesh was made."""
    notes = []
    if made.surface:
        s = made.surface
        notes.append(
            f"The mesh has a surface of {s.triangles:,} triangles instead of the body's {s.of:,},"
            f" at most {s.deviation:.2g} mm from it; the parts keep the body's own surface."
        )
    if not made.repeatable:
        why = "made by fTetWild, which repeats none"
        if made.mesher != FTETWILD:
            why = (
                "made after a mesher was stopped for want of time or memory, as may not happen"
                " elsewhere"
            )
        notes.append(f"{mesh_lock.FILE} keeps the mesh, {why}.")
    if made.tried:
        notes.append(f"It was made by {made.way}. Tried before: {'; '.join(made.tried)}.")
    return " ".join(notes)


def _check_regions(device: Device, surface: Surface) -> None:
    """Before anything is meshed. Raises DeviceError for a region that holds nothing of the body."""
    for name, shape in device.regions.items():
        if regions.holds_body(shape, surface):
            continue
        poses = [
            p.name for p in device.poses if name in p.fixed or name in [h.region for h in p.handles]
        ]
        used = f" (used by the pose{'s' * (len(poses) > 1)} {', '.join(poses)})" if poses else ""
        raise DeviceError(
            f"device.toml: regions.{name}: holds nothing of the body{used}: it is"
            f" {regions.describe_region(shape)}, and the body lies {regions.describe_extent(surface)};"
            " move it to where the body is"
        )


def _known(error: float) -> float | None:
    return error if np.isfinite(error) else None
