"""The triangles that a reader of mesh files returns."""

from __future__ import annotations

from dataclasses import dataclass

from ....core.arrays import Float, Int


@dataclass(frozen=True)
class Triangles:
    """Triangles of a file.

    Attributes:
        vertices: Corners (n, 3), in mm if the format has a unit.
        faces: Triangles (m, 3).
        notes: Sentences on the conversion.
        unit: Millimetres of the file's unit; 1 if the format has none.
    """

    vertices: Float
    faces: Int
    notes: tuple[str, ...] = ()
    unit: float = 1.0
