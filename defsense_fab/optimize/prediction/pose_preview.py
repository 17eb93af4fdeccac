"""Poses as a person changes them: a coarse shape at once, and the one that a build would find."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.build_folder import finished_build
from ...core.device.device import Device, MaterialSpec, Pose
from ...core.device.regions import Shape
from ...core.errors import DeviceError, MeshingError
from ...core.mesh import Surface, TetMesh
from ...geometry.bodies.meshing import mesh_store
from ...geometry.bodies.meshing.region_conforming import conform_to_regions
from ...geometry.bodies.meshing.tetrahedra import tetrahedralize
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh, boundary_faces
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.constraint_check import check_constraints
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.interactive import VISUAL_TOLERANCE, InteractiveSolver, Stop
from ...mechanics.solver.load_stepping import Equilibrium, Status
from ...mechanics.solver.newton import TOLERANCE
from ...store.body import load_surface
from ...store.mesh import FILE, RECORD, load_mesh, load_mesh_record, load_region_nodes

#: Edge length of the coarse mesh, in edges of the fine one: a fifteenth of its tets or less.
COARSER = 2.5


@dataclass(frozen=True)
class Previewed:
    """What came of a pose: displacements `moved` (v, 3) mm of the surface's vertices, None where it
    was not reached; the solver's `status` and what it objects to, or None; the `share` of the ramp
    that was reached; where the centres of moved regions are, (3,) mm, by region."""

    moved: Float | None
    status: Status
    problem: str | None
    share: float
    centers: Mapping[str, Float]


class PosePreview:
    """Of one built body, `fine` being the build's mesh. One thread at a time; `close` it."""

    def __init__(
        self,
        device: Device,
        fine: TetMesh,
        coarse: TetMesh | None,
        kept: frozenset[str] = frozenset(),
        threads: int = 1,
    ) -> None:
        """`kept` names regions for which the fine mesh was made as they are now."""
        self._made, self._coarse, self._threads = fine, coarse, threads
        self._fits = {n: s for n, s in device.regions.items() if n in kept}
        self._key: object = None
        self._session: InteractiveSolver | None = None
        self._checked: object = None
        faces = boundary_faces(QuadraticMesh.from_linear(fine))[:, :3]
        self._used, inverse = np.unique(faces, return_inverse=True)
        self.faces: Int = inverse.reshape(faces.shape)
        self.take(device)

    @property
    def surface(self) -> Surface:
        """That of the fine mesh at rest, as the device's regions have it."""
        return Surface(self._fine.nodes[self._used], self.faces)

    @property
    def nodes(self) -> int:
        """How many the fine mesh has."""
        return len(self._fine.nodes)

    @property
    def size(self) -> float:
        """The body's largest extent, mm."""
        return float(np.ptp(self._fine.nodes, axis=0).max())

    def on_surface(self, fields: Float) -> Float:
        """Displacements (..., v, 3) of the surface's vertices, from those of all nodes (..., n, 3)
        of the build's mesh."""
        return np.asarray(fields[..., self._used, :])

    def take(self, device: Device) -> bool:
        """Go on with a device whose regions or material may have changed; whether they have."""
        key = _key(device.regions, device.material)
        self.device = device
        if key == self._key:
            return False
        self._key = key
        self.close()
        shapes = list(device.regions.values())
        same = all(n in self._fits and _same(s, self._fits[n]) for n, s in device.regions.items())
        fine = self._made if same else conform_to_regions(self._made, shapes)
        self._fine = QuadraticMesh.from_linear(fine)
        self._low = None
        if self._coarse is not None:
            self._low = QuadraticMesh.from_linear(conform_to_regions(self._coarse, shapes))
        return True

    @property
    def has_coarse(self) -> bool:
        """Whether there are coarse answers."""
        return self._coarse is not None

    def take_coarse(self, coarse: TetMesh) -> None:
        """Give coarse answers, too, from now on."""
        self._coarse = coarse
        self._low = QuadraticMesh.from_linear(
            conform_to_regions(coarse, list(self.device.regions.values()))
        )
        self.close()

    def edit(
        self,
        pose: Pose,
        amplitude: float = 1.0,
        on_coarse: Callable[[Float], None] | None = None,
        stop: Stop | None = None,
        newer: Stop | None = None,
        *,
        check: bool = True,
        from_rest: bool = False,
    ) -> Previewed:
        """The pose at a share `amplitude` of its ramp; `on_coarse` gets displacements (v, 3) mm of
        the surface before.

        `stop` ends it, `newer` ends the fine answer alone; `check` finds it as exactly as builds
        do, and looks for what is in equilibrium and yet none that a body takes; `from_rest` leads
        there as a build does, and not from the last pose. Raises DeviceError for a pose that the
        body cannot have.
        """

        def conditions(mesh: QuadraticMesh) -> BoundaryConditions:
            d = self.device
            return mix_poses([pose], {pose.name: amplitude}, d.regions, mesh, d.material.density)

        goal = conditions(self._fine)
        if self._session is None or self._checked != goal.structure:
            check_constraints(self._fine, goal, pose.name)
            self._begin(conditions)
            self._checked = goal.structure
        assert self._session is not None
        told = on_coarse and (lambda u: on_coarse(self.on_surface(u)))
        tolerance = TOLERANCE if check else VISUAL_TOLERANCE
        found = self._session.edit(conditions, told, stop, check, newer, from_rest, tolerance)
        return self._previewed(found, amplitude)

    def close(self) -> None:
        """Release the factorisations."""
        if self._session is not None:
            self._session.close()
        self._session = self._checked = None

    def _begin(self, conditions: Callable[[QuadraticMesh], BoundaryConditions]) -> None:
        self.close()
        low = self._low
        if low is not None:
            try:
                conditions(low)
            except DeviceError:  # it is too coarse for the pose's regions
                low = None
        material = Material.from_spec(self.device.material)
        self._session = InteractiveSolver(low, self._fine, material, self._threads)

    def _previewed(self, found: Equilibrium, amplitude: float) -> Previewed:
        state, centers = found.state, dict[str, Float]()
        if state is not None:
            handles = zip(state.conditions.handles, state.translations, strict=True)
            centers = {h.name: np.asarray(h.center + shift) for h, shift in handles}
        return Previewed(
            None if found.u is None else self.on_surface(found.u),
            found.status,
            found.problem,
            found.amplitude * amplitude,
            centers,
        )


