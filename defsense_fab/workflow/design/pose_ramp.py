"""Follow the ramp of a pose from rest, as a build simulates it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Pose
from ...core.errors import SolveError
from ...mechanics.solver.interactive import Stop
from ...store.fields import load_field, load_levels
from .pose_preview import PosePreview

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
        is_simulated: Whether a build simulated them.
        remark: Remark for people, such as that the ramp is incomplete; empty if none.
        code: Kind of the remark: `"ramp-incomplete"`, `"other-equilibrium"` or empty.
    """

    shares: Float
    moved: Float
    is_simulated: bool
    remark: str = ""
    code: str = ""

    def at(self, share: float) -> Float:
        """Return the displacements (v, 3) mm at a share from 0 to the largest, by splines."""
        from scipy.interpolate import CubicSpline

        whole = np.concatenate([np.zeros((1, *self.moved.shape[1:])), self.moved])
        return np.asarray(CubicSpline(np.append(0.0, self.shares), whole)(share))


def load_ramp(folder: Path, preview: PosePreview, pose: Pose, full: Float | None) -> Ramp | None:
    """Load the ramp of a pose from a build.

    Args:
        folder: Folder of the build.
        preview: Preview of the same body.
        pose: The pose.
        full: Displacements (v, 3) mm of the full pose in the preview; None if the build is known to
            belong to the present device.

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
    if full is not None:
        difference = float(np.abs(moved[-1] - full).max())
        if difference > _SAME_POSE_RTOL * preview.size:
            return None
    return Ramp(np.array(shares), moved, True)


def load_state_shape(folder: Path, preview: PosePreview, state: str) -> Float | None:
    """Return the displacements (v, 3) mm of the surface in a simulated state.

    Args:
        folder: Folder of the build.
        preview: Preview of the same body.
        state: Name of the state.

    Returns:
        The displacements, or None if the build has another mesh.

    Raises:
        StorageError: The state is missing or damaged.
    """
    field = load_field(folder, state)
    return preview.on_surface(field) if len(field) == preview.nodes else None


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
        solved = preview.edit(
            pose, share, None, stop, check=False, from_rest=share == RAMP_SHARES[0]
        )
        if solved.is_cancelled:
            return None
        if solved.moved is None:
            if not frames:
                raise SolveError(
                    _unreached_problem(pose.name, solved.share),
                    code="pose-not-reached",
                    action=_ADVICE,
                    pose=pose.name,
                    share=solved.share,
                )
            code = "ramp-incomplete"
            remark = f"the ramp ends at {max(frames):.0%}, where the solver stopped"
            break
        frames[share] = solved.moved
        if on_frame:
            on_frame(share, solved.moved)
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
