"""Arrays of numbers as text inside a page: rounded to integers, deflated, base64."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from ...core.arrays import Float, Int

_ALIGNED = 4  # bytes: where a browser may lay an array of any of these types
_TYPES: dict[str, type[np.integer[Any]]] = {
    "u1": np.uint8,
    "i2": np.int16,
    "u2": np.uint16,
    "u4": np.uint32,
}


class Packed:
    """Arrays in the order in which they are added; each is known by its place."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.index: list[tuple[str, int, int]] = []  #: Type, first byte, numbers of each array.

    def add(self, numbers: Any, kind: str) -> int:
        """Integers as type `kind`, little-endian; what is out of its range is set to its ends.
        Returns the array's place."""
        limits = np.iinfo(_TYPES[kind])
        fit = np.clip(np.rint(np.asarray(numbers)), limits.min, limits.max)
        data = fit.astype(np.dtype(_TYPES[kind]).newbyteorder("<"))
        self._bytes += bytes(-len(self._bytes) % _ALIGNED)
        self.index.append((kind, len(self._bytes), data.size))
        self._bytes += data.tobytes()
        return len(self.index) - 1

    def lengths(self, mm: Float, step: float) -> int:
        """Coordinates or ways (..., 3) mm as multiples of `step` mm, each axis on its own."""
        return self.add(np.moveaxis(np.asarray(mm), -1, 0) / step, "i2")

    def faces(self, faces: Int) -> int:
        """Triangles (f, 3) of vertex numbers, as differences from the one before: of meshes whose
        triangles follow one another these are small."""
        flat = np.asarray(faces, np.int64).ravel()
        steps = np.diff(flat, prepend=0)
        return self.add((steps << 1) ^ (steps >> 63), "u2" if np.ptp(flat) < 2**15 else "u4")

    def shares(self, values: Float, top: float) -> int:
        """Values from 0 to `top` in 255 steps."""
        return self.add(255 * np.asarray(values) / max(top, 1e-12), "u1")

    def text(self) -> str:
        """All arrays: base64 of their deflated bytes, the same for the same numbers."""
        return base64.b64encode(zlib.compress(bytes(self._bytes), 6)).decode("ascii")
