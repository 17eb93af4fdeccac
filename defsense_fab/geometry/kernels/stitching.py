"""Make solids of closed shells and of faces whose edges meet, and fill the cavities of solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import build123d as bd
import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid, BRepBuilderAPI_Sewing
from OCP.BRepClass3d import BRepClass3d
from OCP.BRepLib import BRepLib
from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL, TopAbs_SOLID
from OCP.TopoDS import TopoDS, TopoDS_Shell

from ...core.arrays import Float
from .brep import find_subshapes

#: Distances between edges that are tried in turn until the faces close, mm. The last one is the
#: distance by which facets may leave the body.
STITCH_TOLERANCES_MM = (1e-3, 0.01, 0.05)


@dataclass(frozen=True)
class CollectedSolids:
    """The solids of a file or script, and its surfaces that bound none.

    Attributes:
        solids: TopoDS_Solids with outward faces.
        stitched: Number of faces that were stitched.
        tolerance: Distance between the edges that were stitched, mm; zero if none were.
        surfaces: Number of faces that bound no solid.
        opening: Middle (3,) of an edge where these end, mm; None if there are none.
    """

    solids: tuple[Any, ...]
    stitched: int = 0
    tolerance: float = 0.0
    surfaces: int = 0
    opening: Float | None = None


def collect_solids(pieces: Sequence[Any]) -> CollectedSolids:
    """Return the solids in some shapes.

    A closed shell counts as a solid. Other surfaces are stitched if there is no solid.

    Args:
        pieces: TopoDS_Shapes: solids, and shells and faces outside them (see `brep.pieces_of`).
    """
    solids: list[Any] = []
    faces: list[Any] = []
    for piece in pieces:
        if piece.ShapeType() == TopAbs_SOLID:
            solids.append(_turn_outward(piece))
        elif (solid := _solid_within(piece)) is not None:
            solids.append(solid)
        else:
            faces += find_subshapes(piece, TopAbs_FACE)
    if not faces:
        return CollectedSolids(tuple(solids))
    if solids:
        return CollectedSolids(tuple(solids), surfaces=len(faces))
    return _stitch(faces)


def _stitch(faces: Sequence[Any]) -> CollectedSolids:
    """Join faces with the smallest tolerance by which they close."""
    if len(faces) == 1 and (solid := _solid_within(_shell_of(faces[0]))) is not None:
        return CollectedSolids((solid,))  # a whole sphere or torus
    opening = None
    for tolerance in STITCH_TOLERANCES_MM:
        sewing = BRepBuilderAPI_Sewing(tolerance)
        for face in faces:
            sewing.Add(face)
        sewing.Perform()
        if sewing.NbFreeEdges():
            opening = _middle(sewing.FreeEdge(1))
            continue
        solids = [_solid_within(s) for s in find_subshapes(sewing.SewedShape(), TopAbs_SHELL)]
        if solids and None not in solids:
            return CollectedSolids(tuple(solids), len(faces), tolerance)
    return CollectedSolids((), surfaces=len(faces), opening=opening)


def _shell_of(face: Any) -> Any:
    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    builder.Add(shell, face)
    return shell


def _solid_within(shell: Any) -> Any | None:
    """Return the TopoDS_Solid within a closed shell; None if the shell is open or not valid."""
    if shell.ShapeType() != TopAbs_SHELL or not BRep_Tool.IsClosed_s(shell):
        return None
    solid = BRepBuilderAPI_MakeSolid(TopoDS.Shell_s(shell)).Solid()
    is_oriented = BRepLib.OrientClosedSolid_s(solid)
    return solid if is_oriented and bd.Solid(solid).is_valid else None


def _turn_outward(solid: Any) -> Any:
    """Return a TopoDS_Solid whose volume is not negative."""
    if bd.Solid(solid).volume < 0:
        BRepLib.OrientClosedSolid_s(solid)
    return solid


def _middle(edge: Any) -> Float:
    point = bd.Edge(TopoDS.Edge_s(edge)).position_at(0.5)
    return np.array([point.X, point.Y, point.Z])


def find_cavities(solid: Any) -> list[tuple[float, Float]]:
    """Return the volume, mm^3, and center (3,), mm, of each cavity of a TopoDS_Solid, largest
    first.
    """
    outer = BRepClass3d.OuterShell_s(solid)
    cavities = []
    for shell in map(TopoDS.Shell_s, find_subshapes(solid, TopAbs_SHELL)):
        if not shell.IsSame(outer):
            cavity = bd.Solid(BRepBuilderAPI_MakeSolid(shell).Solid())
            middle = cavity.center(bd.CenterOf.BOUNDING_BOX)
            cavities.append((abs(cavity.volume), np.array([middle.X, middle.Y, middle.Z])))
    return sorted(cavities, key=lambda c: -c[0])


def fill_cavities(solid: Any) -> Any:
    """Return the TopoDS_Solid within the outer shell of a TopoDS_Solid."""
    return BRepBuilderAPI_MakeSolid(BRepClass3d.OuterShell_s(solid)).Solid()
