"""Preview poses while a person changes them.

A coarse shape appears at once, and then the shape that a build would find.
"""

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
from ...geometry.bodies.meshing.tetrahedra import check_edge_length as check_edge_length
from ...geometry.bodies.meshing.tetrahedra import tetrahedralize
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh, boundary_faces
from ...mechanics.elements.threads import count_cores
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.constraint_check import check_constraints
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.interactive import VISUAL_TOLERANCE, InteractiveSolver, Stop
from ...mechanics.solver.load_stepping import Equilibrium, Status
from ...mechanics.solver.newton import TOLERANCE
from ...store.body import load_surface
from ...store.mesh import FILE, RECORD, load_mesh, load_mesh_record, load_region_nodes

#: Ratio of the edge lengths of the coarse and the fine mesh: it has at most 1/15 of the tets.
COARSENING = 2.5


@dataclass(frozen=True)
class PreviewedPose:
    """A pose as solved for the preview.

    Attributes:
        moved: (v, 3) mm, displacements of the surface's vertices, None if it was not reached.
        status: Status of the solver.
        problem: What is wrong with the equilibrium, for people.
        share: Share of the ramp that was reached.
        centers: (3,) mm, positions of the centers of moved regions, by region.
    """

    moved: Float | None
    status: Status
    problem: str | None
    share: float
    centers: Mapping[str, Float]

    @property
    def is_cancelled(self) -> bool:
        """Whether the solver was stopped before it had finished."""
        return self.status is Status.CANCELLED


class PosePreview:
    """Solves poses of one built body quickly; not thread-safe.

    Call `close` to release the factorizations.

    Args:
        device: The device.
        fine: Mesh of the build.
        coarse: Coarse mesh for quick answers; None for fine answers only.
        kept: Names of the regions that have not changed since the fine mesh was made.
        threads: Number of threads.

    Attributes:
        device: The current device.
        faces: (f, 3) triangles of the surface.
    """

    def __init__(
        self,
        device: Device,
        fine: TetMesh,
        coarse: TetMesh | None,
        kept: frozenset[str] = frozenset(),
        threads: int = 1,
    ) -> None:
        self._built_mesh, self._coarse, self._threads = fine, coarse, threads
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
        """Surface of the fine mesh at rest, conformed to the device's regions."""
        return Surface(self._fine.nodes[self._used], self.faces)

    @property
    def nodes(self) -> int:
        """Number of nodes of the fine mesh."""
        return len(self._fine.nodes)

    @property
    def size(self) -> float:
        """The body's largest extent, mm."""
        return float(np.ptp(self._fine.nodes, axis=0).max())

    def on_surface(self, fields: Float) -> Float:
        """Select the displacements (..., v, 3) of the surface from (..., n, 3) of all nodes."""
        return np.asarray(fields[..., self._used, :])

    def take(self, device: Device) -> bool:
        """Continue with a changed device.

        Returns:
            Whether its regions or material have changed.
        """
        key = _key(device.regions, device.material)
        self.device = device
        if key == self._key:
            return False
        self._key = key
        self.close()
        shapes = list(device.regions.values())
        is_unchanged = all(
            n in self._fits and _is_same_shape(s, self._fits[n]) for n, s in device.regions.items()
        )
        fine = self._built_mesh if is_unchanged else conform_to_regions(self._built_mesh, shapes)
        self._fine = QuadraticMesh.from_linear(fine)
        self._coarse_mesh = None
        if self._coarse is not None:
            self._coarse_mesh = QuadraticMesh.from_linear(conform_to_regions(self._coarse, shapes))
        return True

    @property
    def has_coarse(self) -> bool:
        """Whether quick coarse answers are available."""
        return self._coarse is not None

    def take_coarse(self, coarse: TetMesh) -> None:
        """Add a coarse mesh for quick answers."""
        self._coarse = coarse
        self._coarse_mesh = QuadraticMesh.from_linear(
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
    ) -> PreviewedPose:
        """Solve a pose.

        Args:
            pose: The pose.
            amplitude: Share of its ramp.
            on_coarse: Called with the coarse answer, displacements (v, 3) mm of the surface.
            stop: Returns True to cancel.
            newer: Returns True to cancel only the fine answer, when a newer pose waits.
            check: Solve as accurately as a build, and check that the equilibrium is valid.
            from_rest: Start from rest, as a build does, instead of the last pose.

        Raises:
            DeviceError: If the body cannot have the pose.
        """

        def conditions(mesh: QuadraticMesh) -> BoundaryConditions:
            d = self.device
            return mix_poses([pose], {pose.name: amplitude}, d.regions, mesh, d.material.density)

        goal = conditions(self._fine)
        if self._session is None or self._checked != goal.structure:
            check_constraints(self._fine, goal, pose.name)
            self._start_session(conditions)
            self._checked = goal.structure
        assert self._session is not None
        report_coarse = on_coarse and (lambda u: on_coarse(self.on_surface(u)))
        tolerance = TOLERANCE if check else VISUAL_TOLERANCE
        equilibrium = self._session.edit(
            conditions, report_coarse, stop, check, newer, from_rest, tolerance
        )
        return self._previewed(equilibrium, amplitude)

    def close(self) -> None:
        """Release the factorizations."""
        if self._session is not None:
            self._session.close()
        self._session = self._checked = None

    def _start_session(self, conditions: Callable[[QuadraticMesh], BoundaryConditions]) -> None:
        self.close()
        low = self._coarse_mesh
        if low is not None:
            try:
                conditions(low)
            except DeviceError:  # the mesh is too coarse for the pose's regions
                low = None
        material = Material.from_spec(self.device.material)
        self._session = InteractiveSolver(low, self._fine, material, self._threads)

    def _previewed(self, equilibrium: Equilibrium, amplitude: float) -> PreviewedPose:
        state, centers = equilibrium.state, dict[str, Float]()
        if state is not None:
            handles = zip(state.conditions.handles, state.translations, strict=True)
            centers = {h.name: np.asarray(h.center + shift) for h, shift in handles}
        return PreviewedPose(
            None if equilibrium.u is None else self.on_surface(equilibrium.u),
            equilibrium.status,
            equilibrium.problem,
            equilibrium.amplitude * amplitude,
            centers,
        )


