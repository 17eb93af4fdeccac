"""Displacement fields of a device for its twin, simulated again with another mesh and material.

The mesh is finer and the material law is another one, so that a twin does not agree with the
simulation that the device was designed with.
"""

from __future__ import annotations

import shutil
import threading
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.device.build_folder import finished_build
from ...core.device.device import Device, Pose
from ...core.errors import CaptureError, DeviceError
from ...core.mesh import TetMesh
from ...core.progress import Progress, silent
from ...core.storage.files import digest, replace_file, storage_errors
from ...geometry.bodies.meshing.region_conforming import conform_to_regions
from ...geometry.bodies.meshing.tetrahedra import tetrahedralize
from ...mechanics.elements.material import Material, split
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.fibers import Fibers, trace_fibers
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.batch import Job, solve_all
from ...mechanics.solver.solved_jobs import SolvedJobs, keep_solved_jobs
from ...sensing.built_cord import CordReading
from ...store.build import Build
from ...store.layout import LAYOUT, PREDICTION, layout_hash
from ...store.mesh import RECORD
from ..scenes.assumptions import assume
from ..scenes.pose_space import PoseSpace
from .pose_samples import Ray, corner_rays, draw_rays, find_mixable_poses, pose_axes, single_rays

FOLDER = "twin"
#: Version of the saved fields: raised when the same input gives other fields.
FILE_VERSION = 3
RAY_SEED = 5
MIN_POSE_LEVEL = 0.99  # of a pose's amplitude that the solver must reach
RAYS_PER_STEP = 12  # added before the error is estimated again
MAX_FIRST_STATES = 64  # solved before the error is estimated for the first time


@dataclass(frozen=True)
class MechanicsTraits:
    """Assumptions on the mechanics, and how accurately the states are sampled.

    Attributes:
        edge: Edge length of the mesh, relative to that of the design.
        stiffening: c20 / c10 of the Yeoh law.
        own_law: Whether the material law is that of the design.
        states: Number of first states for each axis of the pose space, at most 64 in all.
        max_states: Largest number of states.
        accuracy: Largest RMS error of states that are left out, at the markers, mm.
    """

    edge: float = assume(
        0.8, "mechanics", "", "edge length of the mesh, relative to that of the design", off=1.0
    )
    stiffening: float = assume(
        0.25,
        "mechanics",
        "",
        "c20 / c10 of the Yeoh law that replaces the device's law (Mooney-Rivlin replaces Yeoh),"
        " with the same moduli at small strain",
    )
    own_law: bool = assume(
        False, "mechanics", "", "whether the material law is that of the design", off=True
    )
    states: int = 16
    max_states: int = 110
    accuracy: float = 0.05


@dataclass(frozen=True)
class DeviceFields:
    """Displacement fields of a device in s states of d poses.

    Attributes:
        poses: Names of the poses (d).
        space: Interpolant of the states over the weights of the poses.
        mesh: Quadratic mesh of the body, n nodes.
        fields: Displacements (s, n, 3) mm of the nodes.
        mixable: Which poses can be mixed (d, d).
        error: RMS error of states that are left out, at the device's markers, mm.
        signal_error: RMS error of (R - R0)/R0 of states that are left out.
        warnings: States that could not be solved, and a low accuracy.
    """

    poses: tuple[str, ...]
    space: PoseSpace
    mesh: QuadraticMesh
    fields: Float
    mixable: Bool
    error: float
    signal_error: float
    warnings: tuple[str, ...]

    def displacements(self, points: Float) -> Float:
        """Return the displacements (s, p, 3) mm of points (p, 3) mm."""
        locator = PointLocator(self.mesh)
        return locator.displacement(locator.find(points), self.fields)


