"""A recorded animation of the surface, and the record of a file written from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from ...core.errors import LiveError

Float32 = NDArray[np.float32]
_MAX_CHUNK_BYTES = 32e6  # of float64 displacements
_MIN_CHUNK_FRAMES, _MAX_CHUNK_FRAMES = 16, 128


@dataclass(frozen=True)
class Animation:
    """A surface whose vertices move in straight lines between frames.

    Attributes:
        name: Name of the animation.
        rest: Vertices at rest (v, 3), mm.
        faces: Triangles (f, 3).
        positions: Vertices (n, v, 3) at the frames, mm; may be an array on the disk.
        steps: Numbers (n,) of the frames, increasing from 0 or above.
        fps: Frame numbers per second.

    Raises:
        LiveError: There is no frame, or the arrays do not fit each other.
    """

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
                code="wrong-shape",
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
        """Times of the frames (n,), s."""
        return self.steps / self.fps

    def chunks(self) -> Iterator[tuple[slice, Float]]:
        """Yield displacements from rest (c, 3v), mm, for a few frames at a time.

        Raises:
            LiveError: A position is not finite.
        """
        count = int(_MAX_CHUNK_BYTES / (24 * len(self.rest)))
        count = max(_MIN_CHUNK_FRAMES, min(_MAX_CHUNK_FRAMES, count))
        rest = self.rest.ravel()
        for start in range(0, len(self.steps), count):
            part = slice(start, min(start + count, len(self.steps)))
            displacements = self.positions[part].reshape(-1, len(rest)) - rest
            if not np.isfinite(displacements).all():
                raise LiveError(
                    f"a vertex has no finite position in the frames from {start}",
                    code="not-finite",
                    where=self.name,
                    start=start,
                )
            yield part, displacements


@dataclass(frozen=True)
class AnimationFile:
    """A file that an animation was written to.

    Attributes:
        path: The file.
        size: Its size, bytes.
        frames: Number of frames.
        seconds: Duration, s.
        error: Largest distance of a vertex in any frame from where it was recorded, mm.
        targets: Number of morph targets; 0 in formats without them.
    """

    path: Path
    size: int
    frames: int
    seconds: float
    error: float
    targets: int = 0
