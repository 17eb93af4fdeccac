"""What stands before the twin's cameras at an instant: tags, a body, an LED, hands in the way."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.mesh import Surface

#: The value of a pattern's white cells.
WHITE = 255
_CORNERS = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) / 2


@dataclass(frozen=True)
class Patch:
    """A flat, stiff picture: the tag `number`, or a board. `pattern` (r, c) uint8, one value a
    cell, row 0 on top; `center` (3,) mm of the pattern; `axes` (3, 3), columns: right and up in the
    picture, and the normal towards the viewer; `size` mm, the pattern's width; `margin`, cells of
    white around it; `curl` 1/mm, how it bends about its axis up, its corners in one plane."""

    number: int
    pattern: NDArray[np.uint8]
    center: Float
    axes: Float
    size: float
    margin: float = 1.0
    curl: float = 0.0

    def __post_init__(self) -> None:
        if self.pattern.ndim != 2 or self.pattern.dtype != np.uint8 or not self.pattern.size:
            raise CaptureError(
                "its pattern must be a non-empty two-dimensional array of uint8",
                code="pattern-invalid",
                where=f"patch {self.number}",
            )
        if self.center.shape != (3,) or self.axes.shape != (3, 3):
            raise CaptureError(
                f"its center has the shape {self.center.shape}, its axes {self.axes.shape}; (3,)"
                " and (3, 3) are expected",
                code="patch-shape-invalid",
                where=f"patch {self.number}",
            )
        place = self.center.tolist()
        if not all(map(math.isfinite, place)) or not self.size > 0 or not self.margin >= 0:
            raise CaptureError(
                "its center must be finite, its size positive, and its margin at least 0",
                code="patch-out-of-range",
                where=f"patch {self.number}",
            )
        if not _is_rotation(self.axes.tolist()):
            raise CaptureError(
                "its axes must be a rotation with the columns right, up and normal",
                code="axes-not-rotation",
                where=f"patch {self.number}",
            )

    @property
    def cell(self) -> float:
        """Width of a cell, mm."""
        return float(self.size / self.pattern.shape[1])

    @property
    def corners(self) -> Float:
        """The pattern's corners (4, 3) mm, without the margin: from top left, clockwise."""
        rows, columns = self.pattern.shape
        return self.at((_CORNERS * [1, -1] + 0.5) * [columns, rows])

    def at(self, cells: Float) -> Float:
        """Points (..., 2), in cells to the right and downwards from the pattern's upper left
        corner, in the world (..., 3) mm."""
        rows, columns = self.pattern.shape
        flat = (cells - np.array([columns / 2, rows / 2])) * [self.cell, -self.cell]
        flat = np.concatenate([flat, curl_height(flat, self.curl, self.size)], axis=-1)
        return np.asarray(self.center + flat @ self.axes.T)

    def moved(self, center: Float, axes: Float) -> Patch:
        """The same picture elsewhere."""
        return Patch(self.number, self.pattern, center, axes, self.size, self.margin, self.curl)


def curl_height(flat: Float, curl: Float | float, size: Float | float) -> Float:
    """How far points (..., 2) mm from the middle of a patch of this `size`, mm, with this `curl`,
    1/mm, are above the plane of its corners (..., 1), mm."""
    return np.asarray(curl * (flat[..., :1] ** 2 - np.square(size) / 4) / 2)


def _is_rotation(rows: list[list[float]]) -> bool:
    """In plain numbers: thousands of patches a second are checked."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    dots = (
        a * a + b * b + c * c - 1, d * d + e * e + f * f - 1, g * g + h * h + i * i - 1,
        a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i,
    )  # fmt: skip
    turned = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return turned > 0 and all(-1e-6 < x < 1e-6 for x in dots)


@dataclass(frozen=True)
class Ball:
    """A dark ball in the way, as a hand is: `center` (3,) mm, `radius` mm, grey `level`."""

    center: Float
    radius: float
    level: float = 60.0


@dataclass(frozen=True)
class Ellipse:
    """A spot right before the lens of the camera of this name (of all, where None): `center` and
    half axes `radii` (2,) px, turned by `angle` radians, of a grey `level`."""

    center: tuple[float, float]
    radii: tuple[float, float]
    angle: float = 0.0
    level: float = 30.0
    camera: str | None = None


@dataclass(frozen=True)
class Led:
    """A light-emitting diode, seen as a disc: `center` (3,) mm, `radius` mm, whether it is on."""

    center: Float
    on: bool
    radius: float = 2.0
    lit: float = 250.0
    dark: float = 60.0


@dataclass(frozen=True)
class Backdrop:
    """What is behind: grey `level` in the middle of the image, its change across the image to the
    right and downwards, and the standard deviation of its blotches, which are `grain` px wide."""

    level: float = 120.0
    slope: tuple[float, float] = (20.0, -15.0)
    texture: float = 4.0
    grain: int = 24
    seed: int = 0


@dataclass(frozen=True)
class Scene:
    """At an instant. `skin`, the body's grey level, and `ink`, those of pattern values 0 and 255,
    are what a camera of gain one sees face to face; at a slant they are darker by up to the part
    `shade`, and where they mirror the light above the camera lighter by up to `gloss` grey levels.
    A patch is hidden where the body is more than `slack` mm above it, so that a tag that
    lies on curved skin is not."""

    patches: tuple[Patch, ...] = ()
    body: Surface | None = None
    occluders: tuple[Ball | Ellipse, ...] = ()
    led: Led | None = None
    backdrop: Backdrop = Backdrop()
    skin: float = 90.0
    ink: tuple[float, float] = (25.0, 210.0)
    shade: float = 0.35
    gloss: float = 0.0
    slack: float = 2.0

    def moved(self, **changes: Any) -> Scene:
        """The same with something changed."""
        return replace(self, **changes)
