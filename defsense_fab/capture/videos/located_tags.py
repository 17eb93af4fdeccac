"""Where the tags were in every frame of the first camera, found some seconds at a time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from ...core.camera import Camera
from ..tracking.observations import ObservationSource, frame_blocks
from ..tracking.reconstruction import reconstruct
from .camera_sync import together

_TAGS = 5_000  # located at once: each takes some kB meanwhile
#: How many cameras: a byte, of which there is one for each tag in each frame.
Count = NDArray[np.int8]


@dataclass(frozen=True)
class LocatedTags:
    """t frames, m tags: `points` (t, m, 3) mm in a camera's frame and their standard
    deviations `sigma` (t, m, 3) mm along its axes, NaN where not located; `cameras`, `miss`,
    `sides` and `seen` (t, m) as in `Reconstruction`, counts as single bytes; `corners`
    (t, k, 4, 3) mm, in single precision, of those tags of which they are kept."""

    points: Float
    sigma: Float
    cameras: Count
    miss: Float
    sides: Float
    seen: Count
    corners: NDArray[np.float32]


def locate_tags(
    cameras: Sequence[Camera],
    seen: Sequence[ObservationSource],
    size: float,
    frame: Camera,
    outlined: Int,
) -> LocatedTags:
    """Tags of `size` mm by what all cameras see at the times of the first one's frames, in the
    frame of a camera; corners are kept of the columns `outlined` (k,)."""
    shape = len(seen[0].time), len(seen[0].ids)
    out = LocatedTags(
        np.empty((*shape, 3)), np.empty((*shape, 3)), np.empty(shape, np.int8), np.empty(shape),
        np.empty(shape), np.empty(shape, np.int8),
        np.empty((len(seen[0].time), len(outlined), 4, 3), np.float32),
    )  # fmt: skip
    turn = frame.rotation
    for frames in frame_blocks(*shape, _TAGS):
        found = reconstruct(cameras, *together(seen, frames), size)
        out.points[frames] = frame.to_camera(found.points)
        turned = turn @ found.covariance @ turn.T
        out.sigma[frames] = np.sqrt(np.diagonal(turned, axis1=-2, axis2=-1))
        out.cameras[frames], out.miss[frames] = found.cameras, found.miss
        out.sides[frames], out.seen[frames] = found.sides, found.seen
        out.corners[frames] = frame.to_camera(found.corners[:, outlined])
    return out


def joined(parts: Iterable[LocatedTags]) -> LocatedTags:
    """Parts, one after the other."""
    every = list(parts)
    return LocatedTags(
        *(np.concatenate([getattr(p, f.name) for p in every]) for f in fields(LocatedTags))
    )