def load_preview(device: Device, threads: int = 1) -> PosePreview:
    """Of the device's build, which must have a mesh; without the coarse mesh, which takes seconds
    where it is not kept on this machine. Raises CaptureError without a build, StorageError."""
    folder = finished_build(device, FILE, RECORD)
    fine, made_for = load_mesh(folder), load_region_nodes(folder)
    kept = frozenset(
        name
        for name, shape in device.regions.items()
        if name in made_for and np.array_equal(made_for[name], shape.contains(fine.nodes))
    )
    return PosePreview(device, fine, None, kept, threads)


def coarse_mesh(device: Device, on_step: Callable[[str], None] | None = None) -> TetMesh | None:
    """Of the device's build, for quick answers; kept on this machine. None where the body has no
    mesh that coarse: it is to be seen soon, and not at any price. Raises CaptureError, StorageError
    without a build."""
    folder = finished_build(device, FILE, RECORD)
    edge = load_mesh_record(folder).edge_length
    if edge is None:  # of a device without poses, which has a mesh to look for some
        edge = QuadraticMesh.from_linear(load_mesh(folder)).edge_length
    surface, edge = load_surface(folder), COARSER * edge
    made = mesh_store.recall(surface, edge, device.mesh.time_limit)
    if made is None:
        try:
            made = tetrahedralize(surface, edge, on_step, device.mesh.time_limit)
        except MeshingError:
            return None
        mesh_store.remember(surface, edge, made)
    return made.mesh


def _key(regions: Mapping[str, Shape], material: MaterialSpec) -> object:
    return tuple((n, repr(s)) for n, s in regions.items()), repr(material)


def _same(a: Shape, b: Shape) -> bool:
    return repr(a) == repr(b)
