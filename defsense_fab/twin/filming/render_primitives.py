"""Flat render primitives of a scene: their projected outlines, sorted from near to far.

A pattern of constant cells is the sum, over the edges between cells, of the change of the value
across the edge. Edges between equal cells add nothing, and collinear edges with the same change
are joined. With the edges the pattern can be filled exactly (see `raster.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from ...core.camera import Camera
from ..scenes.scene import WHITE, Ball, Ellipse, Led, Patch, Scene, curl_height
from .camera_optics import project

#: x0, y0, x1, y1 in px of the canvas.
Box = tuple[int, int, int, int]
EMPTY_BOX: Box = (0, 0, 0, 0)

MAX_BOW_PX = 1e-3  # deviation of a piece of an edge from its chord
CIRCLE_SIDES = 96  # of the polygon that approximates a circle
#: Corners and middles of the sides of a frame, clockwise from the top left.
FRAME_POINTS = np.array([[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]])
LIGHT_DIRECTION = np.array([0.0, -0.6, -0.8])  # in the camera's frame: the light is above it
GLOSS_EXPONENT = 30  # width of the reflection on paper
LENS_PLANE = np.array([0.0, 0.0, 1.0, 0.0])  # the plane of spots right before the lens


@dataclass(frozen=True)
class Canvas:
    """The image of a camera with a border for the blur.

    Attributes:
        camera: The camera.
        reach: Radius up to which its lens model holds (see `lens_reach`).
        pad: Width of the border, px.
        size: Width and height with the border, px.
    """

    camera: Camera
    reach: float
    pad: int
    size: tuple[int, int]

    def project(self, points: Float) -> Float:
        """Return the image pixels (..., 2) of points (..., 3) mm in the camera's frame."""
        return project(self.camera, points, self.reach)


@dataclass(frozen=True)
class RenderPrimitive:
    """A flat object with its projected outline.

    Attributes:
        edges: Edges (k, 2, 2) px from the corner of the canvas.
        weights: Weights (k, 3) of the edges in the value, in the cover, and in the cover of the
            pattern without its margin. A weight is added to the area to the right of an edge that
            goes down.
        plane: Plane (4,) of the object, n . X = d, in the camera's frame.
        scale: Offset and factor (2,) from pattern values to grey levels.
        box: Bounding box on the canvas.
        area: Area of the pattern, px.
        patch: Index of the patch in the scene, or -1.
    """

    edges: Float
    weights: Float
    plane: Float
    scale: Float
    box: Box
    area: float
    patch: int


def render_primitives(scene: Scene, canvas: Canvas) -> list[RenderPrimitive]:
    """Return the primitives of a scene that are on a canvas, from near to far."""
    primitives = _patch_primitives(scene, canvas)
    for occluder in scene.occluders:
        if isinstance(occluder, Ball):
            primitives += _ball_primitive(occluder, canvas)
        elif occluder.camera in (None, canvas.camera.name):
            outline = _ellipse_outline(occluder) + canvas.pad + 0.5
            spot = _polygon_primitive(outline, LENS_PLANE, occluder.level, canvas.size)
            primitives.append((0.0, spot))
    if scene.led is not None:
        primitives += _led_primitive(scene.led, canvas)
    primitives.sort(key=lambda item: item[0])
    return [p for _, p in primitives if p.box[0] < p.box[2] and p.box[1] < p.box[3]]


def union(boxes: list[Box]) -> Box:
    """Return the bounding box of all boxes that are not empty."""
    full = np.array([b for b in boxes if b[0] < b[2] and b[1] < b[3]])
    if not len(full):
        return EMPTY_BOX
    (x0, y0), (x1, y1) = full[:, :2].min(0), full[:, 2:].max(0)
    return int(x0), int(y0), int(x1), int(y1)


def grow(box: Box, margin: int, size: tuple[int, int]) -> Box:
    """Return the box, enlarged by `margin` px on all sides within a canvas of `size`."""
    x0, y0, x1, y1 = box
    if x0 >= x1:
        return box
    left, top = max(x0 - margin, 0), max(y0 - margin, 0)
    return left, top, min(x1 + margin, size[0]), min(y1 + margin, size[1])


