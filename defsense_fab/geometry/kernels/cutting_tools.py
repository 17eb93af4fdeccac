"""Define simple shapes that are cut out of parts; each geometry kernel makes its own solid of
them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

#: Smaller remains of a cut are no part and are left out.
MIN_PIECE_MM3 = 0.5


@dataclass(frozen=True)
class Frustum:
    """A cylinder or truncated cone.

    Attributes:
        start: Center (3,) of one end, mm.
        end: Center (3,) of the other end, mm.
        radii: Radius at each end, mm.
    """

    start: Float
    end: Float
    radii: tuple[float, float]


@dataclass(frozen=True)
class Prism:
    """A polygon extruded along the z axis of a frame.

    Attributes:
        origin: Origin (3,) of the frame, mm.
        axes: Right-handed unit axes (3, 3) in columns.
        polygon: Corners (k, 2) in x and y of the frame, counter-clockwise, mm.
        height: Height, above zero, mm.
    """

    origin: Float
    axes: Float
    polygon: Float
    height: float


Tool = Frustum | Prism

#: Strokes of each digit, as in a seven-segment display: top, left and right above, middle, left (j)
#: and right (k) below, bottom.
STROKES = {
    "0": "tljkrb",
    "1": "rk",
    "2": "trmjb",
    "3": "trmkb",
    "4": "lrmk",
    "5": "tlmkb",
    "6": "tlmjkb",
    "7": "trk",
    "8": "tlrmjkb",
    "9": "tlrmkb",
}
#: Each stroke's ends in a cell 1 wide and 2 high.
STROKE_ENDS = {
    "t": ((0, 2), (1, 2)),
    "l": ((0, 1), (0, 2)),
    "r": ((1, 1), (1, 2)),
    "m": ((0, 1), (1, 1)),
    "j": ((0, 0), (0, 1)),
    "k": ((1, 0), (1, 1)),
    "b": ((0, 0), (1, 0)),
}


@dataclass(frozen=True)
class Number:
    """A number engraved in strokes, with a line under it so that 6 and 9 differ.

    Attributes:
        digits: The digits.
        height: Height of the digits, mm.
        width: Width of a stroke, mm.
    """

    digits: str
    height: float
    width: float

    @property
    def size(self) -> tuple[float, float]:
        """Extent along x and y, mm."""
        cell = (self.height - self.width) / 2
        n = len(self.digits)
        return n * cell + (n - 1) * 2 * self.width + self.width, self.height + 2 * self.width

    def engraved(self, origin: Float, axes: Float, depth: float) -> list[Tool]:
        """Return prisms that engrave the number.

        Args:
            origin: Point (3,) of the face on which the number is centered, mm.
            axes: Axes (3, 3) in columns; the third is the face's outward normal. The number is
                readable from outside.
            depth: Depth of the engraving, mm.
        """
        cell, w = (self.height - self.width) / 2, self.width
        width_mm, height_mm = self.size
        low = np.array([-width_mm / 2 + w / 2, -height_mm / 2 + 2 * w + w / 2])
        lines = [
            (
                (-width_mm / 2 + w / 2, -height_mm / 2 + w / 2),
                (width_mm / 2 - w / 2, -height_mm / 2 + w / 2),
            )
        ]
        for n, digit in enumerate(self.digits):
            corner = low + np.array([n * (cell + 2 * w), 0])
            for stroke in STROKES[digit]:
                a, b = (corner + cell * np.array(end) for end in STROKE_ENDS[stroke])
                lines.append((tuple(a), tuple(b)))
        axes_from_normal = origin - depth * axes[:, 2]
        return [
            Prism(axes_from_normal, axes, _bar(np.array(a), np.array(b), w), depth + OVERSHOOT_MM)
            for a, b in lines
        ]


OVERSHOOT_MM = 0.5  # how far an engraving tool reaches above its face


def _bar(a: Float, b: Float, width: float) -> Float:
    """Return the rectangle (4, 2) around a segment, extended by half a width at both ends."""
    along = (b - a) / np.linalg.norm(b - a) * width / 2
    across = np.array([-along[1], along[0]])
    return np.array(
        [a - along - across, b + along - across, b + along + across, a - along + across]
    )


def axes_from_normal(normal: Float) -> Float:
    """Return right-handed axes (3, 3) in columns, whose third is the unit `normal` (3,)."""
    x = _cross(np.eye(3)[int(np.abs(normal).argmin())], normal)
    x /= np.linalg.norm(x)
    return np.stack([x, _cross(normal, x), normal], axis=1)


def _cross(a: Float, b: Float) -> Float:
    """Return the cross product of two vectors (3,); np.cross takes ten times as long for these."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])


def upright_axes(normal: Float) -> Float:
    """Return axes (3, 3) in columns on the skin: z is the unit `normal` (3,), y points up as far as
    it can.
    """
    up = np.array([0, 0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0, 1.0, 0])
    x = np.cross(up, normal)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def cylinder(start: Float, end: Float, diameter: float) -> Frustum:
    """Return the cylinder between two points (3,), mm."""
    return Frustum(start, end, (diameter / 2, diameter / 2))
