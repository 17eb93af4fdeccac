"""Exchange exact solids between processes in OpenCascade's BREP files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from OCP.BinTools import BinTools
from OCP.BRep import BRep_Builder
from OCP.TopAbs import TopAbs_FACE, TopAbs_SHAPE, TopAbs_SHELL, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Shape


def find_subshapes(shape: Any, kind: Any, outside: Any = TopAbs_SHAPE) -> Iterator[Any]:
    """Yield the parts of a TopoDS_Shape that have a kind of TopAbs_ShapeEnum.

    Args:
        shape: The TopoDS_Shape.
        kind: Kind of the parts.
        outside: Kind whose content is skipped; nothing is skipped by default.
    """
    explorer = TopExp_Explorer(shape, kind, outside)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def pieces_of(shape: Any) -> list[Any]:
    """Return the TopoDS_Solids of a TopoDS_Shape, its shells outside solids, and its faces outside
    shells, in this order.
    """
    return [
        *map(TopoDS.Solid_s, find_subshapes(shape, TopAbs_SOLID)),
        *map(TopoDS.Shell_s, find_subshapes(shape, TopAbs_SHELL, TopAbs_SOLID)),
        *map(TopoDS.Face_s, find_subshapes(shape, TopAbs_FACE, TopAbs_SHELL)),
    ]


def write_brep(pieces: Sequence[Any], path: Path) -> None:
    """Write TopoDS_Shapes to a binary BREP file.

    Raises:
        OSError: If the file cannot be written.
    """
    builder, compound = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(compound)
    for piece in pieces:
        builder.Add(compound, piece)
    if not BinTools.Write_s(compound, str(path)):
        raise OSError(f"{path}: OpenCascade could not write it")


def read_brep(path: Path) -> list[Any]:
    """Return the pieces (see `pieces_of`) of a file of `write_brep`.

    Raises:
        OSError: If the file cannot be read.
    """
    shape = TopoDS_Shape()
    if not BinTools.Read_s(shape, str(path)):
        raise OSError(f"{path}: OpenCascade could not read it")
    return pieces_of(shape)
