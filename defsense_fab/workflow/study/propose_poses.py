"""Proposed poses: the lowest modes of a body, as text for `device.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Array, InlineTable, Table

from ...core.arrays import Float, Int
from ...core.device.device import Device, Handle, Pose, StatesSpec
from ...core.device.regions import HalfSpace, Shape
from ...core.device.states import default_states
from ...core.errors import DeviceError
from ...core.mesh import Surface
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors, write_text
from ...geometry.bodies.orientation import viewing_axes
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh, boundary_faces
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.constraint_check import check_constraints
from ...mechanics.solver import linear_response
from ...mechanics.solver.linear_response import Mode, vibration_modes
from ...mechanics.solver.linear_response import ProposedPose as ProposedPose
from ...store.mesh import load_mesh
from ..build.build import build
from .options import ModesOptions
from .pose_trials import try_poses

#: Name of the region that the proposed poses move.
END = "far_end"
PICTURE_AMPLITUDE = 0.12  # of a mode in pictures, relative to the size of the body


@dataclass(frozen=True)
class Proposal:
    """Proposed poses.

    Attributes:
        modes: The lowest modes.
        poses: Poses made of modes.
        text: Text of the poses for `device.toml`.
        picture: Picture of the poses.
        notes: Poses that were weakened or dropped, and why.
    """

    modes: tuple[Mode, ...]
    poses: tuple[ProposedPose, ...]
    text: str
    picture: Path
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PoseSearch:
    """Modes of a body and the poses made of them.

    Attributes:
        mesh: The mesh.
        modes: Its lowest modes.
        poses: Poses made of modes.
        region: Name of the region that the poses move; the device may have it already.
        notes: Poses that were weakened or dropped, and why.
    """

    mesh: QuadraticMesh
    modes: tuple[Mode, ...]
    poses: tuple[ProposedPose, ...]
    region: str
    notes: tuple[str, ...] = ()

    @property
    def surface_nodes(self) -> Int:
        """Indices (v,) of the nodes that are corners of the surface."""
        return np.unique(boundary_faces(self.mesh)[:, :3])

    def shape(self, pose: ProposedPose) -> Float:
        """Return the displacements (n, 3) mm of a pose in pictures."""
        size = float(np.linalg.norm(np.ptp(self.mesh.nodes, axis=0)))
        return np.asarray(PICTURE_AMPLITUDE * size * pose.mode.shape)


def find_poses(device: Device, options: ModesOptions, progress: Progress = silent) -> PoseSearch:
    """Find the lowest modes of a body that is held by a region, and poses made of them.

    Poses beyond the material's elongation at break, and those that take ten times as long to solve
    as the others, are weakened or dropped.

    Args:
        device: The device; it may lack poses and sensors.
        options: The region that is held, and the number of modes.
        progress: Called with the progress.

    Raises:
        DeviceError: There is no such region (`unknown-region`), or it holds the whole body or too
            little of it.
    """
    fixed, count = options.fixed, options.count
    if fixed not in device.regions:
        regions = ", ".join(device.regions) or "none"
        raise DeviceError(
            f"there is no region {fixed!r} to hold the body by",
            code="unknown-region",
            where="device.toml: regions",
            action=f"Use one of: {regions}",
            region=fixed,
        )
    folder = build(device, "mesh", progress).folder
    mesh = QuadraticMesh.from_linear(load_mesh(folder))
    held = np.flatnonzero(device.regions[fixed].contains(mesh.nodes))
    if 3 * (len(mesh.nodes) - len(held)) <= count + 1:
        raise DeviceError(
            "holds the whole body",
            code="region-holds-all",
            where=f"device.toml: regions.{fixed}",
            action="Make it smaller",
            region=fixed,
        )
    check_constraints(mesh, BoundaryConditions(held), f"modes with {fixed} held")
    progress("modes", 0.1, "solving for the lowest modes")
    modes = vibration_modes(
        mesh, Material.from_spec(device.material), held, device.material.density, count
    )
    poses = linear_response.propose_poses(mesh, held, modes)
    region = _end_region(device, poses)
    if not poses:
        return PoseSearch(mesh, tuple(modes), (), region)
    poses, notes = try_poses(
        device,
        mesh,
        fixed,
        (region, HalfSpace(poses[0].origin, poses[0].axis)),
        poses,
        report=lambda done: progress("modes", 0.3 + 0.5 * done, "trying the poses"),
    )
    return PoseSearch(mesh, tuple(modes), tuple(poses), region, tuple(notes))


def propose_poses(device: Device, options: ModesOptions, progress: Progress = silent) -> Proposal:
    """Propose poses (see `find_poses`), with their text and a picture next to `device.toml`."""
    search = find_poses(device, options, progress)
    progress("modes", 0.8, "drawing them")
    picture = device.source / "modes.png"
    with storage_errors(picture):
        _draw(search, picture)
    progress("modes", 1.0, "done")
    text = as_toml(list(search.poses), options.fixed, search.region)
    return Proposal(search.modes, search.poses, text, picture, search.notes)


def _end_region(device: Device, poses: Sequence[ProposedPose]) -> str:
    """Return the name of the region that poses move; an identical region is reused."""
    region = END
    while region in device.regions and not (poses and _is_end(device.regions[region], poses[0])):
        region += "_new"
    return region


def _is_end(shape: Shape, pose: ProposedPose) -> bool:
    return (
        isinstance(shape, HalfSpace)
        and np.allclose(shape.origin, pose.origin, atol=1e-3)
        and np.allclose(shape.normal, pose.axis, atol=1e-3)
    )


def append_poses(device_file: Path, proposal: Proposal, existing: tuple[str, ...]) -> None:
    """Add the region and the poses to `device.toml`, without changing the rest of its text.

    They are appended, or inserted into the inline table and the array of the file if it has those.

    Args:
        device_file: The file.
        proposal: The poses.
        existing: Names of the poses that the device has.

    Raises:
        DeviceError: A name is taken (`name-repeated`), or the poses cannot be added to the file
            (`file-not-extendable`); the file is then unchanged.
    """
    taken = {p.name for p in proposal.poses} & set(existing)
    if taken:
        raise DeviceError(
            f"there is a pose {min(taken)!r} already",
            code="name-repeated",
            where="device.toml: poses",
            action="Rename it",
            name=min(taken),
        )
    with storage_errors(device_file):
        before = device_file.read_text(encoding="utf-8")
        try:
            text = extend_text(before, proposal.text)
        except (TOMLKitError, tomllib.TOMLDecodeError) as error:
            raise DeviceError(
                f"the poses cannot be added to it ({error})",
                code="file-not-extendable",
                where="device.toml",
                action="Paste the text that `defsense modes` prints",
            ) from None
        write_text(device_file, text)


def extend_text(before: str, text: str) -> str:
    """Return the text of a device with that of poses; existing regions are not changed.

    Raises:
        TOMLKitError: The text cannot be extended.
        TOMLDecodeError: The result is not valid TOML.
    """
    device, added = tomlkit.parse(before), tomlkit.parse(text)
    for name in [n for n in added.get("regions", {}) if n in device.get("regions", {})]:
        del added["regions"][name]
    if not added.get("regions", {"": None}):
        del added["regions"]
    # Inline tables are closed: additions must be inside of them.
    if isinstance(regions := device.get("regions"), InlineTable):
        for name, region in added.pop("regions", {}).items():
            regions[name] = _inline(region)
    if "states" in device or "poses" in device:  # the states of the new poses alone are not enough
        added.pop("states", None)
    if isinstance(poses := device.get("poses"), Array):
        for pose in added.pop("poses", []):
            poses.append(_inline(pose))
    extended = tomlkit.dumps(device).rstrip("\n") + "\n\n" + tomlkit.dumps(added).lstrip("\n")
    tomllib.loads(extended)  # check the result
    return extended


def _inline(table: Table) -> InlineTable:
    inline = tomlkit.inline_table()
    inline.update(table.unwrap())
    return inline


def as_toml(poses: list[ProposedPose], fixed: str, region: str = END) -> str:
    """Return the text of the moved region, the poses and their states."""
    document = tomlkit.document()
    if not poses:
        return ""
    end = tomlkit.inline_table()
    end.update({"origin": _numbers(poses[0].origin), "normal": _numbers(poses[0].axis)})
    document["regions"] = {region: {"half_space": end}}
    document["regions"][region].add(tomlkit.nl())
    document["poses"] = tomlkit.aot()
    for p in poses:
        handle = tomlkit.table()
        handle["region"] = region
        angle = float(np.linalg.norm(p.rotation))
        if angle:
            rotate = tomlkit.inline_table()
            degrees = _plain(float(f"{np.rad2deg(angle):.4g}"))
            rotate.update({"axis": _numbers(p.rotation / angle), "degrees": degrees})
            handle["rotate"] = rotate
        is_free = np.isnan(p.translation).all()
        handle["translate"] = "free" if is_free else _numbers(p.translation)
        pose = tomlkit.table()
        pose.comment(f"mode of {p.mode.frequency:.3g} Hz")
        pose.update({"name": p.name, "fixed": [fixed], "handles": tomlkit.aot()})
        pose["handles"].append(handle)
        document["poses"].append(pose)
    document["states"] = states_table(
        default_states(
            [Pose(p.name, (fixed,), (Handle(region, p.rotation, p.translation),)) for p in poses]
        )
    )
    return tomlkit.dumps(document)


def states_table(spec: StatesSpec) -> Table:
    """Return the table [states] of device.toml."""
    table = tomlkit.table()
    table.comment("cords are designed for ramp and mixtures, and tested on held_out")
    table["ramp"] = _numbers(np.array(spec.ramp))
    for key, mixtures in (("mixtures", spec.mixtures), ("held_out", spec.held_out)):
        if mixtures:
            rows = tomlkit.array()
            for mixture in mixtures:
                row = tomlkit.inline_table()
                row.update({name: _plain(weight) for name, weight in mixture.items()})
                rows.append(row)
            table[key] = rows.multiline(True)
    return table


def _numbers(vector: Float) -> list[float]:
    return [_plain(float(f"{v:.7g}")) for v in np.round(vector, 4)]


def _plain(value: float) -> float:
    """Return a number, an integer if it is one."""
    return int(value) if value.is_integer() else value


def _draw(search: PoseSearch, path: Path) -> None:
    from ...report.pictures.proposals import draw_modes

    mesh = search.mesh
    faces = boundary_faces(mesh)[:, :3]
    draw_modes(
        [
            (f"{p.name}, {p.mode.frequency:.3g} Hz", mesh.nodes + search.shape(p))
            for p in search.poses
        ],
        faces,
        mesh.nodes,
        viewing_axes(Surface(mesh.nodes, faces)),
        path,
    )
