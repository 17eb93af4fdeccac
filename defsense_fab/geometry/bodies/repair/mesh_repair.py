"""Repair triangles to one closed surface, or refuse where that would be a guess."""

from __future__ import annotations

import igl
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.errors import BodyError
from ....core.mesh import Surface, facet_crosses
from ...kernels import triangle_kernel
from .connectivity import clean_triangles, separate_sheets
from .crossings import find_crossing_pairs, find_wrong_faces
from .findings import describe_point, format_count
from .holes import close_holes
from .remesh import enclose_in_boxes, measure_displacement, rebuild_in_boxes, rebuild_whole
from .shells import Shell, find_holders, find_shells, remove_inner_shells, select_piece

MAX_TRIES = 4
SLIVER_SHARE = 1e-6  # of the size: slivers are thinner, and removing them moves less
MAX_DISPLACEMENT_SHARE = 0.02  # of the size: a repair may not move the surface farther
WHOLE_CELLS = 150  # along the longest side, when the whole surface is rebuilt
MAX_BOX_SHARE = 0.5  # of the size: with larger boxes the whole surface is rebuilt
MAX_BOXES = 24
MAX_BAD_SHARE = 0.4  # of the area
MIN_VOLUME_SHARE = 1e-9  # of the cube of the size


def repair_mesh(
    vertices: Float, faces: Int, where: str, fill_cavities: bool = False
) -> tuple[Float, Int, list[str]]:
    """Repair triangles to one closed surface that does not pass through itself, turned outward.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).
        where: File to name in errors.
        fill_cavities: Whether closed cavities are filled; otherwise they are an error.

    Returns:
        Vertices, faces, and a sentence on each repair: its place, how far it moved the surface, and
        how it changed the volume.

    Raises:
        BodyError: If the surface has wide holes, several pieces or cavities, encloses no volume, or
            cannot be repaired.
    """
    size = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
    vertices, faces, sentences = clean_triangles(vertices, faces, size)
    if len(faces) == 0:
        raise _no_volume_error(where)
    oriented = _orient_faces(faces)
    if (oriented != faces).any():
        sentences.append("turned inconsistent faces")
    vertices, faces, closings = close_holes(vertices, oriented, size, where)
    sentences += closings
    if closings:
        faces = _orient_faces(faces)
    sheets, joint_notes = _separate_sheets(vertices, faces, size, where)
    solid, solid_notes = _make_one_solid(sheets, size, where, fill_cavities)
    return solid.vertices, solid.faces, sentences + joint_notes + solid_notes


def _separate_sheets(
    vertices: Float, faces: Int, size: float, where: str
) -> tuple[Surface, list[str]]:
    """Separate sheets that touch, or else rebuild the surface.

    Triangles that cannot be joined to others are removed, with ever more neighbors, and the holes
    are filled.
    """
    at, replaced = vertices[faces[0, 0]], 0
    for rings in range(MAX_TRIES):
        sheets = separate_sheets(vertices, faces, size)
        if isinstance(sheets, tuple):
            done = []
            if replaced:
                count = format_count(replaced, "triangle")
                done.append(
                    f"replaced {count} at edges that have more than two, near {describe_point(at)}"
                )
            return Surface(*sheets[:2]), done + sheets[2]
        is_removed = sheets
        at = vertices[faces[is_removed][0]].mean(0)
        for _ in range(rings):
            is_removed = np.asarray(np.isin(faces, faces[is_removed]).any(1))
        replaced += int(is_removed.sum())
        try:
            vertices, faces, _ = close_holes(vertices, faces[~is_removed], size, where)
        except BodyError:
            break
        faces = _orient_faces(faces)
    problem = f"edges have more than two faces, one near {describe_point(at)}"
    return _rebuild_all(Surface(vertices, faces), size, where, problem)


