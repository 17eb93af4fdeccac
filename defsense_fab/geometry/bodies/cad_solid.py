"""What CAD gave, as one solid without cavities, and its facets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.errors import BodyError
from ...core.mesh import Surface
from ..kernels import occ
from .repair.findings import check_near, place
from .repair.shells import DEBRIS, cavity_text, refused_cavities


@dataclass(frozen=True)
class CadSolid:
    """The TopoDS_Solid, its facets, its exact volume (mm3), and what was repaired."""

    solid: Any
    surface: Surface
    volume: float
    repairs: tuple[str, ...]


def cad_solid(
    solids: Sequence[Any],
    where: str,
    sizes: tuple[float, float],
    tolerance: float,
    relative: bool,
    fill_cavities: bool,
) -> CadSolid:
    """The one solid of TopoDS_Solids, with facets no further from it than `tolerance` mm, or times
    its size where that is `relative`.

    Raises BodyError where there is not one, it is not closed or of a size outside `sizes` mm,
    for one that lies far from the origin for these, and for cavities unless they are to be filled.
    """
    if len(solids) != 1:
        told = "; ".join(f"{occ.volume(s):.3g} mm3 around {place(occ.centroid(s))}"
                         for s in solids[:5])  # fmt: skip
        more = f" and {len(solids) - 5} more" if len(solids) > 5 else ""
        raise BodyError(
            f"{where}: gives {len(solids)} solids, one is needed; fuse them or remove the rest"
            + (f": {told}{more}" if solids else ""),
            code="not-one-solid",
            count=len(solids),
        )
    size = occ.size(solids[0])
    if not sizes[0] <= size <= sizes[1]:
        raise BodyError(
            f"{where}: the body is {size:.3g} mm across; lengths are in mm: check its units",
            code="unlikely-size",
            size=size,
        )
    solid, repairs = _without_cavities(solids[0], where, fill_cavities)
    surface = _facets(solid, where, tolerance * size if relative else tolerance)
    check_near(where, surface.vertices, sizes[1])
    volume = occ.volume(solid)
    if not volume > 0:
        raise BodyError(
            f"{where}: the solid's volume is {volume:.3g} mm^3; turn its faces",
            code="encloses-no-volume",
        )
    return CadSolid(solid, surface, volume, repairs)


def _without_cavities(solid: Any, where: str, fill: bool) -> tuple[Any, tuple[str, ...]]:
    found = occ.cavities(solid)
    if not found:
        return solid, ()
    rest = f" and {len(found) - 1} smaller" if len(found) > 1 else ""
    told = cavity_text(*found[0]) + rest
    whole = occ.filled(solid)
    if found[0][0] >= DEBRIS * occ.volume(whole) and not fill:
        raise BodyError(
            refused_cavities(where, told),
            code="closed-cavity",
            volume=found[0][0],
            at=found[0][1].tolist(),
            count=len(found),
        )
    return whole, (f"filled {told}",)


def _facets(solid: Any, where: str, tolerance: float) -> Surface:
    """Raises BodyError where they leave gaps."""
    try:
        surface = occ.tessellate(solid, tolerance)
    except Exception as error:  # OpenCascade's carry no common base; of no facets, ValueError
        text = " ".join(str(error).split()) or type(error).__name__
        raise BodyError(
            f"{where}: its faces cannot be divided into facets: {text}", code="cannot-tessellate"
        ) from None
    edges = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    if (count % 2).any():
        at = surface.vertices[unique[count % 2 == 1][0]].mean(0)
        raise BodyError(
            f"{where}: the solid is not closed near {place(at)}; heal it in the program that made"
            " it, or export a mesh (STL) and give that as [body] mesh",
            code="surface-not-closed",
            at=at.tolist(),
        )
    return surface
