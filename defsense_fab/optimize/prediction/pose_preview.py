"""Preview poses while a person changes them, and follow their ramps.

A coarse shape appears at once, and then the shape that a build would find.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.build_folder import finished_build
from ...core.device.device import Device, MaterialSpec, Pose
from ...core.device.regions import Shape
from ...core.errors import DeviceError, MeshingError, SolveError
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
from ...store.fields import load_levels
from ...store.mesh import FILE, RECORD, load_mesh, load_mesh_record, load_region_nodes

RAMP_SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)  # solved if no build has simulated the pose
#: Remedy for a pose that cannot be solved.
_ADVICE = "Lower its movement or load, enlarge its regions, or refine the mesh"
_SAME_POSE_RTOL = 1e-4  # of the body's size, by which fields of one pose may differ
_OTHER_EQUILIBRIUM_RTOL = 0.01  # of the body's size, from which shapes are different equilibria


@dataclass(frozen=True)
class Ramp:
    """A pose along its ramp.

    Attributes:
        shares: (f,) increasing shares of the ramp, above 0.
        moved: (f, v, 3) mm, displacements of the surface at these shares.
        simulated: Whether a build simulated them.
        remark: What was found on the way, for people; empty if nothing.
        code: Kind of the remark: `"ramp-incomplete"`, `"other-equilibrium"` or empty.
    """

    shares: Float
    moved: Float
    simulated: bool
    remark: str = ""
    code: str = ""

    def at(self, share: float) -> Float:
        """Return the displacements (v, 3) mm at a share from 0 to the largest, by splines."""
        from scipy.interpolate import CubicSpline

        whole = np.concatenate([np.zeros((1, *self.moved.shape[1:])), self.moved])
        return np.asarray(CubicSpline(np.append(0.0, self.shares), whole)(share))


def load_ramp(folder: Path, preview: PosePreview, pose: Pose, full: Float) -> Ramp | None:
    """Load the ramp of a pose from a build.

    Args:
        folder: Folder of the build.
        preview: Preview of the same body.
        pose: The pose.
        full: Displacements (v, 3) mm of the full pose in the preview.

    Returns:
        The ramp, or None if the build has no fields of the pose, has another mesh, or has simulated
        an earlier version of the pose.
    """
    levels = {s: u for s, u in load_levels(folder, pose.name).items() if 0 < s <= 1}
    if 1.0 not in levels:
        return None
    shares = sorted(levels)
    if len(levels[1.0]) != preview.nodes:
        return None
    moved = preview.on_surface(np.array([levels[s] for s in shares]))
    difference = float(np.abs(moved[-1] - full).max())
    if difference > _SAME_POSE_RTOL * preview.size:
        return None
    return Ramp(np.array(shares), moved, True)


def follow_ramp(
    preview: PosePreview,
    pose: Pose,
    full: Float | None = None,
    stop: Stop | None = None,
    on_frame: Callable[[float, Float], None] | None = None,
) -> Ramp | None:
    """Solve the ramp of a pose from rest, as a build does.

    Args:
        preview: Preview of the body.
        pose: The pose.
        full: Displacements (v, 3) mm to which the user has led the pose; another equilibrium is
            remarked on.
        stop: Returns True to cancel.
        on_frame: Called with each share and its displacements (v, 3) mm.

    Returns:
        The ramp, or None if it was cancelled.

    Raises:
        SolveError: If not even the first share can be solved.
    """
    frames: dict[float, Float] = {}
    remark = code = ""
    for share in RAMP_SHARES:
        found = preview.edit(
            pose, share, None, stop, check=False, from_rest=share == RAMP_SHARES[0]
        )
        if found.status is Status.CANCELLED:
            return None
        if found.moved is None:
            if not frames:
                raise SolveError(
                    _unreached_problem(pose.name, found.share),
                    code="pose-not-reached",
                    action=_ADVICE,
                    pose=pose.name,
                    share=found.share,
                )
            code = "ramp-incomplete"
            remark = f"the ramp ends at {max(frames):.0%}, where the solver stopped"
            break
        frames[share] = found.moved
        if on_frame:
            on_frame(share, found.moved)
    if full is not None and 1.0 in frames:
        distance = float(np.linalg.norm(frames[1.0] - full, axis=1).max())
        if distance > _OTHER_EQUILIBRIUM_RTOL * preview.size:
            code = "other-equilibrium"
            remark = (
                f"from rest the body ends {distance:.1f} mm away from the shape that you led it to:"
                " there is more than one equilibrium"
            )
    return Ramp(np.array(list(frames)), np.array(list(frames.values())), False, remark, code)


def unreached_message(pose: str, share: float) -> str:
    """Return the message for a pose that was solved only up to a share of its ramp.

    Args:
        pose: Name of the pose.
        share: The share that was reached.
    """
    return f"{_unreached_problem(pose, share)}. {_ADVICE}."


def _unreached_problem(pose: str, share: float) -> str:
    return f"`{pose}` cannot be solved beyond {share:.0%} of its ramp"


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


class PosePreview:
    """Solves poses of one built body quickly; not thread-safe.

    Call `close` to release the factorizations.

    Args:
        device: The device.
        fine: Mesh of the build.
        coarse: Coarse mesh for quick answers; None for fine answers only.
        kept: Names of the regions that the fine mesh was made for as they are now.
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
        fine = self._made if is_unchanged else conform_to_regions(self._made, shapes)
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

    def _previewed(self, found: Equilibrium, amplitude: float) -> PreviewedPose:
        state, centers = found.state, dict[str, Float]()
        if state is not None:
            handles = zip(state.conditions.handles, state.translations, strict=True)
            centers = {h.name: np.asarray(h.center + shift) for h, shift in handles}
        return PreviewedPose(
            None if found.u is None else self.on_surface(found.u),
            found.status,
            found.problem,
            found.amplitude * amplitude,
            centers,
        )


def load_preview(device: Device, threads: int = 1) -> PosePreview:
    """Create the preview of a built device, without the coarse mesh, which may take seconds.

    Args:
        device: The device.
        threads: Number of threads.

    Raises:
        CaptureError: If the device is not built.
        StorageError: If files of the build cannot be read.
    """
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
