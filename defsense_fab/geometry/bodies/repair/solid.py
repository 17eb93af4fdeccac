"""Turn closed, oriented triangles into one body whose surface does not pass through itself."""

from __future__ import annotations

from typing import Any

import igl
import manifold3d as m3
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.errors import BodyError
from ....core.mesh import Surface, facet_crosses
from .crossings import find_crossing_pairs, find_wrong_faces
from .findings import describe_point, format_count
from .remesh import enclose_in_boxes, measure_displacement, rebuild_in_boxes, rebuild_whole
from .shells import Shell, find_holders, find_shells, remove_inner_shells, select_piece

SLIVER_SHARE = 1e-6  # of the size: slivers are thinner, and removing them moves less
MAX_DISPLACEMENT_SHARE = 0.02  # of the size: a repair may not move the surface farther
WHOLE_CELLS = 150  # along the longest side, when the whole surface is rebuilt
MAX_BOX_SHARE = 0.5  # of the size: with larger boxes the whole surface is rebuilt
MAX_BOXES = 24
MAX_BAD_SHARE = 0.4  # of the area

_Mesh = tuple[Float, Int]


def make_one_solid(
    vertices: Float, faces: Int, size: float, where: str, fill: bool
) -> tuple[Float, Int, list[str]]:
    """Return the surface of the one body in closed, oriented triangles, turned outward.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).
        size: Diagonal of the bounding box, mm.
        where: File to name in errors.
        fill: Whether cavities are filled; otherwise they are an error.

    Returns:
        Vertices, faces, and sentences on what was done.

    Raises:
        BodyError: If there is no body, there are several, or cavities may not be filled.
    """
    done: list[str] = []
    shells = find_shells(vertices, faces, size)
    if sum(s.volume for s in shells) < 1e-9 * size**3:
        raise BodyError(
            "encloses no volume",
            code="encloses-no-volume",
            where=where,
            action="Give a closed solid",
        )
    if len(shells) == 1:
        outer, pairs = shells, np.zeros((0, 2), np.int64)
    else:
        pairs = _find_crossing_shells(vertices, shells)
        outer, sentences = remove_inner_shells(
            shells, find_holders(vertices, shells, pairs), where, fill
        )
        done += sentences
    if outer[0].turned:
        done.append("turned the surface inside out")
    meshes = []
    for shell in outer:
        mesh, sentences = _uncross((vertices, shell.faces), size, where)
        meshes.append(mesh)
        done += sentences
    mesh = _unite(meshes, where)
    shells = find_shells(*mesh, size)
    if len(outer) > len(shells):
        overlap = sum(Surface(*m).volume for m in meshes) - Surface(*mesh).volume
        done.append(
            f"united {len(outer)} shells that overlapped by {max(overlap, 0.0):.3g} mm3 or touched,"
            f" one around {describe_point(outer[-1].middle)}"
        )
    if len(shells) > 1:  # united shells and rebuilt surfaces may have enclosed some
        no_pairs = np.zeros((0, 2), np.int64)
        shells, more = remove_inner_shells(
            shells, find_holders(mesh[0], shells, no_pairs), where, fill
        )
        done += more
    pieces, sentences = select_piece(shells, where)
    piece = Surface(mesh[0], pieces[0].faces).compact()[0]
    mesh, more = _remove_slivers((piece.vertices, piece.faces), size)
    if len(outer) > 1:
        _check_united(mesh, size, where)
    return *mesh, done + sentences + more


def rebuild_solid(
    vertices: Float, faces: Int, size: float, where: str, problem: str, fill: bool
) -> tuple[Float, Int, list[str]]:
    """Rebuild the surface of what triangles enclose that could not be separated into sheets."""
    rebuilt = _rebuild_all((vertices, faces), size, where, problem)
    v, f, sentences = make_one_solid(*rebuilt[0], size, where, fill)
    return v, f, rebuilt[1] + sentences


def _find_crossing_shells(vertices: Float, shells: list[Shell]) -> Int:
    """Return pairs (k, 2) of shells that cross each other."""
    owner = np.repeat(np.arange(len(shells)), [len(s.faces) for s in shells])
    pairs = owner[find_crossing_pairs(vertices, np.concatenate([s.faces for s in shells]))]
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _find_bad(mesh: _Mesh, size: float) -> Bool:
    bad = find_wrong_faces(*mesh, size)
    bad[find_crossing_pairs(*mesh).reshape(-1)] = True
    return bad


