"""State how well a built device senses each pose: the error with noise against its movement."""

from __future__ import annotations

import numpy as np

from ...decoding.error_scale import describe_share, grade_error
from ...store.build import Build


def pose_errors(build: Build) -> dict[str, tuple[float, float]]:
    """Return the errors of the poses alone, each at its largest simulated amplitude.

    Returns:
        For each pose the RMSE of the surface (mm) in the parts, with noise, and the largest
        movement of the surface in this state (mm).
    """
    prediction = build.layout.prediction
    errors = {**prediction.per_state, **prediction.held_out}
    skin = np.unique(build.mesh.boundary().faces)
    largest: dict[str, tuple[float, int]] = {}
    for k, weights in enumerate(build.fields.weights):
        if len(weights) == 1:
            ((pose, amplitude),) = weights.items()
            largest[pose] = max(largest.get(pose, (0.0, -1)), (amplitude, k))
    return {
        pose: (
            errors[build.fields.names[k]],
            float(np.linalg.norm(build.fields.displacements[k][skin], axis=1).max()),
        )
        for pose, (_, k) in largest.items()
        if k >= 0
    }


def warn_of_poor_poses(build: Build, noun: str) -> list[str]:
    """Return a sentence on the poses whose error is poor for how far they move the surface.

    Args:
        build: The built device.
        noun: What texts call one sensor of it, such as "cord".
    """
    poor = [
        f"{pose} ({describe_share(error, travel)})"
        for pose, (error, travel) in pose_errors(build).items()
        if grade_error(error, travel) == "poor"
    ]
    if not poor:
        return []
    are, they = ("are", "they stretch") if len(poor) > 1 else ("is", "it stretches")
    return [
        f"{', '.join(poor)} {are} sensed poorly, in the parts with noise. A {noun} that {they} more"
        " would help, and so would a larger amplitude"
    ]