def bounding_box(points: Float, size: tuple[int, int]) -> Box:
    """Return the box of points (n, 2) px within a canvas of `size`; NaN are ignored."""
    if not len(points):
        return EMPTY_BOX
    low, high = points.min(0), points.max(0)
    if np.isnan(low).any():
        return bounding_box(points[np.isfinite(points[:, 0])], size)
    x0, y0 = max(int(np.floor(low[0])), 0), max(int(np.floor(low[1])), 0)
    x1, y1 = min(int(np.ceil(high[0])) + 1, size[0]), min(int(np.ceil(high[1])) + 1, size[1])
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else EMPTY_BOX


# Patches: their cells, margins and curl, projected with the lens's distortion.


class _PatchViews:
    """The patches of a scene in the frame of a camera."""

    def __init__(self, patches: tuple[Patch, ...], canvas: Canvas) -> None:
        camera = canvas.camera
        self._canvas = canvas
        self.shapes = np.array([p.pattern.shape[::-1] for p in patches], float)
        self.margins = np.array([p.margin for p in patches])[:, None]
        self._cells = np.array([p.cell for p in patches])
        self.centers = camera.to_camera(np.stack([p.center for p in patches]))
        axes = camera.rotation @ np.stack([p.axes for p in patches])
        self.normals = axes[:, :, 2]
        self._right = axes[:, :, 0] * self._cells[:, None]
        self._down = -axes[:, :, 1] * self._cells[:, None]
        self._curls, self._sizes = np.array([[p.curl, p.size] for p in patches]).T[..., None, None]
        self._is_curled = bool(self._curls.any())

    def project(self, cells: Float, of: Int | slice) -> Float:
        """Project points (m, k, 2), in cells from the centers of the patches `of`, to px."""
        flat = cells[..., :1] * self._right[of, None] + cells[..., 1:] * self._down[of, None]
        if self._is_curled:
            in_mm = cells * self._cells[of, None, None]
            height = curl_height(in_mm, self._curls[of], self._sizes[of])
            flat = flat + height * self.normals[of, None, :]
        return self._canvas.project(self.centers[of, None] + flat)


def _patch_primitives(scene: Scene, canvas: Canvas) -> list[tuple[float, RenderPrimitive]]:
    """Return the primitives of the patches that face the camera, with their distances, mm."""
    patches = scene.patches
    if not patches:
        return []
    views = _PatchViews(patches, canvas)
    frames = FRAME_POINTS * (views.shapes / 2 + views.margins)[:, None]
    sides = views.project(frames, slice(None))
    piece_length = _max_piece_length(sides, (views.shapes + 2 * views.margins).max(1))
    height = (views.normals * views.centers).sum(1)  # negative on the viewer's side
    chosen = np.flatnonzero((height < 0) & np.isfinite(sides).all((1, 2)))
    if not len(chosen):
        return []
    cut = [
        pattern_edges(patches[i].pattern, patches[i].margin, float(piece_length[i])) for i in chosen
    ]
    of = np.repeat(chosen, [len(c[0]) for c in cut])
    cells = np.concatenate([c[0] for c in cut]) - views.shapes[of, None] / 2
    edges = views.project(cells, of) + (canvas.pad + 0.5)
    starts = np.flatnonzero(np.diff(of, prepend=-1))
    low = np.clip(np.floor(np.minimum.reduceat(edges.min(1), starts)), 0, canvas.size).astype(int)
    high = np.clip(np.ceil(np.maximum.reduceat(edges.max(1), starts)), 0, canvas.size).astype(int)
    areas = np.add.reduceat(_swept_areas(edges, np.concatenate([c[1] for c in cut])), starts)
    boxes = [(x, y, X, Y) for (x, y), (X, Y) in zip(low.tolist(), high.tolist(), strict=True)]
    planes = np.column_stack([views.normals, height])
    distance = np.linalg.norm(views.centers, axis=1)
    scales = _grey_scales(scene, views, height, distance)
    ends = [*starts[1:].tolist(), len(edges)]
    return [
        (
            float(distance[i]),
            RenderPrimitive(edges[a:b], c[1], planes[i], scales[i], box, float(abs(area)), int(i)),
        )
        for i, c, a, b, box, area in zip(chosen, cut, starts, ends, boxes, areas, strict=True)
    ]


