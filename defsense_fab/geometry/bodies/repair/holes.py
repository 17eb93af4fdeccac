"""Holes of a surface: found, and filled with triangles of the least area."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from ....core.machine.compiled import compiled
from .connectivity import edges_of
from .findings import number, place

#: Holes of more than three edges that are wider than this part of the bounding box's diagonal are
#: not guessed at.
LARGEST_HOLE = 0.1
_MOST_EDGES = 400  # of a hole that is filled with the least area
_NARROW = 1e-6  # of the size: a crack


def close_holes(
    vertices: Float, faces: Int, size: float, where: str
) -> tuple[Float, Int, list[str]]:
    """Fill each hole. Raises BodyError where one is too wide to guess what was there."""
    edges, count, _ = edges_of(faces)
    loops = _loops(edges[count == 1], where, vertices)
    if not loops:
        return vertices, faces, []
    added, extra = [], []
    wide: list[tuple[float, int, Float]] = []
    for loop in loops:
        points = vertices[loop]
        width = float(np.linalg.norm(np.ptp(points, axis=0)))
        if width > LARGEST_HOLE * size and len(loop) > 3:
            raise BodyError(
                f"{where}: a hole {width:.3g} mm wide with {len(loop)} edges near"
                f" {place(points.mean(0))} is too wide to close; close it in a mesh editor",
                code="hole-too-wide",
                width=width,
                edges=len(loop),
            )
        if len(loop) <= _MOST_EDGES:
            filled = np.asarray(loop)[_least_area(points)]
        else:
            extra.append(points.mean(0))
            middle = len(vertices) + len(extra) - 1
            following = np.roll(loop, -1)
            filled = np.stack([loop, following, np.full(len(loop), middle)], axis=1)
        added.append(filled)
        wide.append((width, len(loop), points.mean(0)))
    if extra:
        vertices = np.concatenate([vertices, extra])
    return vertices, np.concatenate([faces, *added]), _told(wide, vertices, added, size)


def _told(
    wide: list[tuple[float, int, Float]], vertices: Float, added: list[Int], size: float
) -> list[str]:
    """Cracks between triangles of which one has a vertex more are told apart from holes."""
    area = []
    for filled in added:
        c = vertices[filled]
        cross = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
        area.append(np.linalg.norm(cross, axis=1).sum() / 2)
    cracks = [w for w, a in zip(wide, area, strict=True) if a < _NARROW * size * w[0]]
    holes = [w for w, a in zip(wide, area, strict=True) if a >= _NARROW * size * w[0]]
    done = []
    if len(holes) == 1:
        width, count, at = holes[0]
        done.append(f"closed 1 hole, {width:.3g} mm wide with {count} edges, near {place(at)}")
    elif holes:
        width, count, at = max(holes, key=lambda h: h[0])
        done.append(
            f"closed {len(holes)} holes, the widest of {width:.3g} mm with {count} edges near"
            f" {place(at)}"
        )
    if cracks:
        width, _, at = max(cracks, key=lambda h: h[0])
        done.append(
            f"closed {number(len(cracks), 'crack')} of no width, the longest of {width:.3g} mm"
            f" near {place(at)}"
        )
    return done


def _loops(borders: Int, where: str, vertices: Float) -> list[list[int]]:
    """Cycles of border edges (k, 2), each vertex once in a cycle: where holes meet, each is one."""
    beside: dict[int, list[int]] = {}
    for a, b in borders.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    loops: list[list[int]] = []
    for start in list(beside):
        while beside[start]:
            path, index, at = [start], {start: 0}, start
            while True:
                if not beside[at]:
                    raise BodyError(
                        f"{where}: an open border at {place(vertices[at])} is no loop; close it in"
                        " a mesh editor",
                        code="border-not-a-loop",
                    )
                following = beside[at].pop()
                beside[following].remove(at)
                if following in index:
                    cut = index[following]
                    loops.append(path[cut:])
                    for gone in path[cut + 1 :]:
                        del index[gone]
                    path = path[: cut + 1]
                    at = following
                    if len(path) == 1:
                        break
                else:
                    index[following] = len(path)
                    path.append(following)
                    at = following
    return loops


def _least_area(points: Float) -> Int:
    """Triangles (n - 2, 3) between the points (n, 3) of a loop, of the least area together."""
    split = _splits(np.ascontiguousarray(points))
    out, todo = [], [(0, len(points) - 1)]
    while todo:
        i, k = todo.pop()
        if k - i < 2:
            continue
        j = int(split[i, k])
        out.append((i, j, k))
        todo += [(i, j), (j, k)]
    return np.array(out, np.int64)


@compiled()
def _splits(p: Float) -> Any:
    """Of each run from i to k of a loop, the corner between of its triangle on i, k."""
    n = len(p)
    best = np.zeros((n, n))
    split = np.zeros((n, n), np.int64)
    for gap in range(2, n):
        for i in range(n - gap):
            k = i + gap
            least = np.inf
            for j in range(i + 1, k):
                ax, ay, az = p[j, 0] - p[i, 0], p[j, 1] - p[i, 1], p[j, 2] - p[i, 2]
                bx, by, bz = p[k, 0] - p[i, 0], p[k, 1] - p[i, 1], p[k, 2] - p[i, 2]
                x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                area = best[i, j] + best[j, k] + np.sqrt(x * x + y * y + z * z)
                if area < least:
                    least = area
                    split[i, k] = j
            best[i, k] = least
    return split