def _orient_faces(faces: Int) -> Int:
    """Return the triangles (m, 3) with neighbors turned alike."""
    return np.asarray(igl.bfs_orient(np.ascontiguousarray(faces))[0], np.int64)


def _make_one_solid(
    surface: Surface, size: float, where: str, fill: bool
) -> tuple[Surface, list[str]]:
    """Return the surface of the one body in closed, oriented triangles, turned outward."""
    done: list[str] = []
    shells = find_shells(surface, size)
    if sum(s.volume for s in shells) < MIN_VOLUME_SHARE * size**3:
        raise _no_volume_error(where)
    outer = shells
    if len(shells) > 1:
        crossing = _find_crossing_shells(surface.vertices, shells)
        holders = find_holders(surface.vertices, shells, crossing)
        outer, done = remove_inner_shells(shells, holders, where, fill)
    if outer[0].turned:
        done.append("turned the surface inside out")
    meshes = []
    for shell in outer:
        mesh, sentences = _uncross(Surface(surface.vertices, shell.faces), size, where)
        meshes.append(mesh)
        done += sentences
    mesh = _unite(meshes, where)
    shells = find_shells(mesh, size)
    if len(outer) > len(shells):
        overlap = sum(m.volume for m in meshes) - mesh.volume
        done.append(
            f"united {len(outer)} shells that overlapped by {max(overlap, 0.0):.3g} mm3 or touched,"
            f" one around {describe_point(outer[-1].middle)}"
        )
    if len(shells) > 1:  # united shells and rebuilt surfaces may have enclosed some
        holders = find_holders(mesh.vertices, shells, set())
        shells, more = remove_inner_shells(shells, holders, where, fill)
        done += more
    pieces, dropped = select_piece(shells, where)
    piece, removed = _remove_slivers(Surface(mesh.vertices, pieces[0].faces).compact()[0], size)
    if len(outer) > 1:
        _check_united(piece, size, where)
    return piece, done + dropped + removed


def _no_volume_error(where: str) -> BodyError:
    return BodyError(
        "encloses no volume",
        code="encloses-no-volume",
        where=where,
        action="Give a closed solid",
    )


def _find_crossing_shells(vertices: Float, shells: list[Shell]) -> set[tuple[int, int]]:
    """Return the pairs of shells that cross each other, the first before the second."""
    owner = np.repeat(np.arange(len(shells)), [len(s.faces) for s in shells])
    pairs = owner[find_crossing_pairs(vertices, np.concatenate([s.faces for s in shells]))]
    return {(min(a, b), max(a, b)) for a, b in pairs.tolist() if a != b}


def _find_bad(mesh: Surface, size: float) -> Bool:
    bad = find_wrong_faces(mesh, size)
    bad[find_crossing_pairs(mesh.vertices, mesh.faces).reshape(-1)] = True
    return bad


def _describe_bad(mesh: Surface, bad: Bool) -> str:
    at = mesh.vertices[mesh.faces[bad]].mean(1)[0]
    return (
        f"the surface passes through itself, in {bad.sum()} triangles such as at"
        f" {describe_point(at)}"
    )


def _uncross(mesh: Surface, size: float, where: str) -> tuple[Surface, list[str]]:
    """Rebuild one shell where it crosses itself."""
    bad = _find_bad(mesh, size)
    if not bad.any():
        return mesh, []
    problem = _describe_bad(mesh, bad)
    area = np.linalg.norm(facet_crosses(mesh.vertices, mesh.faces), axis=1)
    if area[bad].sum() > MAX_BAD_SHARE * area.sum():
        raise BodyError(
            f"{problem}, so that it bounds no solid",
            code="surface-crosses-itself",
            where=where,
            action="Make the mesh again",
        )
    for wider in (1.0, 2.5):
        boxes = enclose_in_boxes(mesh, bad, size, wider)
        if len(boxes) > MAX_BOXES or np.ptp(boxes, axis=1).max() > MAX_BOX_SHARE * size:
            break
        rebuilt = rebuild_in_boxes(mesh, boxes)
        if rebuilt is None or _find_bad(rebuilt, size).any():
            continue
        change = _describe_change(mesh, rebuilt, size, where, problem)
        places = ", ".join(describe_point(b.mean(0)) for b in boxes[:3])
        more = f" and {len(boxes) - 3} more" if len(boxes) > 3 else ""
        count = format_count(len(boxes), "place")
        return rebuilt, [
            f"rebuilt the surface where it passed through itself, in {count}: {places}{more};"
            f" {change}"
        ]
    return _rebuild_all(mesh, size, where, problem)