def _grey_scales(scene: Scene, views: _PatchViews, height: Float, distance: Float) -> Float:
    """Return the offsets and factors (m, 2) from pattern values to grey levels."""
    light = 1 - scene.shade * (1 + height / distance)
    halfway = LIGHT_DIRECTION - views.centers / distance[:, None]
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    mirrored = np.clip((views.normals * halfway).sum(1), 0, 1) ** GLOSS_EXPONENT
    black, white = (ink * light + scene.gloss * mirrored for ink in scene.ink)
    return np.stack([black, (white - black) / 255], axis=1)


def _max_piece_length(sides: Float, width: Float) -> Float:
    """Return how long pieces of edges may be, cells (m,), to stay close to their chords.

    Args:
        sides: Frames (m, 8, 2) px of the patches.
        width: Widths of the patches (m,), cells.

    Returns:
        Powers of two; the bow of a piece grows with the square of its length.
    """
    start, middle, end = sides[:, 0::2], sides[:, 1::2], np.roll(sides, -2, axis=1)[:, 0::2]
    along, off = end - start, middle - start
    with np.errstate(divide="ignore", invalid="ignore"):
        bow = np.abs(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])
        bow = np.nan_to_num(bow / np.linalg.norm(along, axis=-1)).max(1)
        length = width * np.sqrt(MAX_BOW_PX / 2 / np.maximum(bow, 1e-9))
    return np.asarray(2.0 ** np.floor(np.log2(np.clip(length, 1 / 512, 4096))))


def pattern_edges(
    pattern: NDArray[np.uint8], margin: float, max_length: float
) -> tuple[Float, Float]:
    """Return the edges of a pattern in its white margin, in pieces.

    Args:
        pattern: Values of the cells (r, c).
        margin: Width of the margin, cells.
        max_length: Largest length of a piece, cells.

    Returns:
        Segments (k, 2, 2), in cells to the right and down from the top left corner, and their
        weights (k, 3) as in `RenderPrimitive`.
    """
    return _cut_edges(pattern.tobytes(), pattern.shape, float(margin), float(max_length))


@lru_cache(maxsize=4096)
def _cut_edges(
    data: bytes, shape: tuple[int, int], margin: float, max_length: float
) -> tuple[Float, Float]:
    segments, weights = _whole_edges(data, shape, margin)
    length = np.abs(segments[:, 1] - segments[:, 0]).max(-1)
    count = np.maximum(np.ceil(length / max_length - 1e-9), 1).astype(np.int64)
    of = np.repeat(np.arange(len(segments)), count)
    first = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    share = np.stack([first, first + 1], axis=1) / count[of, None]
    start, along = segments[of, :1], segments[of, 1:] - segments[of, :1]
    return start + share[:, :, None] * along, weights[of]


@lru_cache(maxsize=1024)
def _whole_edges(data: bytes, shape: tuple[int, int], margin: float) -> tuple[Float, Float]:
    rows, columns = shape
    values = np.frombuffer(data, np.uint8).reshape(shape).astype(float)
    cells = np.pad(values, 1, constant_values=WHITE)
    edges: list[tuple[float, float, float, float, float]] = []
    for j, change in enumerate((cells[1:-1, 1:] - cells[1:-1, :-1]).T):
        edges += [(j, a, j, b, w) for a, b, w in _constant_runs(change)]
    for i, change in enumerate(cells[:-1, 1:-1] - cells[1:, 1:-1]):
        edges += [(a, i, b, i, w) for a, b, w in _constant_runs(change)]
    inner = np.array(edges).reshape(-1, 5)
    frames = [_frame_edges(rows, columns, m) for m in (margin, 0.0)]
    segments = np.concatenate([inner[:, :4], *frames]).reshape(-1, 2, 2)
    weights = np.zeros((len(segments), 3))
    weights[:-8, 0] = inner[:, 4]
    weights[-8:-4] = WHITE, 1.0, 0.0
    weights[-4:, 2] = 1.0
    return segments, weights


