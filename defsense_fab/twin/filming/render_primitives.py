"""A scene as flat things with projected outlines, the nearest first, ready to be painted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float, Int
from ...core.camera import Camera
from ..scenes.scene import WHITE, Ball, Ellipse, Led, Scene, curl_height
from .camera_optics import project

# Edges between the cells of a pattern: all that is needed to fill it exactly.
#
# A picture of constant cells is the sum over edges of what changes across them; an edge between equal
# cells adds nothing. Edges in line with the same change on both sides of a corner are one.


def pieces(pattern: NDArray[np.uint8], margin: float, reach: float) -> tuple[Float, Float]:
    """Of a pattern (r, c) in its white margin: segments (k, 2, 2) no longer than `reach`, in cells
    to the right and downwards from its upper left corner, and (k, 3) the weights with which they
    count in the picture's values, in its cover, and in that of the pattern alone. A weight is
    added to what lies to the right of a segment that goes down."""
    return _pieces(pattern.tobytes(), pattern.shape, float(margin), float(reach))


@lru_cache(maxsize=4096)
def _pieces(
    data: bytes, shape: tuple[int, int], margin: float, reach: float
) -> tuple[Float, Float]:
    segments, weights = _edges(data, shape, margin)
    length = np.abs(segments[:, 1] - segments[:, 0]).max(-1)
    count = np.maximum(np.ceil(length / reach - 1e-9), 1).astype(np.int64)
    of = np.repeat(np.arange(len(segments)), count)
    first = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    at = np.stack([first, first + 1], axis=1) / count[of, None]
    start, along = segments[of, :1], segments[of, 1:] - segments[of, :1]
    return start + at[:, :, None] * along, weights[of]


@lru_cache(maxsize=1024)
def _edges(data: bytes, shape: tuple[int, int], margin: float) -> tuple[Float, Float]:
    rows, columns = shape
    cells = np.pad(np.frombuffer(data, np.uint8).reshape(shape).astype(float), 1,
                   constant_values=WHITE)  # fmt: skip
    found: list[tuple[float, float, float, float, float]] = []
    for j, change in enumerate((cells[1:-1, 1:] - cells[1:-1, :-1]).T):
        found += [(j, a, j, b, w) for a, b, w in _runs(change)]
    for i, change in enumerate(cells[:-1, 1:-1] - cells[1:, 1:-1]):
        found += [(a, i, b, i, w) for a, b, w in _runs(change)]
    inner = np.array(found).reshape(-1, 5)
    frames = [_frame(rows, columns, m) for m in (margin, 0.0)]
    segments = np.concatenate([inner[:, :4], *frames]).reshape(-1, 2, 2)
    weights = np.zeros((len(segments), 3))
    weights[:-8, 0] = inner[:, 4]
    weights[-8:-4] = WHITE, 1.0, 0.0
    weights[-4:, 2] = 1.0
    return segments, weights


def _frame(rows: int, columns: int, margin: float) -> Float:
    low, right, foot = -margin, columns + margin, rows + margin
    return np.array(
        [[low, low, low, foot], [low, foot, right, foot],
         [right, foot, right, low], [right, low, low, low]]
    )  # fmt: skip


def _runs(change: Float) -> list[tuple[int, int, float]]:
    """Stretches (from, to, value) of equal values other than zero."""
    ends = np.flatnonzero(np.diff(change, prepend=np.nan, append=np.nan) != 0)
    return [(int(a), int(b), float(change[a])) for a, b in pairwise(ends) if change[a] != 0]


#: x0, y0, x1, y1 in px of the canvas: the image and what is around it for the blur.
Box = tuple[int, int, int, int]

_BOW = 1e-3  # px: what a piece of an edge may bend away from its chord
_ROUND = 96  # sides of a polygon that stands for a circle
#: Corners and middles of the sides, clockwise from top left.
_FRAME = np.array([[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]])
#: Towards the light, which is above the camera, in its frame; how narrow paper mirrors it.
_LIGHT, _POLISH = np.array([0.0, -0.6, -0.8]), 30
_BEFORE = np.array([0.0, 0.0, 1.0, 0.0])  # the plane of what is right before the lens


@dataclass(frozen=True)
class RenderPrimitive:
    """`edges` (k, 2, 2) px from the canvas's corner, `weights` (k, 3) as in `pattern_edges.py`, the
    `plane` (4,) n . X = d in the camera's frame, `scale` (2,) from pattern values to grey levels,
    its `box`, the `area` of its pattern, px, and which `patch` of the scene it is, or -1."""

    edges: Float
    weights: Float
    plane: Float
    scale: Float
    box: Box
    area: float
    patch: int


def render_primitives(
    scene: Scene, camera: Camera, limit: float, pad: int, size: tuple[int, int]
) -> list[RenderPrimitive]:
    """What a camera can see of a scene, from near to far, on a canvas of this size with `pad` px
    around the image; `limit` is where its lens ends."""
    found = _patches(scene, camera, limit, pad, size)
    for one in scene.occluders:
        if isinstance(one, Ball):
            found += _ball(one, camera, limit, pad, size)
        elif one.camera in (None, camera.name):
            found.append((0.0, _filled(_ellipse(one) + pad + 0.5, _BEFORE, one.level, size)))
    if scene.led is not None:
        found += _led(scene.led, camera, limit, pad, size)
    found.sort(key=lambda one: one[0])
    return [t for _, t in found if t.box[0] < t.box[2] and t.box[1] < t.box[3]]


def union(boxes: list[Box]) -> Box:
    """The box that holds all that are not empty."""
    full = np.array([b for b in boxes if b[0] < b[2] and b[1] < b[3]])
    if not len(full):
        return (0, 0, 0, 0)
    (x0, y0), (x1, y1) = full[:, :2].min(0), full[:, 2:].max(0)
    return int(x0), int(y0), int(x1), int(y1)


def grown(box: Box, by: int, size: tuple[int, int]) -> Box:
    """Larger on all sides, within the canvas."""
    x0, y0, x1, y1 = box
    if x0 >= x1:
        return box
    return max(x0 - by, 0), max(y0 - by, 0), min(x1 + by, size[0]), min(y1 + by, size[1])


def box_of(points: Float, size: tuple[int, int]) -> Box:
    """Of points (n, 2) px within the canvas; NaN are left out."""
    if not len(points):
        return (0, 0, 0, 0)
    low, high = points.min(0), points.max(0)
    if np.isnan(low).any():
        return box_of(points[np.isfinite(points[:, 0])], size)
    x0, y0 = max(int(np.floor(low[0])), 0), max(int(np.floor(low[1])), 0)
    x1, y1 = min(int(np.ceil(high[0])) + 1, size[0]), min(int(np.ceil(high[1])) + 1, size[1])
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else (0, 0, 0, 0)


def _patches(
    scene: Scene, camera: Camera, limit: float, pad: int, size: tuple[int, int]
) -> list[tuple[float, RenderPrimitive]]:
    patches = scene.patches
    if not patches:
        return []
    shapes = np.array([p.pattern.shape[::-1] for p in patches], float)
    margins = np.array([p.margin for p in patches])[:, None]
    cells = np.array([p.cell for p in patches])
    centers = camera.to_camera(np.stack([p.center for p in patches]))
    axes = camera.rotation @ np.stack([p.axes for p in patches])
    right, down = axes[:, :, 0] * cells[:, None], -axes[:, :, 1] * cells[:, None]
    curls, sizes = np.array([[p.curl, p.size] for p in patches]).T[..., None, None]
    curled = bool(curls.any())

    def seen(at: Float, of: Int | slice) -> Float:
        """Points (m, k, 2), cells from the centers, in px; as `Patch.at` has them."""
        flat = at[..., :1] * right[of, None] + at[..., 1:] * down[of, None]
        if curled:
            up = curl_height(at * cells[of, None, None], curls[of], sizes[of])
            flat = flat + up * axes[of, None, :, 2]
        return project(camera, centers[of, None] + flat, limit)

    frames = _FRAME * (shapes / 2 + margins)[:, None]
    sides = seen(frames, slice(None))
    reach = _reach(sides, (shapes + 2 * margins).max(1))
    height = (axes[:, :, 2] * centers).sum(1)  # negative: the camera is on the viewer's side
    away = np.linalg.norm(centers, axis=1)
    light = 1 - scene.shade * (1 + height / away)
    chosen = np.flatnonzero((height < 0) & np.isfinite(sides).all((1, 2)))
    cut = [pieces(patches[i].pattern, patches[i].margin, float(reach[i])) for i in chosen]
    if not len(chosen):
        return []
    of = np.repeat(chosen, [len(c[0]) for c in cut])
    edges = seen(np.concatenate([c[0] for c in cut]) - shapes[of, None] / 2, of) + (pad + 0.5)
    starts = np.flatnonzero(np.diff(of, prepend=-1))
    low = np.clip(np.floor(np.minimum.reduceat(edges.min(1), starts)), 0, size).astype(int)
    high = np.clip(np.ceil(np.maximum.reduceat(edges.max(1), starts)), 0, size).astype(int)
    areas = np.add.reduceat(_swept(edges, np.concatenate([c[1] for c in cut])), starts)
    boxes = [(x, y, X, Y) for (x, y), (X, Y) in zip(low.tolist(), high.tolist(), strict=True)]
    planes = np.column_stack([axes[:, :, 2], height])
    halfway = _LIGHT - centers / away[:, None]
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    mirrored = np.clip((axes[:, :, 2] * halfway).sum(1), 0, 1) ** _POLISH
    dark, white = (ink * light + scene.gloss * mirrored for ink in scene.ink)
    scales = np.stack([dark, (white - dark) / 255], axis=1)
    ends = [*starts[1:].tolist(), len(edges)]
    return [
        (
            float(away[i]),
            RenderPrimitive(edges[a:b], c[1], planes[i], scales[i], box, float(abs(area)), int(i)),
        )
        for i, c, a, b, box, area in zip(chosen, cut, starts, ends, boxes, areas, strict=True)
    ]


def _reach(sides: Float, width: Float) -> Float:
    """How long pieces of edges may be, cells, in patches (m,) with frames (m, 8, 2) px that are
    `width` cells wide: a chord's bow goes with the square of its length."""
    start, middle, end = sides[:, 0::2], sides[:, 1::2], np.roll(sides, -2, axis=1)[:, 0::2]
    along, off = end - start, middle - start
    with np.errstate(divide="ignore", invalid="ignore"):
        bow = np.abs(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])
        bow = np.nan_to_num(bow / np.linalg.norm(along, axis=-1)).max(1)
        reach = width * np.sqrt(_BOW / 2 / np.maximum(bow, 1e-9))
    return np.asarray(2.0 ** np.floor(np.log2(np.clip(reach, 1 / 512, 4096))))


