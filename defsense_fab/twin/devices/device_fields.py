"""A device's shapes for its twin, solved afresh: on a finer mesh, and by another material law, so
that a twin does not agree with what the device was designed with."""

from __future__ import annotations

import shutil
import threading
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.device.device import Device, Pose
from ...core.errors import CaptureError, DeviceError
from ...core.mesh import TetMesh
from ...core.progress import Progress, silent
from ...core.device.build_folder import finished_build
from ...core.storage.files import digest, replace_file, storage_errors
from ...geometry.bodies.body_record import load_surface
from ...geometry.bodies.meshing.mesh_file import RECORD, load_mesh, load_mesh_record
from ...geometry.bodies.meshing.region_conforming import conform
from ...geometry.bodies.meshing.tetrahedra import tetrahedralize
from ...mechanics.elements.material import Material, split
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.pose import mix_poses
from ...mechanics.solver.batch import Job, solve_all
from ...sensing.built_cord import CordReading
from ...sensing.layout import LAYOUT, PREDICTION, load_layout, load_prediction
from ..scenes.assumptions import assume
from ..scenes.pose_space import PoseSpace
from .pose_samples import Ray, find_mixable_poses, pose_axes, corner_rays, draw_rays, single_rays

FOLDER = "twin"
#: Of what is kept in files: raised when the same input gives other fields.
_VERSION = 3
_SEED = 5
_REACHED = 0.99  # of each pose's amplitude, at least
_STEP = 12  # rays that are added at once
_MANY = 64  # states, at most, that are solved before it is looked how well they do


@dataclass(frozen=True)
class MechanicsTraits:
    """How the shapes are solved."""

    edge: float = assume(
        0.8, "mechanics", "", "edges of the mesh, relative to those of the design", off=1.0
    )
    stiffening: float = assume(
        0.25, "mechanics", "", "c20 / c10 of the Yeoh law in place of the device's (Mooney-Rivlin"
        " where the device's is Yeoh), with the same moduli at small strain"
    )  # fmt: skip
    own_law: bool = assume(
        False, "mechanics", "", "whether the law is that of the design", off=True
    )
    states: int = 16  # for each way to move, to begin with, at most 64
    most: int = 110
    accuracy: float = 0.05  # mm RMS at the markers, that states left out are to be known within


@dataclass(frozen=True)
class DeviceFields:
    """Displacements `fields` (s, n, 3) mm of the quadratic `mesh` in the states of `space`, over
    the weights of the `poses` by name; which of those can be taken at once, `together` (d, d);
    `error` mm RMS at the device's markers and `signal_error` of (R - R0)/R0 of states that are left
    out; what could not be solved, in `warnings`."""

    poses: tuple[str, ...]
    space: PoseSpace
    mesh: QuadraticMesh
    fields: Float
    together: Bool
    error: float
    signal_error: float
    warnings: tuple[str, ...]

    def displacements(self, points: Float) -> Float:
        """(s, p, 3) mm of points (p, 3) mm."""
        locator = PointLocator(self.mesh)
        return locator.displacement(locator.find(points), self.fields)


def solve_fields(
    device: Device, traits: MechanicsTraits | None = None, progress: Progress = silent,
    poses: Sequence[Pose] | None = None,
) -> DeviceFields:  # fmt: skip
    """Of a built device, from its build's folder where they were solved before. `poses`: others
    than the device's own. Raises CaptureError for a device that is not built, or of which a
    pose cannot be solved."""
    own = traits or MechanicsTraits()
    all_poses = tuple(poses or device.poses)
    folder = finished_build(device, LAYOUT, PREDICTION, RECORD)
    path = folder / FOLDER / f"{_key(device, folder, own, all_poses)}.npz"
    kept = _load(path) if path.exists() else None
    found, groups = kept or _solve(device, folder, own, all_poses, progress)
    if kept is None:
        with storage_errors(path):
            path.parent.mkdir(exist_ok=True)
            _save(path, found, groups)
    return replace(found, signal_error=_signal_error(device, folder, found, groups))


def share_fields(source: Device, device: Device) -> None:
    """Give a built device what was solved of another one: of the same body and poses, it is used
    whatever the cords are. Raises CaptureError for one that is not built, StorageError."""
    own = finished_build(device, RECORD) / FOLDER
    with storage_errors(own):
        for path in (finished_build(source, RECORD) / FOLDER).glob("*.npz"):
            own.mkdir(exist_ok=True)
            if not (own / path.name).exists():
                with replace_file(own / path.name) as temporary:
                    shutil.copyfile(path, temporary)


