"""Closed, oriented triangles to one body whose surface does not pass through itself."""

from __future__ import annotations

from typing import Any

import igl
import manifold3d as m3
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.errors import BodyError
from ....core.mesh import Surface, facet_crosses
from .crossings import crossing_pairs, wrong_faces
from .findings import number, place
from .remesh import boxes_around, moved, remade, remade_whole
from .shells import Shell, nested, one_piece, shells_of, without_cavities

_TINY = 1e-6  # of the size: slivers are thinner, and what removing them moves is less
_FAR = 0.02  # of the size: a repair that moves the surface further is none
_CELLS = 150  # of a surface that is made anew as a whole
_HALF = 0.5  # of the size: boxes as large as this are no places any more
_MOST_BOXES = 24
_MOST_BAD = 0.4  # of the area

_Mesh = tuple[Float, Int]


def one_solid(
    vertices: Float, faces: Int, size: float, where: str, fill: bool
) -> tuple[Float, Int, list[str]]:
    """The surface of the one body in it, turned outward. Raises BodyError where there is none, or
    several, or cavities are not to be filled."""
    done: list[str] = []
    shells = shells_of(vertices, faces, size)
    if sum(s.volume for s in shells) < 1e-9 * size**3:
        raise BodyError(
            f"{where}: encloses no volume; a closed solid is needed", code="encloses-no-volume"
        )
    if len(shells) == 1:
        kept, pairs = shells, np.zeros((0, 2), np.int64)
    else:
        pairs = _crossing_shells(vertices, shells)
        kept, told = without_cavities(shells, nested(vertices, shells, pairs), where, fill)
        done += told
    if kept[0].turned:
        done.append("turned the surface inside out")
    sound = []
    for shell in kept:
        mesh, told = _uncrossed((vertices, shell.faces), size, where)
        sound.append(mesh)
        done += told
    mesh = _united(sound, where)
    shells = shells_of(*mesh, size)
    if len(kept) > len(shells):
        overlap = sum(Surface(*m).volume for m in sound) - Surface(*mesh).volume
        done.append(
            f"united {len(kept)} shells that overlapped by {max(overlap, 0.0):.3g} mm3 or touched,"
            f" one around {place(kept[-1].middle)}"
        )
    if len(shells) > 1:  # shells that are united, and surfaces made anew, may have closed some in
        nobody = np.zeros((0, 2), np.int64)
        shells, more = without_cavities(shells, nested(mesh[0], shells, nobody), where, fill)
        done += more
    pieces, told = one_piece(shells, where)
    kept_one = Surface(mesh[0], pieces[0].faces).compact()[0]
    mesh, more = _without_slivers((kept_one.vertices, kept_one.faces), size)
    if len(kept) > 1:
        _check(mesh, size, where)
    return *mesh, done + told + more


def remade_solid(
    vertices: Float, faces: Int, size: float, where: str, why: str, fill: bool
) -> tuple[Float, Int, list[str]]:
    """The surface of what triangles enclose that could not be joined to sheets."""
    made = _as_whole((vertices, faces), size, where, why)
    v, f, done = one_solid(*made[0], size, where, fill)
    return v, f, made[1] + done


def _crossing_shells(vertices: Float, shells: list[Shell]) -> Int:
    """Pairs (k, 2) of shells that cross each other."""
    owner = np.repeat(np.arange(len(shells)), [len(s.faces) for s in shells])
    pairs = owner[crossing_pairs(vertices, np.concatenate([s.faces for s in shells]))]
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _bad(mesh: _Mesh, size: float) -> Bool:
    bad = wrong_faces(*mesh, size)
    bad[crossing_pairs(*mesh).reshape(-1)] = True
    return bad


