"""Triangle meshes: read STL, OBJ, PLY, 3MF; mend what can be mended; refuse the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import BodyError
from ...core.mesh import Surface

#: Holes wider than this part of the bounding box's diagonal are not guessed at.
LARGEST_HOLE = 0.1
#: Of the files that are read.
SUFFIXES = (".stl", ".obj", ".ply", ".3mf")
_STEP_OFF = 1e-5  # of the bounding box's diagonal
_3MF_UNITS = {
    "MicroMeter": 1e-3,
    "MilliMeter": 1.0,
    "CentiMeter": 10.0,
    "Inch": 25.4,
    "Foot": 304.8,
    "Meter": 1e3,
}


def read_mesh(
    path: Path, scale: float, sizes: tuple[float, float]
) -> tuple[Surface, tuple[str, ...]]:
    """The closed surface in `path` times `scale`, and what was repaired.

    Raises BodyError for an unreadable file, a size outside `sizes` mm, holes too wide to close,
    edges with more than two faces, several separate pieces, a surface that passes through itself,
    or no enclosed volume.
    """
    vertices, faces = _read(path)
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.linalg.norm(np.ptp(vertices * scale, axis=0)))
    if not sizes[0] <= size <= sizes[1]:
        raise BodyError(
            f"{path}: the body is {size:.3g} mm across; set [body] scale in device.toml (1000 where"
            " the file is in metres, 25.4 for inches)"
        )
    vertices, faces, repairs = repair(vertices * scale, faces, str(path))
    return Surface(vertices, faces), tuple(repairs)


def _read(path: Path) -> tuple[Float, Int]:
    if path.suffix.lower() not in SUFFIXES:
        raise BodyError(f"{path}: unknown kind of mesh; give .stl, .obj, .ply or .3mf")
    try:
        if path.suffix.lower() == ".3mf":
            vertices, faces = _read_3mf(path)
        else:
            import trimesh

            # Materials are files that the mesh names: they are not read.
            mesh = trimesh.load_mesh(path, process=False, skip_materials=True)
            vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # readers raise whatever their parsers do
        text = " ".join(str(error).split())
        raise BodyError(f"{path}: cannot be read as a mesh: {text}") from None
    if len(faces) == 0:
        raise BodyError(f"{path}: holds no triangles")
    if not np.isfinite(vertices).all():
        raise BodyError(f"{path}: a vertex is not a finite number")
    return vertices, faces


def _read_3mf(path: Path) -> tuple[Float, Int]:
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    unit = _3MF_UNITS[model.GetUnit().name]
    merged = model.MergeToModel()  # build items with their components and transforms
    objects = merged.GetMeshObjects()
    vertices, faces, offset = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        v = np.array([list(p.Coordinates) for p in mesh.GetVertices()], float)
        f = np.array([list(t.Indices) for t in mesh.GetTriangleIndices()], np.int64)
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    return unit * np.concatenate(vertices), np.concatenate(faces)


def repair(vertices: Float, faces: Int, where: str) -> tuple[Float, Int, list[str]]:
    """Merge, clean, close and orient; returns the closed mesh and what was done."""
    import igl

    done: list[str] = []
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    _, first, inverse = np.unique(
        np.round(vertices / (1e-7 * size)), axis=0, return_index=True, return_inverse=True
    )
    if len(first) < len(vertices):
        done.append(f"merged {len(vertices) - len(first)} coincident vertices")
    vertices, faces = vertices[first], inverse.reshape(-1)[faces]
    keep = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    _, unique = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    mask = np.zeros(len(faces), bool)
    mask[unique] = True
    mask &= keep
    if not mask.all():
        done.append(f"removed {(~mask).sum()} degenerate or doubled triangles")
    faces = faces[mask]
    edges, count = _edges(faces)
    if (count > 2).any():
        at = vertices[edges[count > 2][0]].mean(0)
        raise BodyError(
            f"{where}: {(count > 2).sum()} edges have more than two faces, one near"
            f" {_point(at)}; mend the mesh in a mesh editor"
        )
    oriented, _ = igl.bfs_orient(np.ascontiguousarray(faces))
    if (np.asarray(oriented) != faces).any():
        done.append("turned inconsistent faces")
    faces = np.asarray(oriented, np.int64)
    faces, closed = _close_holes(vertices, faces, size, where)
    if closed:
        done.append(f"closed {closed} small holes")
    used = np.unique(faces)
    index = np.full(len(vertices), -1)
    index[used] = np.arange(len(used))
    vertices, faces = vertices[used], index[faces]
    pieces = len(np.unique(np.asarray(igl.facet_components(faces)[1])))
    if pieces > 1:
        raise BodyError(f"{where}: is made of {pieces} separate pieces; unite them or keep one")
    volume = Surface(vertices, faces).volume
    if abs(volume) < 1e-9 * size**3:
        raise BodyError(f"{where}: encloses no volume; a closed solid is needed")
    if volume < 0:
        faces = faces[:, ::-1].copy()
        done.append("turned the surface inside out")
    _refuse_crossed(vertices, faces, size, where)
    return vertices, faces, done


def _refuse_crossed(vertices: Float, faces: Int, size: float, where: str) -> None:
    """Refuse a surface that passes through itself: just inside of every facet the winding number
    must be 1, just outside 0."""
    import igl

    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    whole = length > (_STEP_OFF * size) ** 2
    middle = ((a + b + c) / 3)[whole]
    step = _STEP_OFF * size * normal[whole] / length[whole, None]
    surface = (np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
    within, outside = (
        np.asarray(igl.fast_winding_number(*surface, np.ascontiguousarray(p)))
        for p in (middle - step, middle + step)
    )
    wrong = (np.abs(within - 1) > 0.5) | (np.abs(outside) > 0.5)
    if wrong.any():
        raise BodyError(
            f"{where}: the surface passes through itself, in {wrong.sum()} places such as"
            f" {_point(middle[wrong][0])}; unite the overlapping parts in a mesh editor"
        )


def _edges(faces: Int) -> tuple[Int, Int]:
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges, count = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    return edges, count


def _close_holes(vertices: Float, faces: Int, size: float, where: str) -> tuple[Int, int]:
    """Fan-fill each small simple boundary loop; refuse wide or branching ones."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    present = {(int(a), int(b)) for a, b in directed}
    following: dict[int, int] = {}
    for a, b in present:
        if (b, a) not in present:
            if b in following:
                raise BodyError(
                    f"{where}: holes meet at {_point(vertices[b])}; close them in a mesh editor"
                )
            following[b] = a
    added: list[list[int]] = []
    count = 0
    while following:
        start = next(iter(following))
        loop, at = [start], following.pop(start)
        while at != start:
            loop.append(at)
            if at not in following:
                raise BodyError(
                    f"{where}: an open border at {_point(vertices[at])} is no loop; close it in a"
                    " mesh editor"
                )
            at = following.pop(at)
        width = float(np.linalg.norm(np.ptp(vertices[loop], axis=0)))
        if width > LARGEST_HOLE * size:
            raise BodyError(
                f"{where}: a hole {width:.3g} mm wide with {len(loop)} edges near"
                f" {_point(vertices[loop].mean(0))} is too wide to close; close it in a mesh editor"
            )
        added += [[loop[0], loop[i], loop[i + 1]] for i in range(1, len(loop) - 1)]
        count += 1
    return (np.concatenate([faces, np.array(added, np.int64)]) if added else faces), count


def _point(p: Float) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in p) + ")"
