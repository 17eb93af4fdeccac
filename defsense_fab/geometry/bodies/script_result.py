"""Take apart what a body script returned: objects of build123d and CadQuery."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.GeomAbs import GeomAbs_Plane
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SOLID
from OCP.TopoDS import TopoDS, TopoDS_Shape

from ...core.errors import BodyError
from ..kernels.brep import find_subshapes, pieces_of
from .repair.findings import describe_solids

_ONE_SOLID = "Return one build123d or CadQuery solid"
_MESH_FILE = "Write the mesh to a file, and name it as [body] mesh in device.toml"
_SELECTED = "Return the solid: workplane.findSolid()"
#: What to do with several solids, by the type that holds them.
_FUSE_ACTIONS = {
    "Assembly": "Fuse its parts: parts = assembly.toCompound().Solids(), then"
    " return parts[0].fuse(*parts[1:])",
    "list": "Fuse the items, such as items[0] + items[1] in build123d or items[0].union(items[1])"
    " in CadQuery, or return one of them",
    "other": "Fuse its solids into one, or return one of them",
}
#: Largest angle between planes that count as parallel.
PARALLEL_TOLERANCE_RAD = 1e-6


def pieces_from_result(result: Any) -> list[Any]:
    """Return the solids and surfaces in the result of a script.

    Args:
        result: What `body()` returned: an object of build123d or CadQuery, or a list of them that
            holds one solid.

    Returns:
        TopoDS_Shapes, see `brep.pieces_of`. Either there is one solid, or there are surfaces that
        may close.

    Raises:
        BodyError: If it holds several solids, or nothing that bounds a body.
    """
    if isinstance(result, type):
        raise BodyError(
            f"body() returned the class {result.__name__}",
            code="class-not-called",
            action="Call it to make a solid",
            type=result.__name__,
        )
    name, shapes = type(result).__name__, _shapes(result)
    if shapes is None:
        is_mesh = hasattr(result, "vertices") and hasattr(result, "faces")
        raise BodyError(
            f"body() returned {'None' if result is None else _with_article(name)}",
            code="not-a-solid",
            action=_MESH_FILE if is_mesh else _ONE_SOLID,
            type=name,
        )
    pieces = [piece for shape in shapes for piece in pieces_of(shape)]
    solids = [piece for piece in pieces if piece.ShapeType() == TopAbs_SOLID]
    if len(solids) > 1:
        raise _several_solids(name, solids)
    if not solids:
        _check_surfaces(name, shapes, pieces)
    return pieces


def _several_solids(name: str, solids: Sequence[Any]) -> BodyError:
    from ..kernels import occ

    descriptions = describe_solids([(occ.volume(s), occ.centroid(s)) for s in solids])
    kind = "list" if name in ("list", "tuple", "ShapeList") else name
    return BodyError(
        f"body() returned {_with_article(name)} of {len(solids)} solids instead of one:"
        f" {descriptions}",
        code="not-one-solid",
        action=_FUSE_ACTIONS.get(kind, _FUSE_ACTIONS["other"]),
        type=name,
        count=len(solids),
    )


def _check_surfaces(name: str, shapes: Sequence[Any], pieces: Sequence[Any]) -> None:
    """Raise BodyError if shapes without a solid bound no body: lines, or a flat drawing."""
    faces = [TopoDS.Face_s(f) for piece in pieces for f in find_subshapes(piece, TopAbs_FACE)]
    has_edges = any(True for shape in shapes for _ in find_subshapes(shape, TopAbs_EDGE))
    if not has_edges:
        content = "that is empty"
        action = "Check its sizes, and the operands of the last cut or intersection"
    elif not faces:
        content, action = "that has no surface", "Extrude, revolve or sweep it into a solid"
    elif _is_flat(faces):
        content, action = "of flat faces", "Extrude or revolve it into a solid"
    else:
        return
    raise BodyError(
        f"body() returned {_with_article(name)} {content}",
        code="not-a-solid",
        action=_SELECTED if has_edges and name == "Workplane" else action,
        type=name,
        surfaces=len(faces),
    )


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"


def _is_flat(faces: Sequence[Any]) -> bool:
    """Whether all of some TopoDS_Faces are parts of parallel planes."""
    surfaces = [BRepAdaptor_Surface(face) for face in faces]
    if any(s.GetType() != GeomAbs_Plane for s in surfaces):
        return False
    first, *others = (s.Plane().Axis().Direction() for s in surfaces)
    return all(first.IsParallel(d, PARALLEL_TOLERANCE_RAD) for d in others)


def _shapes(result: Any) -> list[Any] | None:
    """Return the TopoDS_Shapes that an object holds; None if it is not an object of CAD."""
    if isinstance(result, list | tuple):
        return _all_shapes(result) if all(_shapes(item) is not None for item in result) else None
    if callable(getattr(result, "vals", None)):  # a CadQuery Workplane or Sketch
        return _all_shapes(result.vals())
    if callable(getattr(result, "toCompound", None)):  # a CadQuery Assembly
        return _all_shapes([result.toCompound()])
    for name in ("part", "sketch", "line"):  # of BuildPart, BuildSketch and BuildLine
        if hasattr(result, name):
            return _all_shapes([getattr(result, name)])
    try:
        shape = result.wrapped
    except AttributeError:
        return None
    except AssertionError:  # build123d's, of an empty shape
        return []
    return [shape] if isinstance(shape, TopoDS_Shape) else []


def _all_shapes(objects: Iterable[Any]) -> list[Any]:
    return [shape for o in objects for shape in _shapes(o) or ()]