def _key(device: Device, folder: Path, traits: MechanicsTraits, poses: Sequence[Pose]) -> str:
    surface = folder / "body" / "surface.npz"
    regions = sorted((k, type(s).__name__, str(vars(s))) for k, s in device.regions.items())
    with storage_errors(folder):
        return digest(
            _VERSION, traits, repr(poses), regions, repr(device.material), surface, folder / RECORD,
            load_prediction(folder).markers.tolist(),
        )  # fmt: skip


def choose_material(device: Device, traits: MechanicsTraits) -> Material:
    """Another one of the device's moduli at small strain, or the device's."""
    if traits.own_law:
        return Material.from_spec(device.material)
    designed = Material.from_spec(device.material)
    mu, kappa = designed.shear, designed.bulk
    if device.material.model == "yeoh":
        return split(kappa, mu / 3, c01=mu / 6, model="mooney-rivlin")
    return split(kappa, mu / 2, c20=traits.stiffening * mu / 2, model="yeoh")


def _solve(
    device: Device, folder: Path, traits: MechanicsTraits, poses: tuple[Pose, ...],
    progress: Progress,
) -> tuple[DeviceFields, Int]:  # fmt: skip
    """Without the signals' error; and the states' groups, as `PoseSpace.left_out` takes them."""
    progress("twin", 0.0, "meshing the body more finely")
    mesh = QuadraticMesh.from_linear(_mesh(device, folder, traits.edge))
    rng, together = np.random.default_rng(_SEED), find_mixable_poses(poses)
    axes = pose_axes(poses)
    sampler = _Sampler(device, poses, mesh, choose_material(device, traits), traits.most, progress)
    rays = [*single_rays(len(poses)), *corner_rays(together)]
    few = min(traits.states * len(axes), _MANY) - sum(len(r.parts) for r in rays)
    sampler.add(rays)
    sampler.check_singles()
    sampler.add(draw_rays(together & ~sampler.apart, max(few // 2, _STEP // 2), rng), random=True)
    together &= ~sampler.apart
    markers = load_prediction(folder).markers
    while True:
        space = PoseSpace(axes, np.array(sampler.states))
        found = DeviceFields(
            tuple(p.name for p in poses), space, mesh, np.array(sampler.fields), together, 0.0, 0.0,
            tuple(sampler.warnings),
        )  # fmt: skip
        off, _ = space.predict_left_out(found.displacements(markers), np.array(sampler.groups))
        error = float(np.sqrt((off**2).sum(-1).mean())) if off.size else 0.0
        room, before = traits.most - len(sampler.states), len(sampler.states)
        if error <= traits.accuracy or room < 1:
            break
        more = draw_rays(together, min(_STEP, max(room // 2, 1)), rng)
        sampler.add(more, random=True)
        if len(sampler.states) == before:  # no more can be solved
            break
    if error > traits.accuracy:
        sampler.warnings.append(
            f"the twin's shapes are known within {error:.2g} mm RMS only, of {before} states that"
            " could be solved; errors near that are the twin's own"
        )
    progress("twin", 1.0, "done")
    found = replace(found, together=together, error=error, warnings=tuple(sampler.warnings))
    return found, np.array(sampler.groups)


def _mesh(device: Device, folder: Path, edge: float) -> TetMesh:
    record = load_mesh_record(folder)
    if edge == 1.0 or record.edge_length is None:
        return load_mesh(folder)
    made = tetrahedralize(load_surface(folder), edge * record.edge_length).mesh
    return conform(made, list(device.regions.values()))


class _Sampler:
    """Solves states, and gathers what was reached."""

    def __init__(
        self, device: Device, poses: tuple[Pose, ...], mesh: QuadraticMesh, material: Material,
        most: int, progress: Progress,
    ) -> None:  # fmt: skip
        self._device, self._poses, self._mesh, self._material = device, poses, mesh, material
        self._most, self._progress, self._lock = most, progress, threading.Lock()
        self.states: list[Float] = []
        self.fields: list[Float] = []
        self.groups: list[int] = []  # as `PoseSpace.left_out` takes them
        self.warnings: list[str] = []
        self.apart = np.zeros((len(poses), len(poses)), bool)  # pairs that could not be solved

    def add(self, rays: Sequence[Ray], *, random: bool = False) -> None:
        """Solve what these pass through; `random` ones are left out as a whole to see how well the
        others know them, of others all but their ends, each by itself."""
        jobs, kept = [], []
        for ray in rays:
            try:
                jobs.append(Job(self._conditions(ray), ray.parts))
            except DeviceError as error:
                self._fails(ray, str(error))
                continue
            kept.append(ray)
        reached, before = [0.0] * len(jobs), len(self.states)

        def show(job: int, at: float) -> None:
            with self._lock:
                reached[job] = at
                done = sum(reached) / len(reached)
                count = before + sum(len(r.parts) for r in kept)
                self._progress("twin", 0.95 * done, f"solving {count} states of the device's twin")

        for ray, results in zip(
            kept, solve_all(self._mesh, self._material, jobs, show), strict=True
        ):
            for part, result in zip(ray.parts, results, strict=False):
                if result.u is None or result.problem is not None:
                    self._fails(ray, result.problem or "it did not converge")
                    break
                new = max(self.groups, default=-1) + 1
                if random:
                    self.groups.append(new if part == ray.parts[0] else new - 1)
                else:
                    self.groups.append(-1 if part == ray.parts[-1] else new)
                self.states.append(part * ray.end)
                self.fields.append(np.asarray(result.u, np.float32).astype(float))

    def check_singles(self) -> None:
        """Raises CaptureError for a pose that was not reached: a hand would show another shape."""
        for k, pose in enumerate(self._poses):
            alone = [w[k] for w in self.states if w[k] and np.count_nonzero(w) == 1]
            reached = max(alone, default=0.0)
            if reached < _REACHED:
                raise CaptureError(
                    f"{self._device.source}: the twin's solver reaches {reached:.0%} of the pose"
                    f" {pose.name}; give --off mechanics, which solves it as the design"
                    " does"
                )

    def _conditions(self, ray: Ray) -> BoundaryConditions:
        d = self._device
        weights = {p.name: float(w) for p, w in zip(self._poses, ray.end, strict=True) if w}
        return mix_poses(self._poses, weights, d.regions, self._mesh, d.material.density)

    def _fails(self, ray: Ray, why: str) -> None:
        names = [f"{w:.2g} {p.name}" for p, w in zip(self._poses, ray.end, strict=True) if w]
        self.warnings.append(f"the twin's {' + '.join(names)}: {why}")
        moved = np.flatnonzero(ray.end)
        if len(moved) > 1:
            self.apart[np.ix_(moved, moved)] = True


def _signal_error(device: Device, folder: Path, found: DeviceFields, groups: Int) -> float:
    """RMS of (R - R0)/R0 of the cords as designed, in states that are left out."""
    reading, errors = CordReading.of(device), []
    for record in load_layout(folder).by_channel():
        cord = record.built
        moved = found.displacements(cord.path)
        off, which = found.space.predict_left_out(moved, groups)
        if len(which):
            told = reading.signals(cord, cord.path + moved[which] + off)
            errors.append(told - reading.signals(cord, cord.path + moved[which]))
    return float(np.sqrt((np.array(errors) ** 2).mean())) if errors else 0.0


def _save(path: Path, found: DeviceFields, groups: Int) -> None:
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file, poses=np.array(found.poses), axes=found.space.axes, states=found.space.states,
            nodes=found.mesh.nodes[: found.mesh.cells[:, :4].max() + 1],
            tets=found.mesh.cells[:, :4], fields=found.fields.astype(np.float32),
            together=found.together, error=found.error, groups=groups,
            warnings=np.array(found.warnings, str),
        )  # fmt: skip


def _load(path: Path) -> tuple[DeviceFields, Int] | None:
    """As `_solve` gives them; None for a file that is damaged: it is made anew."""
    try:
        with path.open("rb") as file, np.load(file) as data:
            found = DeviceFields(
                tuple(data["poses"].tolist()), PoseSpace(data["axes"], data["states"]),
                QuadraticMesh.from_linear(TetMesh(data["nodes"], data["tets"])),
                data["fields"].astype(float), data["together"], float(data["error"]), 0.0,
                tuple(data["warnings"].tolist()),
            )  # fmt: skip
            return found, data["groups"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
