"""Cavities of an exact solid: closed shells within its outer one."""

from __future__ import annotations

from typing import Any

import build123d as bd
import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
from OCP.BRepClass3d import BRepClass3d
from OCP.TopAbs import TopAbs_SHELL
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

from ...core.arrays import Float


def cavities(solid: Any) -> list[tuple[float, Float]]:
    """Of a TopoDS_Solid: each cavity's volume (mm3) and centre (3,) mm, the largest first."""
    outer = BRepClass3d.OuterShell_s(solid)
    found = []
    walk = TopExp_Explorer(solid, TopAbs_SHELL)
    while walk.More():
        shell = TopoDS.Shell_s(walk.Current())
        if not shell.IsSame(outer):
            own = bd.Solid(BRepBuilderAPI_MakeSolid(shell).Solid())
            middle = own.center(bd.CenterOf.BOUNDING_BOX)
            found.append((abs(own.volume), np.array([middle.X, middle.Y, middle.Z])))
        walk.Next()
    return sorted(found, key=lambda c: -c[0])


def filled(solid: Any) -> Any:
    """The TopoDS_Solid within its outer shell."""
    return BRepBuilderAPI_MakeSolid(BRepClass3d.OuterShell_s(solid)).Solid()
