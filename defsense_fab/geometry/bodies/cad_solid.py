"""Turn the solids of a CAD program into one solid without cavities, and its facets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...core.errors import BodyError
from ...core.mesh import Surface, triangle_edges
from ..kernels import occ, stitching
from ..kernels.stitching import STITCH_TOLERANCES_MM, CollectedSolids, collect_solids
from .repair.findings import (
    check_distance_from_origin,
    closed_cavity_error,
    describe_cavity,
    describe_point,
    describe_solids,
    format_count,
)
from .repair.shells import DEBRIS_SHARE


def make_cad_solid(
    pieces: Sequence[Any],
    where: str,
    sizes: tuple[float, float],
    tolerance: float,
    is_relative: bool,
    fill_cavities: bool,
) -> tuple[Any, Surface, tuple[str, ...]]:
    """Make one closed solid of solids or surfaces, fill its cavities and tessellate it.

    Args:
        pieces: What a script returned or a file holds, see `brep.pieces_of`.
        where: File to name in errors.
        sizes: Smallest and largest plausible size, mm.
        tolerance: Largest distance of a facet from the solid, mm.
        is_relative: Whether the tolerance is a share of the solid's size instead.
        fill_cavities: Whether closed cavities are filled; otherwise they are an error.

    Returns:
        The TopoDS_Solid without cavities, its facets, and sentences on what was repaired.

    Raises:
        BodyError: If there is not exactly one solid, or it is not closed, has an implausible size,
            lies far from the origin, or has cavities that may not be filled.
    """
    collected = collect_solids(pieces)
    solid = _one_solid(collected, where)
    size = occ.size(solid)
    if not sizes[0] <= size <= sizes[1]:
        raise BodyError(
            f"the body is {size:.3g} mm across",
            code="unlikely-size",
            where=where,
            action="Check its units: lengths are in mm",
            size=size,
        )
    solid, repairs = _fill_cavities(solid, where, fill_cavities)
    surface = _tessellate(solid, where, tolerance * size if is_relative else tolerance)
    check_distance_from_origin(where, surface.vertices, sizes[1])
    volume = occ.volume(solid)
    if not volume > 0:
        raise BodyError(
            f"the solid's volume is {volume:.3g} mm3",
            code="encloses-no-volume",
            where=where,
            action="Reverse its faces",
        )
    return solid, surface, (*_describe_stitches(collected), *repairs)


def _one_solid(collected: CollectedSolids, where: str) -> Any:
    """Return the only solid, or raise BodyError."""
    solids = collected.solids
    if len(solids) == 1:
        return solids[0]
    if solids:
        descriptions = describe_solids([(occ.volume(s), occ.centroid(s)) for s in solids])
        raise BodyError(
            f"gives {len(solids)} solids instead of one: {descriptions}",
            code="not-one-solid",
            where=where,
            action="Fuse the solids or remove all but one",
            count=len(solids),
        )
    if not collected.surfaces:
        raise BodyError(
            "gives no solid and no surface",
            code="no-solid",
            where=where,
            action="Export the solid from the program that made it",
            surfaces=0,
        )
    at = collected.opening
    reason = (
        "which do not bound a valid solid"
        if at is None
        else f"with an opening near {describe_point(at)} wider than {STITCH_TOLERANCES_MM[-1]:g} mm"
    )
    raise BodyError(
        f"gives {format_count(collected.surfaces, 'surface')} and no solid, {reason}",
        code="no-solid",
        where=where,
        action="Stitch the surfaces into a solid in the program that made them",
        surfaces=collected.surfaces,
        at=None if at is None else at.tolist(),
    )


def _describe_stitches(collected: CollectedSolids) -> tuple[str, ...]:
    """Return sentences on the surfaces that were stitched or left out."""
    if collected.stitched:
        surfaces = format_count(collected.stitched, "surface")
        return (f"stitched {surfaces} into a solid, with edges within {collected.tolerance:g} mm",)
    if collected.surfaces:
        return (f"left out {format_count(collected.surfaces, 'surface')} outside the solid",)
    return ()


def _fill_cavities(solid: Any, where: str, fill: bool) -> tuple[Any, tuple[str, ...]]:
    """Fill the cavities of a solid if that is allowed or they are tiny."""
    cavities = stitching.find_cavities(solid)
    if not cavities:
        return solid, ()
    text = describe_cavity(*cavities[0], len(cavities) - 1)
    whole = stitching.fill_cavities(solid)
    if cavities[0][0] >= DEBRIS_SHARE * occ.volume(whole) and not fill:
        raise closed_cavity_error(where, *cavities[0], len(cavities) - 1)
    return whole, (f"filled {text}",)


def _tessellate(solid: Any, where: str, tolerance: float) -> Surface:
    """Return the facets of a solid, or raise BodyError if they leave gaps."""
    try:
        surface = occ.tessellate(solid, tolerance)
    except Exception as error:  # OpenCascade's have no common base; ValueError if no facets
        raise BodyError(
            "its faces cannot be divided into facets",
            code="cannot-tessellate",
            where=where,
            action="Heal it in the program that made it, or export a mesh (STL) and name that as"
            " [body] mesh",
        ) from error
    edges, count, _ = triangle_edges(surface.faces)
    if (count % 2).any():
        at = surface.vertices[edges[count % 2 == 1][0]].mean(0)
        raise BodyError(
            f"the solid is not closed near {describe_point(at)}",
            code="surface-not-closed",
            where=where,
            action="Heal it in the program that made it, or export a mesh (STL) and name that as"
            " [body] mesh",
            at=at.tolist(),
        )
    return surface
