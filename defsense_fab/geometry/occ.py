"""The OpenCascade kernel: the only module that imports build123d."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import build123d as bd
import numpy as np
from OCP.TopAbs import TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

from ..core.arrays import Float
from ..core.curve import Hermite, Plane
from ..core.errors import BodyError, FabricationError
from ..core.mesh import Surface

#: Largest angle between neighbouring facets of a curved face, rad: 0.06 % of a circle's area.
ANGLE = 0.06


def solids_of(result: Any) -> list[Any]:
    """TopoDS_Solids in what a script returned: a build123d or CadQuery object."""
    if hasattr(result, "vals") and callable(result.vals):  # a CadQuery Workplane
        shapes = [v.wrapped for v in result.vals() if hasattr(v, "wrapped")]
    elif hasattr(result, "part") and hasattr(result.part, "wrapped"):  # a BuildPart
        shapes = [result.part.wrapped]
    elif getattr(result, "wrapped", None) is not None:
        shapes = [result.wrapped]
    else:
        raise BodyError(
            f"body() returned {type(result).__name__}; return a build123d or CadQuery solid"
        )
    solids: list[Any] = []
    for shape in shapes:
        walk = TopExp_Explorer(shape, TopAbs_SOLID)
        while walk.More():
            solids.append(TopoDS.Solid_s(walk.Current()))
            walk.Next()
    return solids


def read_step(path: Path) -> list[Any]:
    """TopoDS_Solids of a STEP file. Raises BodyError where it cannot be read."""
    try:
        return solids_of(bd.import_step(str(path)))
    except BodyError:
        raise
    except Exception as error:  # the reader raises bare exceptions of OCP
        text = " ".join(str(error).split())
        raise BodyError(f"{path}: cannot be read as STEP: {text}") from None


def write_step(solid: Any, path: Path, label: str) -> None:
    shape = bd.Solid(solid)
    shape.label = label
    bd.export_step(shape, str(path))


def volume(solid: Any) -> float:
    return float(bd.Solid(solid).volume)


def tessellate(solid: Any, tolerance: float) -> Surface:
    """Closed triangle surface of a solid, no facet further than `tolerance` mm from it."""
    points, triangles = bd.Solid(solid).tessellate(tolerance, ANGLE)
    v = np.array([[p.X, p.Y, p.Z] for p in points], float)
    f = np.array(triangles, np.int64)
    _, first, inverse = np.unique(np.round(v, 6), axis=0, return_index=True, return_inverse=True)
    f = inverse.reshape(-1)[f]
    f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]
    return Surface(v[first], f)


def tube(plane: Plane, curve: Hermite, before: float, after: float, diameter: float) -> Any:
    """Round tube along a planar Hermite path, lengthened by straight ends, as a TopoDS_Solid.

    Each span becomes the cubic Bezier curve that equals it, so the tube is exact.
    """
    world = plane.to_world(curve.points)
    axes = plane.axes[:, :2]
    tangent = curve.tangents @ axes.T
    first, last = (t / np.linalg.norm(t) for t in (tangent[0], tangent[-1]))
    start, end = world[0] - before * first, world[-1] + after * last
    edges = [bd.Line(tuple(start), tuple(world[0]))] if before > 1e-6 else []
    for i in range(len(world) - 1):
        a, b = world[i], world[i + 1]
        poles = [a, a + tangent[i] / 3, b - tangent[i + 1] / 3, b]
        edges.append(bd.Bezier(*[tuple(p) for p in poles]))
    if after > 1e-6:
        edges.append(bd.Line(tuple(world[-1]), tuple(end)))
    section = bd.Plane(origin=tuple(start), z_dir=tuple(first)) * bd.Circle(diameter / 2)
    try:
        swept = bd.sweep(sections=section.face(), path=bd.Wire(edges))
        solid = swept.solids()[0]
    except Exception as error:  # OCP's own exceptions carry no common base
        text = " ".join(str(error).split()) or type(error).__name__
        raise FabricationError(f"the channel cannot be swept: {text}; smooth the path") from None
    if solid.volume <= 0 or not solid.is_valid:
        raise FabricationError(
            "the channel's solid is not valid; the path bends tighter than the channel's radius"
        )
    return solid.wrapped


def carve_and_split(
    solid: Any, tubes: Sequence[Any], planes: Sequence[Plane]
) -> tuple[list[Any], float]:
    """Cut the tubes out of the body and split it at the planes: parts and removed volume."""
    carved = bd.Solid(solid)
    removed = 0.0
    for t in tubes:
        cutter = bd.Solid(t)
        removed += sum(float(s.volume) for s in (bd.Solid(solid) & cutter).solids())
        pieces = (carved - cutter).solids()
        if len(pieces) != 1:
            raise FabricationError(
                f"a channel cuts the body into {len(pieces)} pieces; move the cord inwards"
            )
        carved = pieces[0]
    parts = [carved]
    for plane in planes:
        knife = bd.Plane(
            origin=tuple(plane.origin), x_dir=tuple(plane.axes[:, 0]), z_dir=tuple(plane.normal)
        )
        parts = [s for p in parts for s in bd.split(p, bisect_by=knife, keep=bd.Keep.BOTH).solids()]
    return [p.wrapped for p in parts], removed


def centroid(solid: Any) -> Float:
    c = bd.Solid(solid).center(bd.CenterOf.MASS)
    return np.array([c.X, c.Y, c.Z])
