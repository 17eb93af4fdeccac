"""Poses and mixtures of poses as boundary conditions on the nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float, Int
from ..core.device import Pose
from ..core.errors import DeviceError
from ..core.regions import Shape


@dataclass(frozen=True)
class RigidMotion:
    """Nodes (k,) that move rigidly: rotation vector (3,) rad about `center` (3,) mm.

    `translation` (3,) mm, or None where the solver finds it.
    """

    nodes: Int
    center: Float
    rotation: Float
    translation: Float | None


@dataclass(frozen=True)
class BoundaryConditions:
    """Nodes held in place, and the rigid motions at full amplitude."""

    fixed: Int
    motions: tuple[RigidMotion, ...]


def rotation_matrix(vector: Float) -> Float:
    """Rodrigues' formula: rotation vector (3,) rad to a matrix (3, 3); angles do not wrap."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def mix(
    poses: Sequence[Pose], weights: Mapping[str, float], regions: Mapping[str, Shape], nodes: Float
) -> BoundaryConditions:
    """The weighted mixture: rotation vectors and translations of shared regions add up.

    A region rotates about the middle of its nodes' bounding box. Raises DeviceError for a
    region without nodes and for regions that overlap with different motions.
    """
    label = " + ".join(f"{w:g} {n}" for n, w in weights.items())
    fixed: set[str] = set()
    rotation: dict[str, Float] = {}
    translation: dict[str, Float | None] = {}
    for pose in poses:
        weight = weights.get(pose.name, 0.0)
        if weight == 0:
            continue
        fixed |= set(pose.fixed)
        for h in pose.handles:
            rotation[h.region] = rotation.get(h.region, np.zeros(3)) + weight * h.rotation
            moved = None if h.translation is None else weight * h.translation
            if h.region not in translation:
                translation[h.region] = moved
                continue
            already = translation[h.region]
            if already is not None and moved is not None:
                translation[h.region] = already + moved
            elif already is not moved:
                raise DeviceError(
                    f"device.toml: states: the mixture {label!r} moves region {h.region!r} both"
                    " freely and by a translation; mix poses that agree"
                )
    for name in sorted(fixed & set(rotation)):
        raise DeviceError(
            f"device.toml: states: the mixture {label!r} both fixes and moves region {name!r}; mix"
            " poses that agree"
        )
    owner = np.full(len(nodes), "", dtype=object)
    for name in sorted(fixed | set(rotation)):
        inside = regions[name].contains(nodes)
        if inside.sum() < 3:
            raise DeviceError(
                f"device.toml: regions.{name}: holds {inside.sum()} nodes of the mesh; move or"
                " enlarge it, or use a smaller [mesh] edge_length"
            )
        if name in fixed and np.linalg.matrix_rank(nodes[inside] - nodes[inside].mean(0), 1e-6) < 2:
            raise DeviceError(
                f"device.toml: regions.{name}: its nodes lie on a line, about which the body can"
                " turn; enlarge it"
            )
        clash = sorted(set(owner[inside]) - {""})
        for other in clash:
            if not (name in fixed and other in fixed and not {name, other} & set(rotation)):
                raise DeviceError(
                    f"device.toml: poses: in {label!r} the regions {other!r} and {name!r} overlap"
                    " but move differently; make them disjoint"
                )
        owner[inside] = name
    held = np.isin(owner.astype(str), sorted(fixed))
    motions = []
    for name in sorted(rotation):
        own = np.flatnonzero(owner == name)
        center = (nodes[own].min(0) + nodes[own].max(0)) / 2
        motions.append(RigidMotion(own, center, rotation[name], translation[name]))
    return BoundaryConditions(np.flatnonzero(held), tuple(motions))
