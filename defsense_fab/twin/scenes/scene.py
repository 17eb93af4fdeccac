"""Scenes before simulated cameras: tags, a body, an LED, objects in the way and the background."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.mesh import Surface

#: The value of a pattern's white cells.
WHITE = 255
_UNIT_CORNERS = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) / 2
ROTATION_TOLERANCE = 1e-6  # of the dot products of the axes


@dataclass(frozen=True)
class Patch:
    """A stiff printed picture: a tag or a calibration board.

    Attributes:
        number: Number of the tag.
        pattern: Values of the cells (r, c) uint8, row 0 on top.
        center: Center of the pattern (3,) mm.
        axes: Rotation (3, 3) whose columns are the directions right and up in the picture and the
            normal towards the viewer.
        size: Width of the pattern, mm.
        margin: Width of the white margin around the pattern, cells.
        curl: Curvature about the axis up, 1/mm; the corners stay in one plane.

    Raises:
        CaptureError: A field has the wrong type, shape or range.
    """

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
        center = self.center.tolist()
        if not all(map(math.isfinite, center)) or not self.size > 0 or not self.margin >= 0:
            raise CaptureError(
                "its center must be finite, its size positive, and its margin at least 0",
                code="out-of-range",
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
        """Corners (4, 3) mm of the pattern without its margin, clockwise from the top left."""
        rows, columns = self.pattern.shape
        return self.to_world((_UNIT_CORNERS * [1, -1] + 0.5) * [columns, rows])

    def to_world(self, cells: Float) -> Float:
        """Return the points (..., 3) mm at positions in the picture.

        Args:
            cells: Positions (..., 2) in cells, to the right and down from the top left corner of
                the pattern.

        Returns:
            Points (..., 3) mm in the frame of the scene.
        """
        rows, columns = self.pattern.shape
        flat = (cells - np.array([columns / 2, rows / 2])) * [self.cell, -self.cell]
        flat = np.concatenate([flat, curl_height(flat, self.curl, self.size)], axis=-1)
        return np.asarray(self.center + flat @ self.axes.T)

    def moved_to(self, center: Float, axes: Float) -> Patch:
        """Return the same picture at another center (3,) mm and with other axes (3, 3)."""
        return Patch(self.number, self.pattern, center, axes, self.size, self.margin, self.curl)


def curl_height(flat: Float, curl: Float | float, size: Float | float) -> Float:
    """Return the height of curled paper above the plane of its corners.

    Args:
        flat: Points (..., 2) mm from the middle of the patch.
        curl: Curvature of the paper, 1/mm.
        size: Width of the patch, mm.

    Returns:
        Heights (..., 1) mm.
    """
    return np.asarray(curl * (flat[..., :1] ** 2 - np.square(size) / 4) / 2)


def _is_rotation(rows: list[list[float]]) -> bool:
    """Check a matrix in plain numbers, which is faster: thousands of patches a second are made."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    errors = (
        a * a + b * b + c * c - 1,
        d * d + e * e + f * f - 1,
        g * g + h * h + i * i - 1,
        a * d + b * e + c * f,
        a * g + b * h + c * i,
        d * g + e * h + f * i,
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return determinant > 0 and all(-ROTATION_TOLERANCE < x < ROTATION_TOLERANCE for x in errors)


@dataclass(frozen=True)
class Ball:
    """A dark ball in the way, such as a finger.

    Attributes:
        center: Center (3,) mm.
        radius: Radius, mm.
        level: Grey level.
    """

    center: Float
    radius: float
    level: float = 60.0


@dataclass(frozen=True)
class Ellipse:
    """A spot right before the lens of a camera.

    Attributes:
        center: Center (2,) px.
        radii: Half axes (2,) px.
        angle: Rotation, radians.
        level: Grey level.
        camera: Name of the camera; None for all cameras.
    """

    center: tuple[float, float]
    radii: tuple[float, float]
    angle: float = 0.0
    level: float = 30.0
    camera: str | None = None


@dataclass(frozen=True)
class Led:
    """A light-emitting diode, visible as a disc.

    Attributes:
        center: Center (3,) mm.
        is_on: Whether it is lit.
        radius: Radius, mm.
        on_level: Grey level when it is on.
        off_level: Grey level when it is off.
    """

    center: Float
    is_on: bool
    radius: float = 2.0
    on_level: float = 250.0
    off_level: float = 60.0


@dataclass(frozen=True)
class Backdrop:
    """The background: a wall with a gradient and blotches.

    Attributes:
        level: Grey level in the middle of the image.
        slope: Change of the level across the image, to the right and down.
        texture: Standard deviation of the blotches, grey levels.
        grain: Width of the blotches, px.
        seed: Seed of the blotches.
    """

    level: float = 120.0
    slope: tuple[float, float] = (20.0, -15.0)
    texture: float = 4.0
    grain: int = 24
    seed: int = 0


@dataclass(frozen=True)
class Scene:
    """A scene at one instant. Grey levels are those of a camera of gain one.

    Attributes:
        patches: Printed patches.
        body: Surface of the body, mm.
        occluders: Objects in the way.
        led: The LED of the read-out board.
        backdrop: The background.
        skin: Grey level of the body where it faces the camera.
        ink: Grey levels of the pattern values 0 and 255 where a patch faces the camera.
        shade: Share by which surfaces seen at a slant are darker.
        gloss: Grey levels that paper gains where it mirrors the light above the camera.
        slack: Depth by which the body must be in front of a patch to hide it, mm, so that tags on
            curved skin stay visible.
    """

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

    def replace(self, **changes: Any) -> Scene:
        """Return the scene with some fields replaced."""
        return dataclasses.replace(self, **changes)