def load_preview(device: Device, threads: int | None = None) -> PosePreview:
    """Create the preview of a built device, without the coarse mesh, which may take seconds.

    Args:
        device: The device.
        threads: Number of threads; by default one fewer than there are cores, because a solver
            with as many threads as cores waits for the program that shows its shapes.

    Raises:
        CaptureError: If the device is not built.
        StorageError: If files of the build cannot be read.
    """
    if threads is None:
        threads = max(count_cores() - 1, 1)
    folder = finished_build(device, FILE, RECORD)
    fine, made_for = load_mesh(folder), load_region_nodes(folder)
    kept = frozenset(
        name
        for name, shape in device.regions.items()
        if name in made_for and np.array_equal(made_for[name], shape.contains(fine.nodes))
    )
    return PosePreview(device, fine, None, kept, threads)


def load_coarse_mesh(
    device: Device, on_step: Callable[[str], None] | None = None
) -> TetMesh | None:
    """Return a coarse mesh of a built device, for quick answers; it is cached on this machine.

    Args:
        device: The device.
        on_step: Called with a description of each step of the mesher.

    Returns:
        The mesh, or None if meshing fails at this edge length.

    Raises:
        CaptureError: If the device is not built.
        StorageError: If files of the build cannot be read.
    """
    folder = finished_build(device, FILE, RECORD)
    edge = load_mesh_record(folder).edge_length
    if edge is None:  # a device without poses has a mesh only to propose some
        edge = QuadraticMesh.from_linear(load_mesh(folder)).edge_length
    surface, edge = load_surface(folder), COARSENING * edge
    tetrahedra = mesh_store.load_cached_mesh(surface, edge, device.mesh.time_limit)
    if tetrahedra is None:
        try:
            tetrahedra = tetrahedralize(surface, edge, on_step, device.mesh.time_limit)
        except MeshingError:
            return None
        mesh_store.cache_mesh(surface, edge, tetrahedra)
    return tetrahedra.mesh


def _key(regions: Mapping[str, Shape], material: MaterialSpec) -> object:
    return tuple((n, repr(s)) for n, s in regions.items()), repr(material)


def _is_same_shape(a: Shape, b: Shape) -> bool:
    return repr(a) == repr(b)