def _swept(edges: Float, weights: Float) -> Float:
    """What each edge (k, 2, 2) adds to the area of the pattern, px."""
    cross = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    return np.asarray(weights[:, 2] * cross / 2)


def _filled(outline: Float, plane: Float, level: float, size: tuple[int, int]) -> RenderPrimitive:
    """A polygon (k, 2) px of one grey level."""
    edges = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    turn = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]).sum()
    edges = edges if turn < 0 else np.ascontiguousarray(edges[:, ::-1])
    weights, box = np.tile([0.0, 1.0, 1.0], (len(edges), 1)), box_of(outline, size)
    area = float(abs(_swept(edges, weights).sum()))
    return RenderPrimitive(edges, weights, plane, np.array([level, 0.0]), box, area, -1)


def _circle(center: Float, radius: float) -> Float:
    """Points (k, 3) of a circle square to the ray to its center, in the camera's frame."""
    axis = center / np.linalg.norm(center)
    across = np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    a = 2 * np.pi * np.arange(_ROUND)[:, None] / _ROUND
    return np.asarray(center + radius * (np.cos(a) * across + np.sin(a) * np.cross(axis, across)))


def _round(
    center: Float, radius: float, z: float, level: float, camera: Camera, limit: float, pad: int,
    size: tuple[int, int],
) -> list[tuple[float, RenderPrimitive]]:  # fmt: skip
    outline = project(camera, _circle(center, radius), limit) + (pad + 0.5)
    if not np.isfinite(outline).all() or z <= 0:
        return []
    plane = np.array([0.0, 0.0, 1.0, z])
    return [(float(np.linalg.norm(center) * z / center[2]), _filled(outline, plane, level, size))]


