"""Simple shapes that are cut out of parts; each geometry kernel makes its own solid of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

#: mm^3; what a cut leaves of less than that is not a part, and is left out.
CRUMB = 0.5


@dataclass(frozen=True)
class Frustum:
    """A round shape from `start` (3,) mm to `end` (3,) mm with a radius (mm) at each: a cylinder,
    or a cone cut off."""

    start: Float
    end: Float
    radii: tuple[float, float]


@dataclass(frozen=True)
class Prism:
    """A polygon (k, 2) mm in the x and y of a frame, counter-clockwise, extruded along its z by
    `height` mm (above zero). Frame: `origin` (3,) mm; columns of `axes` (3, 3), right-handed."""

    origin: Float
    axes: Float
    polygon: Float
    height: float


Tool = Frustum | Prism

#: The strokes of each digit among the seven of a clock: top, upper left and right, middle, lower
#: left and right, bottom.
_STROKES = {
    "0": "tljkrb", "1": "rk", "2": "trmjb", "3": "trmkb", "4": "lrmk",
    "5": "tlmkb", "6": "tlmjkb", "7": "trk", "8": "tlrmjkb", "9": "tlrmkb",
}  # fmt: skip
#: Each stroke's ends in a cell 1 wide and 2 high.
_ENDS = {
    "t": ((0, 2), (1, 2)), "l": ((0, 1), (0, 2)), "r": ((1, 1), (1, 2)), "m": ((0, 1), (1, 1)),
    "j": ((0, 0), (0, 1)), "k": ((1, 0), (1, 1)), "b": ((0, 0), (1, 0)),
}  # fmt: skip


@dataclass(frozen=True)
class Number:
    """A number engraved in strokes `width` mm wide, `height` mm high, with a line under it, so
    that 6 and 9 differ."""

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
        """Prisms that engrave it `depth` mm deep, centred on `origin` (3,) mm of a face whose
        outward normal is the third column of `axes` (3, 3), readable from outside."""
        cell, w = (self.height - self.width) / 2, self.width
        wide, high = self.size
        low = np.array([-wide / 2 + w / 2, -high / 2 + 2 * w + w / 2])
        lines = [((-wide / 2 + w / 2, -high / 2 + w / 2), (wide / 2 - w / 2, -high / 2 + w / 2))]
        for n, digit in enumerate(self.digits):
            corner = low + np.array([n * (cell + 2 * w), 0])
            for stroke in _STROKES[digit]:
                a, b = (corner + cell * np.array(end) for end in _ENDS[stroke])
                lines.append((tuple(a), tuple(b)))
        frame = origin - depth * axes[:, 2]
        return [
            Prism(frame, axes, _bar(np.array(a), np.array(b), w), depth + _ABOVE) for a, b in lines
        ]


_ABOVE = 0.5  # mm, that an engraving tool reaches above its face


def _bar(a: Float, b: Float, width: float) -> Float:
    """The rectangle (4, 2) around a segment, half a width longer at both ends."""
    along = (b - a) / np.linalg.norm(b - a) * width / 2
    across = np.array([-along[1], along[0]])
    return np.array(
        [a - along - across, b + along - across, b + along + across, a - along + across]
    )


def frame(normal: Float) -> Float:
    """Right-handed axes (3, 3) whose third column is the unit `normal` (3,)."""
    x = _cross(np.eye(3)[int(np.abs(normal).argmin())], normal)
    x /= np.linalg.norm(x)
    return np.stack([x, _cross(normal, x), normal], axis=1)


def _cross(a: Float, b: Float) -> Float:
    """Of two vectors (3,): np.cross takes ten times as long for so few."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])


def upright(normal: Float) -> Float:
    """Axes (3, 3) of something on the skin: y as far up as the normal allows, z the normal."""
    up = np.array([0, 0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0, 1.0, 0])
    x = np.cross(up, normal)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal], axis=1)


def cylinder(start: Float, end: Float, diameter: float) -> Frustum:
    """Between two points (3,) mm."""
    return Frustum(start, end, (diameter / 2, diameter / 2))