def _rebuild_all(mesh: Surface, size: float, where: str, problem: str) -> tuple[Surface, list[str]]:
    """Rebuild a whole surface, or raise BodyError if that moves it too far."""
    rebuilt = rebuild_whole(mesh, WHOLE_CELLS)
    if rebuilt is None or _find_bad(rebuilt, size).any():
        raise BodyError(
            problem,
            code="surface-crosses-itself",
            where=where,
            action="Unite the overlapping parts in a mesh editor",
        )
    change = _describe_change(mesh, rebuilt, size, where, problem)
    return rebuilt, [f"rebuilt the whole surface and rounded its edges, since {problem}; {change}"]


def _describe_change(before: Surface, after: Surface, size: float, where: str, problem: str) -> str:
    """Describe how a repair changed a surface, or raise BodyError if it moved it too far."""
    distance = measure_displacement(before, after, size)
    if distance > MAX_DISPLACEMENT_SHARE * size:
        raise BodyError(
            f"{problem}, and rebuilding it would move it by {distance:.2g} mm",
            code="repair-moves-too-far",
            where=where,
            action="Unite the overlapping parts in a mesh editor",
            distance=distance,
        )
    share = after.volume / before.volume - 1
    return f"moved at most {distance:.2g} mm, volume {100 * share:+.2g} %"


def _unite(meshes: list[Surface], where: str) -> Surface:
    """Unite shells that overlap or share a part of a face."""
    if len(meshes) == 1:
        return meshes[0]
    solids = [triangle_kernel.try_manifold(m) for m in meshes]
    if any(solid is None for solid in solids):
        raise BodyError(
            "one of its shells is not closed",
            code="surface-not-closed",
            where=where,
            action="Close it in a mesh editor",
        )
    return triangle_kernel.to_surface(triangle_kernel.union(solids))


def _remove_slivers(mesh: Surface, size: float) -> tuple[Surface, list[str]]:
    """Remove triangles that are almost lines, if the triangle kernel can."""
    count = int(_find_thin(mesh, size).sum())
    solid = triangle_kernel.try_manifold(mesh) if count else None
    if solid is None:
        return mesh, []
    simplified = triangle_kernel.to_surface(solid.simplify(SLIVER_SHARE * size))
    removed = count - int(_find_thin(simplified, size).sum())
    if removed <= 0 or len(find_crossing_pairs(simplified.vertices, simplified.faces)):
        return mesh, []
    return simplified, [
        f"removed {format_count(removed, 'sliver')} thinner than {SLIVER_SHARE * size:.1g} mm"
    ]


def _find_thin(mesh: Surface, size: float) -> Bool:
    corners = mesh.vertices[mesh.faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    cross = facet_crosses(mesh.vertices, mesh.faces)
    return np.asarray(np.linalg.norm(cross, axis=1) < SLIVER_SHARE * size * sides.max(1))


def _check_united(mesh: Surface, size: float, where: str) -> None:
    """Raise BodyError if united shells pass through themselves."""
    bad = _find_bad(mesh, size)
    if bad.any():
        raise BodyError(
            f"united, {_describe_bad(mesh, bad)}",
            code="surface-crosses-itself",
            where=where,
            action="Unite the overlapping parts in a mesh editor",
        )
