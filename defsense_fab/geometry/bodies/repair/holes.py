"""Find the holes of a surface and fill them with triangles of least area."""

from __future__ import annotations

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from ....core.machine import kernels
from ....core.mesh import facet_crosses, triangle_edges
from .findings import describe_point, format_count

#: Holes of more than three edges that are wider than this share of the bounding box's diagonal are
#: not filled.
MAX_HOLE_SHARE = 0.1
MAX_OPTIMAL_EDGES = 400  # of a hole that is filled with least area
CRACK_WIDTH_SHARE = 1e-6  # of the size


def close_holes(
    vertices: Float, faces: Int, size: float, where: str
) -> tuple[Float, Int, list[str]]:
    """Fill each hole of a surface.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).
        size: Diagonal of the bounding box, mm.
        where: File to name in errors.

    Returns:
        Vertices, faces, and sentences on what was done.

    Raises:
        BodyError: If a hole is too wide to guess what was there.
    """
    edges, count, _ = triangle_edges(faces)
    loops = _find_loops(edges[count == 1], where, vertices)
    if not loops:
        return vertices, faces, []
    added, middles = [], []
    holes: list[tuple[float, int, Float]] = []
    for loop in loops:
        points = vertices[loop]
        width = float(np.linalg.norm(np.ptp(points, axis=0)))
        if width > MAX_HOLE_SHARE * size and len(loop) > 3:
            raise BodyError(
                f"a hole {width:.3g} mm wide with {len(loop)} edges near"
                f" {describe_point(points.mean(0))} is too wide to close",
                code="hole-too-wide",
                where=where,
                action="Close it in a mesh editor",
                width=width,
                edges=len(loop),
            )
        if len(loop) <= MAX_OPTIMAL_EDGES:
            filled = np.asarray(loop)[_triangulate(points)]
        else:
            middles.append(points.mean(0))
            middle = len(vertices) + len(middles) - 1
            following = np.roll(loop, -1)
            filled = np.stack([loop, following, np.full(len(loop), middle)], axis=1)
        added.append(filled)
        holes.append((width, len(loop), points.mean(0)))
    if middles:
        vertices = np.concatenate([vertices, middles])
    return vertices, np.concatenate([faces, *added]), _describe(holes, vertices, added, size)


def _describe(
    filled_holes: list[tuple[float, int, Float]], vertices: Float, fillings: list[Int], size: float
) -> list[str]:
    """Describe the filled holes; cracks between triangles, of which one has an extra vertex,
    apart.
    """
    cracks: list[tuple[float, int, Float]] = []
    holes: list[tuple[float, int, Float]] = []
    for hole, filled in zip(filled_holes, fillings, strict=True):
        area = np.linalg.norm(facet_crosses(vertices, filled), axis=1).sum() / 2
        (cracks if area < CRACK_WIDTH_SHARE * size * hole[0] else holes).append(hole)
    sentences = []
    if len(holes) == 1:
        width, count, at = holes[0]
        sentences.append(
            f"closed 1 hole, {width:.3g} mm wide with {count} edges, near {describe_point(at)}"
        )
    elif holes:
        width, count, at = max(holes, key=lambda h: h[0])
        sentences.append(
            f"closed {len(holes)} holes, the widest of {width:.3g} mm with {count} edges near"
            f" {describe_point(at)}"
        )
    if cracks:
        width, _, at = max(cracks, key=lambda h: h[0])
        sentences.append(
            f"closed {format_count(len(cracks), 'crack')} of no width, the longest of"
            f" {width:.3g} mm"
            f" near {describe_point(at)}"
        )
    return sentences


def _find_loops(borders: Int, where: str, vertices: Float) -> list[list[int]]:
    """Return cycles of border edges (k, 2), each vertex once per cycle: where holes meet, each is
    one cycle.
    """
    neighbors: dict[int, list[int]] = {}
    for a, b in borders.tolist():
        neighbors.setdefault(a, []).append(b)
        neighbors.setdefault(b, []).append(a)
    loops: list[list[int]] = []
    for start in list(neighbors):
        while neighbors[start]:
            path, index, at = [start], {start: 0}, start
            while True:
                if not neighbors[at]:
                    raise BodyError(
                        f"an open border at {describe_point(vertices[at])} does not form a loop",
                        code="border-not-a-loop",
                        where=where,
                        action="Close it in a mesh editor",
                    )
                following = neighbors[at].pop()
                neighbors[following].remove(at)
                if following in index:
                    cut = index[following]
                    loops.append(path[cut:])
                    for vertex in path[cut + 1 :]:
                        del index[vertex]
                    path = path[: cut + 1]
                    at = following
                    if len(path) == 1:
                        break
                else:
                    index[following] = len(path)
                    path.append(following)
                    at = following
    return loops


def _triangulate(points: Float) -> Int:
    """Return triangles (n - 2, 3) of least total area between the points (n, 3) of a loop."""
    split = np.zeros((len(points), len(points)), np.int64)
    kernels.split_corners(np.ascontiguousarray(points, float), split)
    out, todo = [], [(0, len(points) - 1)]
    while todo:
        i, k = todo.pop()
        if k - i < 2:
            continue
        j = int(split[i, k])
        out.append((i, j, k))
        todo += [(i, j), (j, k)]
    return np.array(out, np.int64)
