"""A recorded animation of the surface, and what is told of a file that was written of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from ...core.errors import LiveError

Float32 = NDArray[np.float32]
_CHUNK, _FRAMES = 32e6, 128  # bytes of float64 displacements, and frames, at a time at most


@dataclass(frozen=True)
class Animation:
    """`rest` (v, 3) mm and `faces` (f, 3) of the surface; `positions` (n, v, 3) mm of its vertices
    at the picture numbers `steps` (n,), which rise, `fps` of them a second. Between two of them the
    vertices move in straight lines. `positions` may be an array on the disk."""

    name: str
    rest: Float
    faces: Int
    positions: Float32
    steps: Int
    fps: float

    def __post_init__(self) -> None:
        if not len(self.steps):
            raise LiveError(
                "no frame with a surface was recorded", code="no-frames", where=self.name
            )
        if self.positions.shape != (len(self.steps), *self.rest.shape):
            raise LiveError(
                f"positions have shape {self.positions.shape}, expected {len(self.steps)} frames of"
                f" {len(self.rest)} vertices",
                code="shape-mismatch",
                where=self.name,
            )
        if self.steps[0] < 0 or (np.diff(self.steps) <= 0).any():
            raise LiveError(
                "frame numbers must be non-negative and strictly increasing",
                code="not-increasing",
                where=self.name,
            )

    @property
    def times(self) -> Float:
        """(n,) s."""
        return self.steps / self.fps

    def chunks(self) -> Iterator[tuple[slice, Float]]:
        """Displacements from rest (c, 3v) mm, some frames at a time. Raises LiveError where a
        position is not finite."""
        count = max(16, min(_FRAMES, int(_CHUNK / (24 * len(self.rest)))))
        rest = self.rest.ravel()
        for start in range(0, len(self.steps), count):
            part = slice(start, min(start + count, len(self.steps)))
            moved = self.positions[part].reshape(-1, len(rest)) - rest
            if not np.isfinite(moved).all():
                raise LiveError(
                    f"a vertex has no finite position in the frames from {start}",
                    code="not-finite",
                    where=self.name,
                    start=start,
                )
            yield part, moved


@dataclass(frozen=True)
class AnimationFile:
    """A file at `path` of `size` bytes, with `frames` over `seconds`. `error` (mm) is the largest
    distance of a vertex of any frame from where it was recorded; `targets` is the number of
    morph targets, 0 in formats that have none."""

    path: Path
    size: int
    frames: int
    seconds: float
    error: float
    targets: int = 0