def _uncrossed(mesh: _Mesh, size: float, where: str) -> tuple[_Mesh, list[str]]:
    """One shell, made anew where it crosses itself."""
    bad = _bad(mesh, size)
    if not bad.any():
        return mesh, []
    at = mesh[0][mesh[1][bad]].mean(1)[0]
    crossed = f"the surface passes through itself, in {bad.sum()} triangles such as at {place(at)}"
    area = np.linalg.norm(facet_crosses(*mesh), axis=1)
    if area[bad].sum() > _MOST_BAD * area.sum():
        raise BodyError(
            f"{where}: {crossed}: it bounds no solid; make the mesh anew",
            code="surface-crosses-itself",
        )
    before = Surface(*mesh).volume
    for wider in (1.0, 2.5):
        boxes = boxes_around(*mesh, bad, size, wider)
        if len(boxes) > _MOST_BOXES or np.ptp(boxes, axis=1).max() > _HALF * size:
            break
        made = remade(*mesh, boxes)
        if made is None or _bad(made, size).any():
            continue
        far = moved(mesh, made, size)
        if far > _FAR * size:
            raise BodyError(
                _too_far(where, crossed, far), code="repair-moves-too-far", distance=far
            )
        places = ", ".join(place(b.mean(0)) for b in boxes[:3])
        more = f" and {len(boxes) - 3} more" if len(boxes) > 3 else ""
        return made, [
            f"made the surface anew where it passed through itself, in"
            f" {number(len(boxes), 'place')}: {places}{more}; moved at most {far:.2g} mm, volume"
            f" {_change(before, made)}"
        ]
    return _as_whole(mesh, size, where, crossed)


def _as_whole(mesh: _Mesh, size: float, where: str, why: str) -> tuple[_Mesh, list[str]]:
    """The whole surface made anew. Raises BodyError where that is too far from it."""
    made = remade_whole(*mesh, _CELLS)
    if made is None or _bad(made, size).any():
        raise BodyError(
            f"{where}: {why}; unite the overlapping parts in a mesh editor",
            code="surface-crosses-itself",
        )
    far = moved(mesh, made, size)
    if far > _FAR * size:
        raise BodyError(_too_far(where, why, far), code="repair-moves-too-far", distance=far)
    return made, [
        f"made the whole surface anew, since {why}; moved at most {far:.2g} mm, edges are rounded"
        f" by as much, volume {_change(Surface(*mesh).volume, made)}"
    ]


def _too_far(where: str, why: str, far: float) -> str:
    return (
        f"{where}: {why}, and making it anew would move it by {far:.2g} mm; unite the overlapping"
        " parts in a mesh editor"
    )


def _united(meshes: list[_Mesh], where: str) -> _Mesh:
    """Shells that overlap or have a part of a face in common as one."""
    if len(meshes) == 1:
        return meshes[0]
    return _arrays(m3.Manifold.batch_boolean([_manifold(m, where) for m in meshes], m3.OpType.Add))


def _manifold(mesh: _Mesh, where: str) -> Any:
    made = m3.Manifold(
        m3.Mesh64(np.ascontiguousarray(mesh[0]), np.ascontiguousarray(mesh[1], np.uint64))
    )
    if made.status() != m3.Error.NoError:
        raise BodyError(
            f"{where}: a shell of it is not closed; close it in a mesh editor",
            code="surface-not-closed",
        )
    return made


def _arrays(solid: Any) -> _Mesh:
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties, float)[:, :3], np.array(mesh.tri_verts, np.int64)


def _without_slivers(mesh: _Mesh, size: float) -> tuple[_Mesh, list[str]]:
    """Without triangles that are all but lines, where the triangle kernel can take them out."""
    count = int(_thin(mesh, size).sum())
    if not count:
        return mesh, []
    made = m3.Manifold(
        m3.Mesh64(np.ascontiguousarray(mesh[0]), np.ascontiguousarray(mesh[1], np.uint64))
    )
    if made.status() != m3.Error.NoError:
        return mesh, []
    less = _arrays(made.simplify(_TINY * size))
    gone = count - int(_thin(less, size).sum())
    if gone <= 0 or len(crossing_pairs(*less)):
        return mesh, []
    return less, [f"removed {number(gone, 'sliver')} thinner than {_TINY * size:.1g} mm"]


def _thin(mesh: _Mesh, size: float) -> Bool:
    corners = mesh[0][mesh[1]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    cross = facet_crosses(*mesh)
    return np.asarray(np.linalg.norm(cross, axis=1) < _TINY * size * sides.max(1))


def _check(mesh: _Mesh, size: float, where: str) -> None:
    bad = _bad(mesh, size)
    if bad.any():
        at = mesh[0][mesh[1][bad]].mean(1)[0]
        raise BodyError(
            f"{where}: united, the surface passes through itself, in {bad.sum()} triangles such as"
            f" at {place(at)}; unite the overlapping parts in a mesh editor",
            code="surface-crosses-itself",
        )


def _change(before: float, mesh: _Mesh) -> str:
    """How the volume changed."""
    now = Surface(*mesh).volume
    return f"{100 * (now / before - 1):+.2g} %"


def oriented(faces: Int) -> Int:
    """With neighbours turned alike."""
    return np.asarray(igl.bfs_orient(np.ascontiguousarray(faces))[0], np.int64)