def _frame_edges(rows: int, columns: int, margin: float) -> Float:
    low, right, bottom = -margin, columns + margin, rows + margin
    return np.array(
        [
            [low, low, low, bottom],
            [low, bottom, right, bottom],
            [right, bottom, right, low],
            [right, low, low, low],
        ]
    )


def _constant_runs(change: Float) -> list[tuple[int, int, float]]:
    """Return the runs (from, to, value) of equal values other than zero."""
    ends = np.flatnonzero(np.diff(change, prepend=np.nan, append=np.nan) != 0)
    return [(int(a), int(b), float(change[a])) for a, b in pairwise(ends) if change[a] != 0]


# Objects of one grey level: balls, LEDs and spots before the lens.


def _swept_areas(edges: Float, weights: Float) -> Float:
    """Return what each edge (k, 2, 2) adds to the area of the pattern, px."""
    cross = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    return np.asarray(weights[:, 2] * cross / 2)


def _polygon_primitive(
    outline: Float, plane: Float, level: float, size: tuple[int, int]
) -> RenderPrimitive:
    """Return a polygon (k, 2) px of one grey level."""
    edges = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    turn = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]).sum()
    edges = edges if turn < 0 else np.ascontiguousarray(edges[:, ::-1])
    weights, box = np.tile([0.0, 1.0, 1.0], (len(edges), 1)), bounding_box(outline, size)
    area = float(abs(_swept_areas(edges, weights).sum()))
    return RenderPrimitive(edges, weights, plane, np.array([level, 0.0]), box, area, -1)


def _circle(center: Float, radius: float) -> Float:
    """Return points (k, 3) of a circle perpendicular to the ray to its center."""
    axis = center / np.linalg.norm(center)
    across = np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    a = 2 * np.pi * np.arange(CIRCLE_SIDES)[:, None] / CIRCLE_SIDES
    return np.asarray(center + radius * (np.cos(a) * across + np.sin(a) * np.cross(axis, across)))


def _disc_primitive(
    center: Float, radius: float, z: float, level: float, canvas: Canvas
) -> list[tuple[float, RenderPrimitive]]:
    """Return a disc that faces the camera, at depth `z` mm, with its distance; or none."""
    outline = canvas.project(_circle(center, radius)) + (canvas.pad + 0.5)
    if not np.isfinite(outline).all() or z <= 0:
        return []
    plane = np.array([0.0, 0.0, 1.0, z])
    distance = float(np.linalg.norm(center) * z / center[2])
    return [(distance, _polygon_primitive(outline, plane, level, canvas.size))]


def _ball_primitive(ball: Ball, canvas: Canvas) -> list[tuple[float, RenderPrimitive]]:
    center = canvas.camera.to_camera(ball.center)
    distance = float(np.linalg.norm(center))
    if distance <= ball.radius or center[2] <= 0:
        return []
    shrink = 1 - (ball.radius / distance) ** 2  # to the circle where the rays touch the ball
    z = float(center[2]) - ball.radius
    rim_radius = float(ball.radius * np.sqrt(shrink))
    return _disc_primitive(center * shrink, rim_radius, z, ball.level, canvas)


def _led_primitive(led: Led, canvas: Canvas) -> list[tuple[float, RenderPrimitive]]:
    center = canvas.camera.to_camera(led.center)
    level = led.on_level if led.is_on else led.off_level
    z = float(center[2]) - led.radius
    return _disc_primitive(center, led.radius, z, level, canvas)


def _ellipse_outline(ellipse: Ellipse) -> Float:
    a = 2 * np.pi * np.arange(CIRCLE_SIDES) / CIRCLE_SIDES
    x, y = ellipse.radii[0] * np.cos(a), ellipse.radii[1] * np.sin(a)
    c, s = np.cos(ellipse.angle), np.sin(ellipse.angle)
    return np.stack([ellipse.center[0] + c * x - s * y, ellipse.center[1] + s * x + c * y], axis=1)
