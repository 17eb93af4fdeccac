"""Exchange exact solids between processes in OpenCascade's BREP files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from OCP.BinTools import BinTools
from OCP.BRep import BRep_Builder
from OCP.TopAbs import TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Shape


def find_subshapes(shape: Any, kind: Any) -> Iterator[Any]:
    """Yield the parts of a TopoDS_Shape that have a kind of TopAbs_ShapeEnum."""
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def write_brep(solids: Sequence[Any], path: Path) -> None:
    """Write TopoDS_Solids to a binary BREP file.

    Raises:
        OSError: If the file cannot be written.
    """
    builder, compound = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(compound)
    for solid in solids:
        builder.Add(compound, solid)
    if not BinTools.Write_s(compound, str(path)):
        raise OSError(f"{path}: OpenCascade could not write it")


def read_brep(path: Path) -> list[Any]:
    """Return the TopoDS_Solids of a file of `write_brep`, in their order.

    Raises:
        OSError: If the file cannot be read.
    """
    shape = TopoDS_Shape()
    if not BinTools.Read_s(shape, str(path)):
        raise OSError(f"{path}: OpenCascade could not read it")
    return [TopoDS.Solid_s(s) for s in find_subshapes(shape, TopAbs_SOLID)]