def solve_fields(
    device: Device,
    traits: MechanicsTraits | None = None,
    progress: Progress = silent,
    poses: Sequence[Pose] | None = None,
    build: Build | None = None,
) -> DeviceFields:
    """Solve the displacement fields of a built device, or load them if they were solved before.

    They are kept in the folder of the build.

    Args:
        device: The device.
        traits: Mesh, material and accuracy.
        progress: Called with the progress.
        poses: Poses that replace those of the device.
        build: The device's build, if it was opened before.

    Raises:
        CaptureError: The device is not built, or a pose cannot be solved (`pose-not-reached`).
    """
    traits = traits or MechanicsTraits()
    all_poses = tuple(poses or device.poses)
    folder = finished_build(device, LAYOUT, PREDICTION, RECORD)
    build = build or Build(folder)
    path = folder / FOLDER / f"{_cache_key(device, build, traits, all_poses)}.npz"
    loaded = _load(path) if path.exists() else None
    if loaded is not None:
        fields, groups = loaded
    else:
        with keep_solved_jobs((FOLDER, FILE_VERSION), partial(progress, FOLDER, 0.0)) as kept:
            fields, groups = _solve(device, build, traits, all_poses, kept, progress)
            with storage_errors(path):
                path.parent.mkdir(exist_ok=True)
                _save(path, fields, groups)
    return replace(fields, signal_error=_signal_error(device, build, fields, groups))


def share_fields(source: Device, device: Device) -> None:
    """Copy the solved fields of a device to another one with the same body and poses.

    The fields do not depend on cords; those with printed traces are solved again.

    Raises:
        CaptureError: One of the devices is not built.
        StorageError: The files cannot be copied.
    """
    target = finished_build(device, RECORD) / FOLDER
    with storage_errors(target):
        for path in (finished_build(source, RECORD) / FOLDER).glob("*.npz"):
            target.mkdir(exist_ok=True)
            if not (target / path.name).exists():
                with replace_file(target / path.name) as temporary:
                    shutil.copyfile(path, temporary)


def _cache_key(device: Device, build: Build, traits: MechanicsTraits, poses: Sequence[Pose]) -> str:
    folder = build.folder
    surface = folder / "body" / "surface.npz"
    regions = sorted((k, type(s).__name__, str(vars(s))) for k, s in device.regions.items())
    with storage_errors(folder):
        return digest(
            FILE_VERSION,
            traits,
            repr(poses),
            regions,
            repr(device.material),
            surface,
            folder / RECORD,
            build.prediction.markers.tolist(),
            *([] if device.cord.trace is None else [repr(device.cord), layout_hash(build.layout)]),
        )


def _trace_fibers(device: Device, build: Build) -> Fibers | None:
    """Return the printed traces with another law than that of the design; None for cords."""
    if device.cord.trace is None:
        return None
    paths = [s.stretch for s in build.layout.sensors]
    fibers = trace_fibers(device, paths, device.material.young_modulus)
    return replace(fibers, is_linear=True)


def choose_material(device: Device, traits: MechanicsTraits) -> Material:
    """Return another material law with the device's moduli at small strain, or the device's own."""
    designed = Material.from_spec(device.material)
    if traits.own_law:
        return designed
    mu, kappa = designed.shear, designed.bulk
    if device.material.model == "yeoh":
        return split(kappa, mu / 3, c01=mu / 6, model="mooney-rivlin")
    return split(kappa, mu / 2, c20=traits.stiffening * mu / 2, model="yeoh")