def _ball(
    ball: Ball, camera: Camera, limit: float, pad: int, size: tuple[int, int]
) -> list[tuple[float, RenderPrimitive]]:
    center = camera.to_camera(ball.center)
    away = float(np.linalg.norm(center))
    if away <= ball.radius or center[2] <= 0:
        return []
    shrink = 1 - (ball.radius / away) ** 2  # to the circle where the rays touch it
    z = float(center[2]) - ball.radius
    rim = center * shrink, ball.radius * np.sqrt(shrink)
    return _round(rim[0], float(rim[1]), z, ball.level, camera, limit, pad, size)


def _led(
    led: Led, camera: Camera, limit: float, pad: int, size: tuple[int, int]
) -> list[tuple[float, RenderPrimitive]]:
    center, level = camera.to_camera(led.center), led.lit if led.on else led.dark
    z = float(center[2]) - led.radius
    return _round(center, led.radius, z, level, camera, limit, pad, size)


def _ellipse(one: Ellipse) -> Float:
    a = 2 * np.pi * np.arange(_ROUND) / _ROUND
    x, y = one.radii[0] * np.cos(a), one.radii[1] * np.sin(a)
    c, s = np.cos(one.angle), np.sin(one.angle)
    return np.stack([one.center[0] + c * x - s * y, one.center[1] + s * x + c * y], axis=1)
