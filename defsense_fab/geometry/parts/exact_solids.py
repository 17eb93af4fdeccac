"""The same parts from the exact solid, by OpenCascade: a STEP file each, and a check of both
kernels on each other."""

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
from .division import Division
from .records import PartSet, Part, PartRules

#: Largest difference of a part's volume between the kernels: of the part, and of the body.
PART, BODY = 2e-3, 1e-4


def solid_parts(
    solid: Any, made: PartSet, division: Division, own: Sequence[Sequence[Tool]], rules: PartRules
) -> list[Part]:
    """The parts of `made` with their TopoDS_Solids.

    `solid` is the body's, `own` what is cut out of each part besides the channels. Raises
    FabricationError where OpenCascade fails or its parts differ from the facets'.
    """
    with _errors():
        return _solid_parts(solid, made, division, own, rules)


def carved(solid: Any, tools: Sequence[Tool]) -> Any:
    """A TopoDS_Solid with tools cut out of it. Raises FabricationError where OpenCascade fails."""
    with _errors():
        return occ.without(solid, tools)


@contextmanager
def _errors() -> Iterator[None]:
    try:
        yield
    except FabricationError:
        raise
    except Exception as error:  # OCP's own exceptions carry no common base
        text = " ".join(str(error).split()) or type(error).__name__
        raise FabricationError(f"OpenCascade failed: {text}", code="kernel-failed") from None


def _solid_parts(
    solid: Any, made: PartSet, division: Division, own: Sequence[Sequence[Tool]], rules: PartRules
) -> list[Part]:
    cutters = []
    for c in made.channels:
        plane, curve = c.sensor.plane, c.sensor.curve
        path = curve_to_arcs(curve, occ.PATH_TOLERANCE)
        cutters.append(occ.tube(plane, path, curve.tangents[[0, -1]], *c.runs, rules.channel))
        if rules.pockets and rules.pockets.wires:
            wide = rules.pockets.wires.diameter
            for lead in c.leads:
                way = lead.way
                cutters.append(occ.tube(plane, way.arcs, way.directions, 0.0, lead.run, wide))
        cutters += [occ.solid_of(t).wrapped for t in c.tools]
    knives = [occ.Knife(c.plane, c.center, c.taken, c.region) for c in division.cuts]
    bare = [float(p.volume()) for p in division.parts]
    pieces = occ.carve_and_split(solid, cutters, knives, len(made.parts), sum(bare))
    left = [(p, occ.volume(p), occ.centroid(p)) for p in pieces]
    out = list(made.parts)
    for k in sorted(range(len(out)), key=lambda k: -bare[k]):
        part = out[k]
        near = [
            float(np.linalg.norm(c - part.center)) + abs(v - bare[k]) / made.body_volume
            for _, v, c in left
        ]
        piece, volume, _ = left.pop(int(np.argmin(near)))
        _agree(part.name, volume, bare[k], made.body_volume)
        finished = occ.without(piece, own[k])
        agree(part.name, finished, part.volume, made.body_volume)
        out[k] = replace(part, solid=finished)
    return out


def agree(name: str, solid: Any, faceted: float, body: float) -> None:
    """Raises FabricationError where a TopoDS_Solid does not have the volume of its facets, mm^3, to
    a share of it and of that of the `body`."""
    _agree(name, occ.volume(solid), faceted, body)


def _agree(name: str, exact: float, faceted: float, body: float) -> None:
    if abs(exact - faceted) > PART * faceted + BODY * body:
        raise FabricationError(
            f"the two geometry kernels disagree on {name} ({exact:.1f} and {faceted:.1f} mm^3);"
            " move a cord plane slightly",
            code="kernels-disagree",
            part=name,
        )