def _solve(
    device: Device,
    build: Build,
    traits: MechanicsTraits,
    poses: tuple[Pose, ...],
    kept: SolvedJobs,
    progress: Progress,
) -> tuple[DeviceFields, Int]:
    """Return the fields without the error of signals, and the groups for cross-validation."""
    progress("twin", 0.0, "meshing the body more finely")
    mesh = QuadraticMesh.from_linear(_make_mesh(device, build, traits.edge))
    rng, mixable = np.random.default_rng(RAY_SEED), find_mixable_poses(poses)
    axes = pose_axes(poses)
    material, fibers = choose_material(device, traits), _trace_fibers(device, build)
    sampler = _Sampler(device, poses, mesh, material, kept, progress, fibers)
    rays = [*single_rays(len(poses)), *corner_rays(mixable)]
    first_states = min(traits.states * len(axes), MAX_FIRST_STATES)
    remaining = first_states - sum(len(r.fractions) for r in rays)
    sampler.add(rays)
    sampler.check_singles()
    count = max(remaining // 2, RAYS_PER_STEP // 2)
    sampler.add(draw_rays(mixable & ~sampler.failed_pairs, count, rng), is_random=True)
    mixable &= ~sampler.failed_pairs
    markers = build.prediction.markers
    while True:
        space = PoseSpace(axes, np.array(sampler.states))
        fields = DeviceFields(
            poses=tuple(p.name for p in poses),
            space=space,
            mesh=mesh,
            fields=np.array(sampler.fields),
            mixable=mixable,
            error=0.0,
            signal_error=0.0,
            warnings=tuple(sampler.warnings),
        )
        errors, _ = space.predict_left_out(fields.displacements(markers), np.array(sampler.groups))
        error = float(np.sqrt((errors**2).sum(-1).mean())) if errors.size else 0.0
        solved = len(sampler.states)
        room = traits.max_states - solved
        if error <= traits.accuracy or room < 1:
            break
        sampler.add(draw_rays(mixable, min(RAYS_PER_STEP, max(room // 2, 1)), rng), is_random=True)
        if len(sampler.states) == solved:  # the solver reaches no further state
            break
    if error > traits.accuracy:
        sampler.warnings.append(
            f"the shapes of the twin are interpolated with an error of {error:.2g} mm RMS between"
            f" the {solved} states that were solved; smaller errors of a model cannot be measured"
        )
    progress("twin", 1.0, "done")
    fields = replace(fields, mixable=mixable, error=error, warnings=tuple(sampler.warnings))
    return fields, np.array(sampler.groups)


def _make_mesh(device: Device, build: Build, edge: float) -> TetMesh:
    edge_length = build.mesh_record.edge_length
    if edge == 1.0 or edge_length is None:
        return build.mesh
    mesh = tetrahedralize(build.surface, edge * edge_length).mesh
    return conform_to_regions(mesh, list(device.regions.values()))


class _Sampler:
    """Solves states and collects those that were reached.

    Attributes:
        states: Weights of the poses (d,) of each state.
        fields: Displacements (n, 3) mm of the nodes in each state.
        groups: Groups of the states for `PoseSpace.predict_left_out`.
        warnings: States that could not be solved.
        failed_pairs: Pairs of poses (d, d) whose mixtures could not be solved.
    """

    def __init__(
        self,
        device: Device,
        poses: tuple[Pose, ...],
        mesh: QuadraticMesh,
        material: Material,
        kept: SolvedJobs,
        progress: Progress,
        fibers: Fibers | None = None,
    ) -> None:
        self._kept, self._fibers = kept, fibers
        self._device, self._poses, self._mesh, self._material = device, poses, mesh, material
        self._progress, self._lock = progress, threading.Lock()
        self.states: list[Float] = []
        self.fields: list[Float] = []
        self.groups: list[int] = []
        self.warnings: list[str] = []
        self.failed_pairs = np.zeros((len(poses), len(poses)), bool)

    def add(self, rays: Sequence[Ray], *, is_random: bool = False) -> None:
        """Solve the states of rays.

        In cross-validation, random rays are left out as a whole. Of other rays each state but the
        last is left out on its own.
        """
        jobs, solvable = [], []
        for ray in rays:
            try:
                jobs.append(Job(self._conditions(ray), ray.fractions))
            except DeviceError as error:
                self._record_failure(ray, str(error))
                continue
            solvable.append(ray)
        reached = [0.0] * len(jobs)
        count = len(self.states) + sum(len(r.fractions) for r in solvable)

        def report(job: int, fraction: float) -> None:
            with self._lock:
                reached[job] = fraction
                done = sum(reached) / len(reached)
                self._progress("twin", 0.95 * done, f"solving {count} states of the device's twin")

        solutions = self._kept.solve(solve_all, self._mesh, self._material, jobs, report)
        for ray, results in zip(solvable, solutions, strict=True):
            for fraction, result in zip(ray.fractions, results, strict=False):
                if result.u is None or result.problem is not None:
                    self._record_failure(ray, result.problem or "it did not converge")
                    break
                new = max(self.groups, default=-1) + 1
                if is_random:
                    self.groups.append(new if fraction == ray.fractions[0] else new - 1)
                else:
                    self.groups.append(-1 if fraction == ray.fractions[-1] else new)
                self.states.append(fraction * ray.end)
                self.fields.append(np.asarray(result.u, np.float32).astype(float))

    def check_singles(self) -> None:
        """Raise CaptureError if a pose was not reached: the twin would show another shape."""
        for k, pose in enumerate(self._poses):
            levels = [w[k] for w in self.states if w[k] and np.count_nonzero(w) == 1]
            reached = max(levels, default=0.0)
            if reached < MIN_POSE_LEVEL:
                raise CaptureError(
                    f"the solver of the twin reaches {reached:.0%} of the pose {pose.name}",
                    code="pose-not-reached",
                    where=self._device.source,
                    action="Disable the trait 'mechanics' to solve it as the design does",
                    pose=pose.name,
                    reached=float(reached),
                )

    def _conditions(self, ray: Ray) -> BoundaryConditions:
        d = self._device
        weights = {p.name: float(w) for p, w in zip(self._poses, ray.end, strict=True) if w}
        conditions = mix_poses(self._poses, weights, d.regions, self._mesh, d.material.density)
        return replace(conditions, fibers=self._fibers)

    def _record_failure(self, ray: Ray, reason: str) -> None:
        names = [f"{w:.2g} {p.name}" for p, w in zip(self._poses, ray.end, strict=True) if w]
        self.warnings.append(f"the twin's {' + '.join(names)}: {reason}")
        mixed = np.flatnonzero(ray.end)
        if len(mixed) > 1:
            self.failed_pairs[np.ix_(mixed, mixed)] = True


def _signal_error(device: Device, build: Build, fields: DeviceFields, groups: Int) -> float:
    """Return the RMS error of (R - R0)/R0 of the cords as designed, in states left out."""
    reading, errors = CordReading.from_device(device), []
    for record in build.layout.by_channel():
        cord = record.built
        displacements = fields.displacements(cord.path)
        difference, indices = fields.space.predict_left_out(displacements, groups)
        if len(indices):
            predicted = reading.signals(cord, cord.path + displacements[indices] + difference)
            errors.append(predicted - reading.signals(cord, cord.path + displacements[indices]))
    return float(np.sqrt((np.array(errors) ** 2).mean())) if errors else 0.0


def _save(path: Path, fields: DeviceFields, groups: Int) -> None:
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            poses=np.array(fields.poses),
            axes=fields.space.axes,
            states=fields.space.states,
            nodes=fields.mesh.nodes[: fields.mesh.cells[:, :4].max() + 1],
            tets=fields.mesh.cells[:, :4],
            fields=fields.fields.astype(np.float32),
            together=fields.mixable,
            error=fields.error,
            groups=groups,
            warnings=np.array(fields.warnings, str),
        )


def _load(path: Path) -> tuple[DeviceFields, Int] | None:
    """Return the results of `_solve`; None for a damaged file, which is then solved again."""
    try:
        with path.open("rb") as file, np.load(file) as data:
            fields = DeviceFields(
                poses=tuple(data["poses"].tolist()),
                space=PoseSpace(data["axes"], data["states"]),
                mesh=QuadraticMesh.from_linear(TetMesh(data["nodes"], data["tets"])),
                fields=data["fields"].astype(float),
                mixable=data["together"],
                error=float(data["error"]),
                signal_error=0.0,
                warnings=tuple(data["warnings"].tolist()),
            )
            return fields, data["groups"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
