"""Divide the faces of a file into triangles, each within the outline of its face."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.errors import BodyError

#: Smallest triangle of a fan, as a share of the face's area: faces with thinner ones have corners
#: on a line and are divided otherwise.
MIN_FAN_SHARE = 1e-6


def divide_faces(
    vertices: Float, corners: Int, counts: Int, line_of: Callable[[int], int] | None = None
) -> Int:
    """Divide faces of three or more corners into triangles that cover them and nothing else.

    Triangles stay as they are. Convex faces are divided from their first corner, and other ones by
    ear clipping in the plane of the face.

    Args:
        vertices: Corners (n, 3), in any unit.
        corners: Indices of the vertices of all faces, one face after the other (k,).
        counts: Number of corners of each face (m,), with sum k.
        line_of: Function from the index of a face to its line in the file, for errors.

    Returns:
        Triangles (t, 3) in the order of the faces.

    Raises:
        BodyError: A face has fewer than three corners, or names a vertex that does not exist.
    """
    corners, counts = np.asarray(corners, np.int64), np.asarray(counts, np.int64)
    _check_faces(len(vertices), corners, counts, line_of)
    first = np.cumsum(counts) - counts
    if (counts == 3).all():
        return corners.reshape(-1, 3)
    offsets = first - 2 * np.arange(len(counts))  # of the triangles of each face
    triangles = np.empty((len(corners) - 2 * len(counts), 3), np.int64)
    for count in np.unique(counts).tolist():
        which = np.flatnonzero(counts == count)
        faces = corners[first[which][:, None] + np.arange(count)]
        triangles[offsets[which][:, None] + np.arange(count - 2)] = _divide(vertices, faces)
    return triangles


def divide_rows(vertices: Float, faces: Sequence[Int]) -> Int:
    """Divide arrays of faces (m, c), each of one number of corners; see `divide_faces`."""
    corners = np.concatenate([np.asarray(f, np.int64).reshape(-1) for f in faces])
    counts = np.concatenate([np.full(len(f), f.shape[1]) for f in faces])
    return divide_faces(vertices, corners, counts)


def _check_faces(
    vertex_count: int, corners: Int, counts: Int, line_of: Callable[[int], int] | None
) -> None:
    few = np.flatnonzero(counts < 3)
    if len(few):
        raise _face_error(
            few[0], f"a face has {counts[few[0]]} corners", "face-too-few-corners", line_of
        )
    wrong = np.flatnonzero((corners < 0) | (corners >= vertex_count))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(counts), wrong[0], side="right"))
        problem = f"a face names a vertex that does not exist; the file has {vertex_count}"
        raise _face_error(face, problem, "vertex-missing", line_of)


def _face_error(
    face: int, problem: str, code: str, line_of: Callable[[int], int] | None
) -> BodyError:
    line = int(line_of(int(face))) if line_of else None
    return BodyError(
        f"line {line}: {problem}" if line else f"{problem} (face {face + 1})",
        code=code,
        action="Export the mesh again",
        line=line,
        face=int(face) + 1,
    )


def _divide(vertices: Float, faces: Int) -> Int:
    """Return the triangles (m, c - 2, 3) of faces (m, c)."""
    count = faces.shape[1]
    ends = np.arange(1, count - 1)
    fans = np.stack([np.broadcast_to(faces[:, :1], (len(faces), count - 2)), faces[:, ends],
                     faces[:, ends + 1]], axis=2)  # fmt: skip
    if count == 3:
        return fans
    with np.errstate(over="ignore", invalid="ignore"):
        normals, is_fan_valid = _check_fans(vertices, fans)
    for k in np.flatnonzero(~is_fan_valid):
        triangles = _clip_ears(vertices[faces[k]], normals[k])
        if triangles is not None:
            fans[k] = faces[k][triangles]
    return fans


def _check_fans(vertices: Float, fans: Int) -> tuple[Float, Bool]:
    """Return the normals of faces (m, 3), and whether their fans (m, c - 2, 3) cover them.

    They do if all triangles turn as the face does. The fan's sum is the vector area of the face
    (Newell's normal), of whatever shape it is.
    """
    x = vertices[fans]
    crosses = np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0])
    normals = crosses.sum(1)
    areas = np.linalg.norm(normals, axis=1)
    along = np.einsum("mti,mi->mt", crosses, normals)
    is_valid = (along > MIN_FAN_SHARE * areas[:, None] ** 2).all(1)
    return normals, np.asarray(is_valid)


def _clip_ears(points: Float, normal: Float) -> Int | None:
    """Return the triangles (c - 2, 3) of one face (c, 3), or None if it has no area."""
    import manifold3d

    length = np.linalg.norm(normal)
    if not np.isfinite(points).all() or not np.isfinite(length) or length == 0:
        return None
    axis = int(np.argmax(np.abs(normal)))
    # Projected along an axis, the outline stays an affine image of the face.
    u, v = [(1, 2), (2, 0), (0, 1)][axis]
    flat = points[:, [u, v]] - points[0, [u, v]]
    if normal[axis] < 0:
        flat = flat * [1.0, -1.0]
    triangles = np.asarray(manifold3d.triangulate([flat]), np.int64)
    return triangles if len(triangles) == len(points) - 2 else None
