"""Make the same parts from the exact solid with OpenCascade, and check both kernels on each
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.curve_conversion import curve_to_arcs
from ...core.errors import FabricationError
from ..kernels import occ
from ..kernels.cutting_tools import Tool
from .records import Part, PartSet

#: Largest difference of a part's volume between the kernels, as shares of the part and of the body.
PART_TOLERANCE, BODY_TOLERANCE = 2e-3, 1e-4


def add_solids(part_set: PartSet, solid: Any) -> PartSet:
    """Return the parts of `make_parts` with their exact solids.

    Args:
        part_set: The parts.
        solid: TopoDS_Solid of the body.

    Returns:
        The same parts with solids; without them and with a warning where OpenCascade fails, as the
        STL files do not need them.
    """
    try:
        body = carve_solid(solid, [t for seat in part_set.seats for t in seat.tools])
        with _convert_errors():
            return replace(part_set, parts=tuple(_make_solids(body, part_set)), carved=())
    except FabricationError as error:
        unsolved = replace(part_set, carved=())
        return unsolved.with_warnings({f"no STEP parts: {error}": None})


def carve_solid(solid: Any, tools: Sequence[Tool]) -> Any:
    """Return a TopoDS_Solid with tools cut out.

    Raises:
        FabricationError: If OpenCascade fails.
    """
    with _convert_errors():
        return occ.cut_out(solid, tools)


@contextmanager
def _convert_errors() -> Iterator[None]:
    """Turn OpenCascade's errors into FabricationError."""
    try:
        yield
    except FabricationError:
        raise
    except Exception as error:  # OCP's exceptions have no common base
        raise FabricationError(
            "OpenCascade could not divide the solid",
            code="kernel-failed",
            action="Move a cord plane slightly",
        ) from error


def _make_solids(solid: Any, part_set: PartSet) -> list[Part]:
    """Return the parts with their TopoDS_Solids, cut from the body's."""
    rules = part_set.rules
    cutters = []
    for c in part_set.channels:
        plane, curve = c.sensor.plane, c.sensor.curve
        path = curve_to_arcs(curve, occ.PATH_TOLERANCE_MM)
        cutters.append(occ.tube(plane, path, curve.tangents[[0, -1]], *c.runs, rules.channel))
        if rules.pockets and rules.pockets.wires:
            diameter = rules.pockets.wires.diameter
            for lead in c.leads:
                way = lead.way
                cutters.append(occ.tube(plane, way.arcs, way.directions, 0.0, lead.run, diameter))
        cutters += [occ.solid_of(t).wrapped for t in c.tools]
    knives = [occ.Knife(c.plane, c.center, c.taken, c.region) for c in part_set.cuts]
    bare_volumes = [float(p.volume()) for p in part_set.carved]
    pieces = occ.carve_and_split(solid, cutters, knives, len(part_set.parts), sum(bare_volumes))
    unassigned = [(p, occ.volume(p), occ.centroid(p)) for p in pieces]
    out = list(part_set.parts)
    for k in sorted(range(len(out)), key=lambda k: -bare_volumes[k]):
        part = out[k]
        differences = [
            float(np.linalg.norm(c - part.center)) + abs(v - bare_volumes[k]) / part_set.body_volume
            for _, v, c in unassigned
        ]
        piece, volume, _ = unassigned.pop(int(np.argmin(differences)))
        _check_volumes(part.name, volume, bare_volumes[k], part_set.body_volume)
        finished = occ.cut_out(piece, part_set.tools(k))
        check_volumes_agree(part.name, finished, part.volume, part_set.body_volume)
        out[k] = replace(part, solid=finished)
    return out


def check_volumes_agree(name: str, solid: Any, faceted: float, body: float) -> None:
    """Raise FabricationError if a solid does not have the volume of its facets.

    Args:
        name: Name of the part.
        solid: Its TopoDS_Solid.
        faceted: Volume of its facets, mm^3.
        body: Volume of the body, mm^3.
    """
    _check_volumes(name, occ.volume(solid), faceted, body)


def _check_volumes(name: str, exact: float, faceted: float, body: float) -> None:
    if abs(exact - faceted) > PART_TOLERANCE * faceted + BODY_TOLERANCE * body:
        raise FabricationError(
            f"the two geometry kernels disagree on its volume ({exact:.1f} and {faceted:.1f} mm3)",
            code="kernels-disagree",
            where=name,
            action="Move a cord plane slightly",
            part=name,
        )
