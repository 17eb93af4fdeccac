"""Stage 2: make the tetrahedra, and tag the nodes of the regions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial

import numpy as np

from ...core.device.device import Device
from ...core.errors import DeviceError
from ...core.mesh import Surface, TetMesh
from ...geometry.bodies import regions
from ...geometry.bodies.meshing import mesh_store
from ...geometry.bodies.meshing.mesh_quality import measure_quality
from ...geometry.bodies.meshing.meshers import FTETWILD
from ...geometry.bodies.meshing.region_conforming import conform_to_regions
from ...geometry.bodies.meshing.tetrahedra import Tetrahedra, tetrahedralize
from ...mechanics.solver.batch import Solve, solve_all
from ...mechanics.solver.solved_jobs import keep_solved_jobs
from ...optimization.prediction.design_task import check_exits
from ...store.build import Build
from ...store.mesh import Accuracy, DensityTrial, MeshRecord, save_mesh
from . import mesh_density
from .stages import CODE_VERSION, Report

MESHING_FRACTION = 0.3  # of the stage, at messages of the mesher and the solver


def run(device: Device, build: Build, report: Report, solve: Solve = solve_all) -> None:
    """Make the tetrahedra at the requested density, and tag the nodes of the regions.

    Poses that are solved to find the density are kept until the mesh is saved.

    Args:
        device: The device.
        build: Results of the earlier stages.
        report: Receives the completed fraction and a message.
        solve: `solve_all`, or a function that does the same elsewhere.

    Raises:
        DeviceError: A region contains no part of the body, or no node of the mesh.
        MeshingError: The body cannot be meshed.
    """
    _check_regions(device, build.surface)
    check_exits(device, build.surface)
    source = _MeshSource(device, build.surface, report)
    with keep_solved_jobs(("mesh", CODE_VERSION), partial(report, MESHING_FRACTION)) as kept:
        _save_mesh(device, build, source, report, partial(kept.solve, solve))
    if source.lock_meshes():
        report(
            0.9,
            f"{mesh_store.DEVICE_MESH} keeps the mesh, which cannot be made again. It belongs to"
            " the device, as device.toml does",
        )


def _save_mesh(
    device: Device, build: Build, source: _MeshSource, report: Report, solve: Solve
) -> None:
    """Make the mesh, tag the nodes of the regions, and save both.

    Raises:
        DeviceError: A region contains no node of the mesh.
    """
    surface = build.surface
    mesh, edge_length, accuracy = _make_mesh(device, surface, source.make, report, solve)
    report(0.8, "measuring quality")
    tags = {name: shape.contains(mesh.nodes) for name, shape in device.regions.items()}
    placed = _regions_of_cords(device)
    for name, inside in tags.items():
        if not inside.any() and name not in placed:
            raise DeviceError(
                f"region {name!r} contains no nodes of the mesh, as it is smaller than the edges of"
                " the mesh",
                code="region-without-nodes",
                where=f"device.toml: regions.{name}",
                action="Enlarge it, or use a smaller [mesh] edge_length",
                region=name,
                key=f"regions.{name}",
            )
    quality = asdict(measure_quality(mesh, surface))
    used = source.used
    tets = used[edge_length] if edge_length else next(iter(used.values()))
    record = MeshRecord(
        hash=mesh.digest,
        edge_length=edge_length,
        accuracy=accuracy,
        mesher=tets.mesher,
        note=_note(tets),
        way=tets.way,
        tried=tets.tried,
        surface=tets.surface,
        **quality,
    )
    build.mesh, build.region_nodes, build.mesh_record = mesh, tags, record
    save_mesh(build.folder, mesh, tags, record)


class _MeshSource:
    """Makes meshes of a body, or takes them from `device.mesh` or from the cache.

    Attributes:
        used: The tetrahedra that were returned, by edge length.
    """

    def __init__(self, device: Device, surface: Surface, report: Report) -> None:
        self._device, self._surface, self._report = device, surface, report
        self._limit = device.mesh.time_limit
        self._in_file = mesh_store.read_meshes(device.source)
        self._locked = {
            k: tets for k, tets in self._in_file.items() if not tets.is_outgrown(self._limit)
        }
        self.used: dict[float, Tetrahedra] = {}

    def make(self, edge_length: float) -> TetMesh:
        """Return the mesh of an edge length in mm, whose facets end at the borders of regions."""
        surface, limit = self._surface, self._limit
        key = mesh_store.mesh_key(surface, edge_length)
        if key in self._locked:
            tets: Tetrahedra | None = self._locked[key]
        else:
            tets = mesh_store.load_cached_mesh(surface, edge_length, limit)
        if tets is None:
            tets = tetrahedralize(
                surface, edge_length, partial(self._report, MESHING_FRACTION), limit
            )
            mesh_store.cache_mesh(surface, edge_length, tets)
        self.used[edge_length] = tets
        return conform_to_regions(tets.mesh, list(self._device.regions.values()))

    def lock_meshes(self) -> bool:
        """Write meshes that cannot be repeated to `device.mesh`.

        Returns:
            Whether one of them is new.
        """
        kept = {
            mesh_store.mesh_key(self._surface, edge): tets
            for edge, tets in self.used.items()
            if not tets.repeatable
        }
        new = kept.keys() - self._locked.keys()
        if new or len(self._locked) < len(self._in_file):
            mesh_store.write_meshes(self._device.source, kept if new else self._locked)
        return bool(new)


def _make_mesh(
    device: Device,
    surface: Surface,
    make: Callable[[float], TetMesh],
    report: Report,
    solve: Solve,
) -> tuple[TetMesh, float | None, Accuracy | None]:
    """Return the mesh, its edge length in mm, and how it was chosen."""
    edge_length, accuracy = device.mesh.edge_length, device.mesh.accuracy
    if edge_length is not None:
        return make(edge_length), edge_length, None
    if not device.poses:  # to find poses, whose needs are not known yet
        edge = mesh_density.coarse_edge(surface) / mesh_density.EDGE_RATIO
        return make(edge), None, None
    assert accuracy is not None
    choice = mesh_density.choose_mesh(device, surface, accuracy, make, report, solve)
    trials = tuple(
        DensityTrial(t.edge_length, len(t.mesh.tets), _finite(t.error)) for t in choice.trials
    )
    chosen = choice.chosen
    return chosen.mesh, chosen.edge_length, Accuracy(accuracy, _finite(chosen.error), trials)


def _note(tets: Tetrahedra) -> str:
    """Return notes for the report on how the mesh was made."""
    notes = []
    if tets.surface:
        s = tets.surface
        notes.append(
            f"The mesh has a surface of {s.triangles:,} triangles instead of the body's {s.of:,},"
            f" at most {s.deviation:.2g} mm from it; the parts keep the body's own surface."
        )
    if not tets.repeatable:
        reason = "as fTetWild gives a different mesh each time"
        if tets.mesher != FTETWILD:
            reason = (
                "as another mesher was stopped by the limits of time or memory, which may not"
                " happen elsewhere"
            )
        notes.append(f"{mesh_store.DEVICE_MESH} keeps the mesh, {reason}.")
    if tets.tried:
        notes.append(f"It was made by {tets.way}. Tried before: {'; '.join(tets.tried)}.")
    return " ".join(notes)


def _regions_of_cords(device: Device) -> set[str]:
    """Return the regions that limit cords alone, and so need no nodes of the mesh."""
    held = {device.outputs.anchor}
    for pose in device.poses:
        held |= {*pose.fixed, *(handle.region for handle in pose.handles)}
        held |= {*(s.region for s in pose.symmetry), *(p.region for p in pose.pressures)}
    return {*device.exits, *device.fabrication.keep_whole} - held


def _check_regions(device: Device, surface: Surface) -> None:
    """Raise DeviceError for a region that contains no part of the body."""
    for name, shape in device.regions.items():
        if regions.holds_body(shape, surface):
            continue
        poses = [
            p.name for p in device.poses if name in p.fixed or name in [h.region for h in p.handles]
        ]
        use = f" (used by the pose{'s' * (len(poses) > 1)} {', '.join(poses)})" if poses else ""
        raise DeviceError(
            f"region {name!r} contains no part of the body{use}; it is"
            f" {regions.describe_region(shape)}, and the body extends"
            f" {regions.describe_extent(surface)}",
            code="region-outside-body",
            where=f"device.toml: regions.{name}",
            action="Move it to the body",
            region=name,
            key=f"regions.{name}",
            poses=tuple(poses),
        )


def _finite(error: float) -> float | None:
    return error if np.isfinite(error) else None
