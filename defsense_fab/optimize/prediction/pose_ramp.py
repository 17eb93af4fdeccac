"""A pose at any share of its ramp: from the fields of a build, or followed by the solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Pose
from ...core.errors import SolveError
from ...mechanics.solver.interactive import Stop
from ...mechanics.solver.load_stepping import Status
from ...store.fields import load_levels
from .pose_preview import PosePreview

#: Shares that are solved where no build has them.
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
#: What to do about a pose that cannot be solved.
_ADVICE = "lower its movement or load, enlarge its regions, or refine the mesh"
#: Of the body's size: fields that differ by more are not of the same pose.
_SAME = 1e-4
#: Of the body's size: shapes that differ by more are two equilibria.
_OTHER = 0.01


@dataclass(frozen=True)
class Ramp:
    """Displacements `moved` (f, v, 3) mm of the surface at `shares` (f,) above 0 in their order,
    and whether a build simulated them; `remark` on what was found on the way, or none."""

    shares: Float
    moved: Float
    simulated: bool
    remark: str = ""

    def at(self, share: float) -> Float:
        """Displacements (v, 3) mm at a share from 0 to the largest, between shares by splines."""
        from scipy.interpolate import CubicSpline

        whole = np.concatenate([np.zeros((1, *self.moved.shape[1:])), self.moved])
        return np.asarray(CubicSpline(np.append(0.0, self.shares), whole)(share))


def simulated_ramp(folder: Path, preview: PosePreview, pose: Pose, full: Float) -> Ramp | None:
    """From a build's `folder`; `full` (v, 3) mm is the pose as the preview has it. None where the
    build has no fields of it, or of another mesh, or of the pose before it was changed."""
    levels = {s: u for s, u in load_levels(folder, pose.name).items() if 0 < s <= 1}
    if 1.0 not in levels:
        return None
    shares = sorted(levels)
    if len(levels[1.0]) != preview.nodes:
        return None
    moved = preview.on_surface(np.array([levels[s] for s in shares]))
    apart = float(np.abs(moved[-1] - full).max())
    if apart > _SAME * preview.size:
        return None
    return Ramp(np.array(shares), moved, True)


def followed_ramp(
    preview: PosePreview,
    pose: Pose,
    full: Float | None = None,
    stop: Stop | None = None,
    on_frame: Callable[[float, Float], None] | None = None,
) -> Ramp | None:
    """From rest, as a build goes; None once `stop` says so. `on_frame` gets each share and its
    displacements (v, 3) mm. `full` is where a hand led the pose, which may be elsewhere. Raises
    SolveError where the ramp does not begin."""
    frames: dict[float, Float] = {}
    remark = ""
    for share in SHARES:
        found = preview.edit(pose, share, None, stop, check=False, from_rest=share == SHARES[0])
        if found.status is Status.CANCELLED:
            return None
        if found.moved is None:
            if not frames:
                raise SolveError(unreached(pose.name, found.share))
            remark = f"the ramp ends at {max(frames):.0%}: the solver came no further"
            break
        frames[share] = found.moved
        if on_frame:
            on_frame(share, found.moved)
    if full is not None and 1.0 in frames:
        apart = float(np.linalg.norm(frames[1.0] - full, axis=1).max())
        if apart > _OTHER * preview.size:
            remark = (
                f"from rest the body ends {apart:.1f} mm elsewhere than where the hand led it:"
                " there is more than one equilibrium"
            )
    return Ramp(np.array(list(frames)), np.array(list(frames.values())), False, remark)


def unreached(pose: str, share: float) -> str:
    """What is said of a pose that the solver led to a `share` of its ramp."""
    return f"`{pose}` cannot be solved beyond {share:.0%} of its ramp: {_ADVICE}."
