"""Poses for a user who has none: the body's lowest modes, as text for `device.toml`."""

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
from ...mechanics.solver.linear_response import Mode, ProposedPose, vibration_modes
from ...store.mesh import load_mesh
from ..build.build import build

#: Name of the region that the proposed poses move.
END = "far_end"
_SHOWN = 0.12  # of the body's size: how far a mode moves in pictures


@dataclass(frozen=True)
class Proposal:
    """The modes found, the poses made of them, their text, and the picture of the poses."""

    modes: tuple[Mode, ...]
    poses: tuple[ProposedPose, ...]
    text: str
    picture: Path


@dataclass(frozen=True)
class Found:
    """The `mesh` that was looked at, its modes, the poses made of them, and the name of the region
    that they move, which the device may have already."""

    mesh: QuadraticMesh
    modes: tuple[Mode, ...]
    poses: tuple[ProposedPose, ...]
    region: str

    @property
    def surface_nodes(self) -> Int:
        """Which nodes (v,) are corners of the surface."""
        return np.unique(boundary_faces(self.mesh)[:, :3])

    def shape(self, pose: ProposedPose) -> Float:
        """A pose's mode (n, 3) mm at the nodes, as far as pictures of it show it."""
        size = float(np.linalg.norm(np.ptp(self.mesh.nodes, axis=0)))
        return np.asarray(_SHOWN * size * pose.mode.shape)


def find_poses(device: Device, fixed: str, count: int = 8, progress: Progress = silent) -> Found:
    """Modes of the body with the region `fixed` held; `device` may lack poses and sensors.

    Raises DeviceError for a region that there is not or that does not hold the body.
    """
    if fixed not in device.regions:
        there = ", ".join(device.regions) or "none"
        raise DeviceError(
            f"device.toml: regions: there is no region {fixed!r} to hold the body by; there is:"
            f" {there}"
        )
    folder = build(device, "mesh", progress).folder
    mesh = QuadraticMesh.from_linear(load_mesh(folder))
    held = np.flatnonzero(device.regions[fixed].contains(mesh.nodes))
    if 3 * (len(mesh.nodes) - len(held)) <= count + 1:
        raise DeviceError(f"device.toml: regions.{fixed}: holds the whole body; make it smaller")
    check_constraints(mesh, BoundaryConditions(held), f"modes with {fixed} held")
    progress("modes", 0.1, "solving for the lowest modes")
    found = vibration_modes(
        mesh, Material.from_spec(device.material), held, device.material.density, count
    )
    poses = linear_response.propose_poses(mesh, held, found)
    return Found(mesh, tuple(found), tuple(poses), _end_region(device, poses))


def propose_poses(
    device: Device, fixed: str, count: int = 8, progress: Progress = silent
) -> Proposal:
    """What `find_poses` finds, as text, and drawn beside `device.toml`. Raises as it does."""
    found = find_poses(device, fixed, count, progress)
    progress("modes", 0.8, "drawing them")
    picture = device.source / "modes.png"
    with storage_errors(picture):
        _draw(found, picture)
    progress("modes", 1.0, "done")
    text = as_toml(list(found.poses), fixed, found.region)
    return Proposal(found.modes, found.poses, text, picture)


def _end_region(device: Device, poses: Sequence[ProposedPose]) -> str:
    """A name for the region that poses move; that of the device's where it is there already."""
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


def append(device_file: Path, proposal: Proposal, known: tuple[str, ...]) -> None:
    """Add the region and the poses to `device.toml`, whose text stays as it is: at its end, or in
    its own inline table and array where it has those. Raises DeviceError where a name is taken, or
    where the file is written in a way that cannot be continued; it is then as it was."""
    taken = {p.name for p in proposal.poses} & set(known)
    if taken:
        raise DeviceError(f"device.toml: poses: there is a pose {min(taken)!r} already; rename it")
    with storage_errors(device_file):
        before = device_file.read_text(encoding="utf-8")
        try:
            text = continued(before, proposal.text)
        except (TOMLKitError, tomllib.TOMLDecodeError) as error:
            raise DeviceError(
                f"device.toml: the poses cannot be added to it ({error}); paste what"
                " `defsense modes` prints without --write"
            ) from None
        write_text(device_file, text)


def continued(before: str, text: str) -> str:
    """A device's text with that of poses; regions that it has already stay as they are. Raises
    TOMLKitError, TOMLDecodeError."""
    device, added = tomlkit.parse(before), tomlkit.parse(text)
    for name in [n for n in added.get("regions", {}) if n in device.get("regions", {})]:
        del added["regions"][name]
    if not added.get("regions", {"": None}):
        del added["regions"]
    # Tables in a line of their own are closed: what is added to them must stand inside.
    if isinstance(regions := device.get("regions"), InlineTable):
        for name, region in added.pop("regions", {}).items():
            regions[name] = _inline(region)
    if "states" in device or "poses" in device:  # they are not those of the new poses alone
        added.pop("states", None)
    if isinstance(poses := device.get("poses"), Array):
        for pose in added.pop("poses", []):
            poses.append(_inline(pose))
    out = tomlkit.dumps(device).rstrip("\n") + "\n\n" + tomlkit.dumps(added).lstrip("\n")
    tomllib.loads(out)
    return out


def _inline(table: Table) -> InlineTable:
    out = tomlkit.inline_table()
    out.update(table.unwrap())
    return out


def as_toml(poses: list[ProposedPose], fixed: str, region: str = END) -> str:
    """The region that is moved, and the poses."""
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
        free = np.isnan(p.translation).all()
        handle["translate"] = "free" if free else _numbers(p.translation)
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
    """What the cords are designed for and judged by, as the table of device.toml."""
    table = tomlkit.table()
    table.comment("cords are designed for ramp and mixtures, and judged by held_out")
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
    """Whole numbers without a decimal point."""
    return int(value) if value.is_integer() else value


def _draw(found: Found, path: Path) -> None:
    from ...report.pictures.proposals import draw_modes

    mesh = found.mesh
    faces = boundary_faces(mesh)[:, :3]
    draw_modes(
        [
            (f"{p.name}, {p.mode.frequency:.3g} Hz", mesh.nodes + found.shape(p))
            for p in found.poses
        ],
        faces,
        mesh.nodes,
        viewing_axes(Surface(mesh.nodes, faces)),
        path,
    )
