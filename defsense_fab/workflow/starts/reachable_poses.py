"""Estimate how far one hand moves the end of a body, before anything is simulated.

The body is taken as a straight beam with its mean cross-section between two held ends. A body with
a thin part is softer than that, so that the estimate is a cautious one.
"""

from __future__ import annotations

import numpy as np

from ...core.device.device import Device, MaterialSpec
from ...store.hand_strength import HAND
from .body_ends import END_FRACTION, BodyEnds
from .options import END_POSES

_N_MM_PER_N_M = 1000.0


def reachable_share(ends: BodyEnds, pose: str, material: MaterialSpec) -> float:
    """Return the share of a pose's default amplitude that one hand reaches, up to 1.

    Args:
        ends: The ends of the body.
        pose: Name of the pose, one of `options.END_POSES`.
        material: Material of the body.

    References:
        Saint-Venant's approximation J = A^4 / (4 pi^2 I_p) of the torsion constant of solid
        sections: Timoshenko & Goodier, Theory of Elasticity, 1970, chapter 10.
    """
    length = float(ends.size[0]) * (1 - 2 / END_FRACTION)
    area = ends.volume / float(ends.size[0])
    across = ends.spread[1:] / float(ends.size[0])  # along width and thickness, mm^4
    polar = float(across.sum())
    young = material.young_modulus
    if pose == "pull":
        force = young * area * ends.pull / length
        needed = HAND.share_of(push=force, force=force, moment=0.0)
    elif pose == "twist":
        shear = young / (2 * (1 + material.poisson_ratio))
        torsion = area**4 / (4 * np.pi**2 * polar)
        moment = shear * torsion * np.deg2rad(ends.turn(pose)) / length
        push = moment / np.sqrt(polar / area)
        needed = HAND.share_of(push=push, force=0.0, moment=moment)
    else:
        inertia = float(across[1] if pose == "bend" else across[0])
        moment = young * inertia * np.deg2rad(ends.turn(pose)) / length
        # The end of a circular arc moves by angle times length / 2.
        needed = HAND.share_of(push=2 * moment / length, force=0.0, moment=moment)
    return float(min(1.0, 1.0 / max(needed, 1e-9)))


def describe_reach(ends: BodyEnds, device: Device) -> str:
    """Return which poses of a new device are as large as one hand reaches; empty if none is."""
    names = [
        pose.name
        for pose in device.poses
        if pose.name in END_POSES and reachable_share(ends, pose.name, device.material) < 1
    ]
    if not names:
        return ""
    return (
        f"{', '.join(names)}: only as far as one hand reaches in {device.material.name}"
        f" ({HAND.force:g} N, {HAND.torque / _N_MM_PER_N_M:g} N m), estimated for a beam of the"
        " body's mean cross-section. A softer material or a thinner body goes further"
    )
