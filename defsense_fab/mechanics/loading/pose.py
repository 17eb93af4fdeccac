"""Translate poses and mixtures of poses into boundary conditions on the nodes of a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import Handle, PointDrag, Pose
from ...core.device.regions import Shape
from ...core.device.states import shared_pivot
from ...core.errors import DeviceError
from ..elements.tet10 import QuadraticMesh, boundary_faces
from .boundary_conditions import BoundaryConditions, Pressure, RigidHandle, Slide

_GRAVITY_MM_S2 = 9806.65  # standard gravity (CGPM 1901)
_T_PER_MM3 = 1e-9  # of 1 g/cm^3: with mm and s, forces are in N


def mix_poses(
    poses: Sequence[Pose],
    weights: Mapping[str, float],
    regions: Mapping[str, Shape],
    mesh: QuadraticMesh,
    density: float = 0.0,
) -> BoundaryConditions:
    """Build the boundary conditions of a weighted mixture of poses.

    Rotation vectors, translations and loads of the poses add up. A region that one pose leaves free
    and another moves is first solved free, then moved from there. A handle rotates about the point
    that it names, or about the middle of its nodes' bounding box.

    Args:
        poses: All poses of the device.
        weights: Weight of each pose in the mixture, by name; others have none.
        regions: Shapes of the regions, by name.
        mesh: Mesh of the body.
        density: Density of the material, g/cm^3, for gravity.

    Returns:
        Boundary conditions at the full amplitude.

    Raises:
        DeviceError: If a region holds too few nodes or no face, regions overlap with different
            motions, the poses contradict each other, or a handle is turned out of a plane of
            symmetry.
    """
    label = " + ".join(f"{w:g} {n}" for n, w in weights.items())
    nodes = mesh.nodes
    total = _sum_poses(poses, weights, label)
    for name in sorted(total.fixed & set(total.handles)):
        raise DeviceError(
            f"the mixture {label!r} both fixes and moves region {name!r}",
            code="region-fixed-and-moved",
            where="device.toml: states",
            action="Mix poses that agree",
            mixture=label,
            region=name,
        )
    owner = _owners(total.fixed, total.handles, regions, nodes, label)
    held = np.flatnonzero(np.isin(owner.astype(str), sorted(total.fixed)))
    rigid = tuple(
        _rigid(name, np.flatnonzero(owner == name), handle, total.prescribed[name], nodes)
        for name, handle in sorted(total.handles.items())
    )
    planes: list[Slide] = []
    for name, normals in sorted(total.slides.items()):
        members = np.flatnonzero(regions[name].contains(nodes))
        if len(members) < 3:
            raise _too_few_nodes(name, len(members))
        distinct = {n.tobytes(): n for n in normals}.values()
        planes.extend(_slide(name, members, normal, nodes) for normal in distinct)
    pressures = sorted(total.pressures.items())
    conditions = BoundaryConditions(
        held,
        rigid,
        tuple(planes),
        tuple(total.drags),
        tuple(_pressure(name, v, regions[name], mesh) for name, v in pressures),
        total.gravity * (_GRAVITY_MM_S2 * _T_PER_MM3 * density),
    )
    _check_symmetry(conditions, label)
    return conditions


@dataclass
class _PoseSum:
    """Weighted sum of poses.

    Attributes:
        fixed: Names of the fixed regions.
        handles: Rigid motions by region.
        prescribed: Their prescribed translations (3,) by region, mm; NaN for free directions.
        slides: Normals (3,) of planes of symmetry by region.
        drags: Pulled points.
        pressures: Pressures by region, MPa.
        gravity: Sum of the poses' gravity vectors (3,), in units of standard gravity.
    """

    fixed: set[str] = field(default_factory=set)
    handles: dict[str, Handle] = field(default_factory=dict)
    prescribed: dict[str, Float] = field(default_factory=dict)
    slides: dict[str, list[Float]] = field(default_factory=dict)
    drags: list[PointDrag] = field(default_factory=list)
    pressures: dict[str, float] = field(default_factory=dict)
    gravity: Float = field(default_factory=lambda: np.zeros(3))


def _sum_poses(poses: Sequence[Pose], weights: Mapping[str, float], label: str) -> _PoseSum:
    total = _PoseSum()
    for pose in poses:
        weight = weights.get(pose.name, 0.0)
        if weight == 0:
            continue
        total.fixed |= set(pose.fixed)
        for h in pose.handles:
            scaled = replace(h, rotation=weight * h.rotation, translation=weight * h.translation)
            previous = total.handles.get(h.region)
            total.handles[h.region] = scaled if previous is None else _add(previous, scaled, label)
            before = total.prescribed.get(h.region, np.full(3, np.nan))
            terms = np.stack([before, scaled.translation])
            total.prescribed[h.region] = np.where(
                np.isnan(terms).all(0), np.nan, np.nansum(terms, axis=0)
            )
        for s in pose.symmetry:
            total.slides.setdefault(s.region, []).append(s.normal)
        total.drags += [replace(d, by=weight * d.by) for d in pose.drags]
        for p in pose.pressures:
            total.pressures[p.region] = total.pressures.get(p.region, 0.0) + weight * p.value
        total.gravity += weight * pose.gravity
    return total


def _add(a: Handle, b: Handle, label: str) -> Handle:
    """Add the motions of two handles on one region."""
    about = shared_pivot(a, b)
    if about is False:
        raise DeviceError(
            f"the mixture {label!r} rotations region {a.region!r} about different points",
            code="rotation-centers-differ",
            where="device.toml: states",
            action="Mix poses that agree, or give the same 'about' in both",
            mixture=label,
            region=a.region,
        )
    # An axis and its opposite are one hinge.
    if a.free_axes.shape != b.free_axes.shape or not np.allclose(
        np.abs(np.einsum("fa,fa->f", a.free_axes, b.free_axes)), 1.0
    ):
        raise DeviceError(
            f"the mixture {label!r} rotations region {a.region!r} both freely and by a rotation",
            code="region-free-and-rotated",
            where="device.toml: states",
            action="Mix poses that agree",
            mixture=label,
            region=a.region,
        )
    return replace(
        a,
        rotation=a.rotation + b.rotation,
        translation=a.translation + b.translation,
        about=about,
    )


def _too_few_nodes(name: str, count: int) -> DeviceError:
    return DeviceError(
        f"contains {count} nodes of the mesh",
        code="too-few-region-nodes",
        where=f"device.toml: regions.{name}",
        action="Move or enlarge it, or use a smaller [mesh] edge_length",
        region=name,
        count=count,
    )


def _owners(
    fixed: set[str],
    handles: Mapping[str, Handle],
    regions: Mapping[str, Shape],
    nodes: Float,
    label: str,
) -> np.ndarray:
    """Return the name of the region that holds each node (n,), empty for free nodes."""
    owner = np.full(len(nodes), "", dtype=object)
    for name in sorted(fixed | set(handles)):
        inside = regions[name].contains(nodes)
        if inside.sum() < 3:
            raise _too_few_nodes(name, int(inside.sum()))
        if np.linalg.matrix_rank(nodes[inside] - nodes[inside].mean(0), 1e-6) < 2:
            raise DeviceError(
                "its nodes lie on a line, about which the body can turn",
                code="region-on-a-line",
                where=f"device.toml: regions.{name}",
                action="Enlarge it",
                region=name,
            )
        overlapping = sorted(set(owner[inside]) - {""})
        for other in overlapping:
            if not (name in fixed and other in fixed):
                raise DeviceError(
                    f"in {label!r} the regions {other!r} and {name!r} overlap but move differently",
                    code="regions-overlap",
                    where="device.toml: poses",
                    action="Make the regions disjoint",
                    mixture=label,
                    regions=(other, name),
                )
        owner[inside] = name
    return owner


def _rigid(name: str, members: Int, handle: Handle, prescribed: Float, nodes: Float) -> RigidHandle:
    """Build a rigid handle; `prescribed` (3,) mm sums the given translations, NaN for none."""
    center = handle.about
    if center is None:
        center = (nodes[members].min(0) + nodes[members].max(0)) / 2
    further_translation = np.where(np.isnan(handle.translation), prescribed, np.nan)
    return RigidHandle(
        members,
        center,
        handle.rotation,
        handle.translation,
        handle.free_axes,
        name,
        further_translation,
    )


def _slide(name: str, members: Int, normal: Float, nodes: Float) -> Slide:
    height = nodes[members] @ normal
    if np.ptp(height) > 1e-3 * float(np.linalg.norm(np.ptp(nodes, axis=0))):
        raise DeviceError(
            "its nodes do not lie in one plane across the symmetry's normal (they span"
            f" {np.ptp(height):.3g} mm)",
            code="region-not-planar",
            where=f"device.toml: regions.{name}",
            action="Use a thin box about the plane",
            region=name,
        )
    return Slide(members, normal)


def _pressure(name: str, value: float, shape: Shape, mesh: QuadraticMesh) -> Pressure:
    faces = boundary_faces(mesh)
    faces = faces[shape.contains(mesh.nodes[faces[:, :3]]).all(axis=1)]
    if len(faces) == 0:
        raise DeviceError(
            "contains no face of the body's surface to press on",
            code="region-without-faces",
            where=f"device.toml: regions.{name}",
            action="Move or enlarge it, or use a smaller [mesh] edge_length",
            region=name,
        )
    return Pressure(faces, value)


def _check_symmetry(conditions: BoundaryConditions, label: str) -> None:
    """Refuse handles that touch a plane of symmetry but may leave it."""
    for slide in conditions.slides:
        n = slide.normal
        for h in conditions.handles:
            if not len(np.intersect1d(slide.nodes, h.nodes)):
                continue
            axes = [*h.free_axes, h.rotation]
            is_turned_out = any(np.linalg.norm(np.cross(axis, n)) > 1e-9 for axis in axes)
            free = np.isnan(h.translation)
            if (
                is_turned_out
                or (np.abs(n[free]) > 1e-9).any()
                or abs(n[~free] @ h.translation[~free]) > 1e-9
                or abs(n @ np.nan_to_num(h.further_translation)) > 1e-9
            ):
                raise DeviceError(
                    f"in {label!r} the region {h.name!r} touches a plane of symmetry but may leave"
                    " it",
                    code="region-leaves-symmetry",
                    where="device.toml: poses",
                    action="Turn it about the plane's normal only and prescribe 0 for its"
                    " translation along the normal",
                    mixture=label,
                    region=h.name,
                )