def _uncross(mesh: _Mesh, size: float, where: str) -> tuple[_Mesh, list[str]]:
    """Rebuild one shell where it crosses itself."""
    bad = _find_bad(mesh, size)
    if not bad.any():
        return mesh, []
    at = mesh[0][mesh[1][bad]].mean(1)[0]
    problem = (
        f"the surface passes through itself, in {bad.sum()} triangles such as at"
        f" {describe_point(at)}"
    )
    area = np.linalg.norm(facet_crosses(*mesh), axis=1)
    if area[bad].sum() > MAX_BAD_SHARE * area.sum():
        raise BodyError(
            f"{problem}, so that it bounds no solid",
            code="surface-crosses-itself",
            where=where,
            action="Make the mesh again",
        )
    before = Surface(*mesh).volume
    for wider in (1.0, 2.5):
        boxes = enclose_in_boxes(*mesh, bad, size, wider)
        if len(boxes) > MAX_BOXES or np.ptp(boxes, axis=1).max() > MAX_BOX_SHARE * size:
            break
        rebuilt = rebuild_in_boxes(*mesh, boxes)
        if rebuilt is None or _find_bad(rebuilt, size).any():
            continue
        distance = measure_displacement(mesh, rebuilt, size)
        if distance > MAX_DISPLACEMENT_SHARE * size:
            raise _too_far_error(where, problem, distance)
        places = ", ".join(describe_point(b.mean(0)) for b in boxes[:3])
        more = f" and {len(boxes) - 3} more" if len(boxes) > 3 else ""
        return rebuilt, [
            f"rebuilt the surface where it passed through itself, in"
            f" {format_count(len(boxes), 'place')}: {places}{more}; moved at most"
            f" {distance:.2g} mm, volume"
            f" {_describe_change(before, rebuilt)}"
        ]
    return _rebuild_all(mesh, size, where, problem)


def _rebuild_all(mesh: _Mesh, size: float, where: str, problem: str) -> tuple[_Mesh, list[str]]:
    """Rebuild a whole surface, or raise BodyError if that moves it too far."""
    rebuilt = rebuild_whole(*mesh, WHOLE_CELLS)
    if rebuilt is None or _find_bad(rebuilt, size).any():
        raise BodyError(
            problem,
            code="surface-crosses-itself",
            where=where,
            action="Unite the overlapping parts in a mesh editor",
        )
    distance = measure_displacement(mesh, rebuilt, size)
    if distance > MAX_DISPLACEMENT_SHARE * size:
        raise _too_far_error(where, problem, distance)
    return rebuilt, [
        f"rebuilt the whole surface, since {problem}; moved at most {distance:.2g} mm, edges"
        f" are rounded"
        f" by as much, volume {_describe_change(Surface(*mesh).volume, rebuilt)}"
    ]


def _too_far_error(where: str, problem: str, distance: float) -> BodyError:
    return BodyError(
        f"{problem}, and rebuilding it would move it by {distance:.2g} mm",
        code="repair-moves-too-far",
        where=where,
        action="Unite the overlapping parts in a mesh editor",
        distance=distance,
    )


def _unite(meshes: list[_Mesh], where: str) -> _Mesh:
    """Unite shells that overlap or share a part of a face."""
    if len(meshes) == 1:
        return meshes[0]
    return _arrays(m3.Manifold.batch_boolean([_manifold(m, where) for m in meshes], m3.OpType.Add))


def _manifold(mesh: _Mesh, where: str) -> Any:
    solid = m3.Manifold(
        m3.Mesh64(np.ascontiguousarray(mesh[0]), np.ascontiguousarray(mesh[1], np.uint64))
    )
    if solid.status() != m3.Error.NoError:
        raise BodyError(
            "one of its shells is not closed",
            code="surface-not-closed",
            where=where,
            action="Close it in a mesh editor",
        )
    return solid


def _arrays(solid: Any) -> _Mesh:
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties, float)[:, :3], np.array(mesh.tri_verts, np.int64)


def _remove_slivers(mesh: _Mesh, size: float) -> tuple[_Mesh, list[str]]:
    """Remove triangles that are almost lines, if the triangle kernel can."""
    count = int(_find_thin(mesh, size).sum())
    if not count:
        return mesh, []
    solid = m3.Manifold(
        m3.Mesh64(np.ascontiguousarray(mesh[0]), np.ascontiguousarray(mesh[1], np.uint64))
    )
    if solid.status() != m3.Error.NoError:
        return mesh, []
    simplified = _arrays(solid.simplify(SLIVER_SHARE * size))
    removed = count - int(_find_thin(simplified, size).sum())
    if removed <= 0 or len(find_crossing_pairs(*simplified)):
        return mesh, []
    return simplified, [
        f"removed {format_count(removed, 'sliver')} thinner than {SLIVER_SHARE * size:.1g} mm"
    ]


def _find_thin(mesh: _Mesh, size: float) -> Bool:
    corners = mesh[0][mesh[1]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    cross = facet_crosses(*mesh)
    return np.asarray(np.linalg.norm(cross, axis=1) < SLIVER_SHARE * size * sides.max(1))


def _check_united(mesh: _Mesh, size: float, where: str) -> None:
    """Raise BodyError if united shells pass through themselves."""
    bad = _find_bad(mesh, size)
    if bad.any():
        at = mesh[0][mesh[1][bad]].mean(1)[0]
        raise BodyError(
            f"united, the surface passes through itself, in {bad.sum()} triangles such as at"
            f" {describe_point(at)}",
            code="surface-crosses-itself",
            where=where,
            action="Unite the overlapping parts in a mesh editor",
        )


def _describe_change(before: float, mesh: _Mesh) -> str:
    """Describe how the volume changed."""
    after = Surface(*mesh).volume
    return f"{100 * (after / before - 1):+.2g} %"


def orient_faces(faces: Int) -> Int:
    """Return the triangles (m, 3) with neighbors turned alike."""
    return np.asarray(igl.bfs_orient(np.ascontiguousarray(faces))[0], np.int64)
