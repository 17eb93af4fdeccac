"""Make the solids of a body that is printed in one piece with conductive traces in it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, format_point
from ...core.device.pads import PadSpec
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..bodies.regions import KEPT_SPACING_MM, fill_region
from ..channels.cord_channels import Channel
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from . import engraving
from .printed_pads import OUTSIDE_MM, PlacedPad, note_bends, place_pads
from .records import Check, Part, PartRules, PartSet
from .wall_checks import check_cord_walls

_SIDES = 16  # of a trace's upright section
_SAG_MM = 0.02  # between the trace and its path
_MAX_SLIVER_MM3 = 5.0  # of the body, left out as a void next to a trace
_MAX_OVERLAP_MM3 = 1e-6  # of two traces


@dataclass(frozen=True)
class TraceShape:
    """Section of the traces as they are printed, and the pads in which they end.

    Attributes:
        width: Width across the path, mm.
        height: Height along `up`, mm.
        up: Unit direction (3,) that points up as the body is printed.
        pad: The pads.
    """

    width: float
    height: float
    up: Float
    pad: PadSpec


def sweep_trace(line: Float, shape: TraceShape) -> Any:
    """Return the solid (manifold3d) that an upright cylinder sweeps along a line.

    Layers are horizontal, so the section keeps its height along `up` whatever the path's direction,
    and its width across the path. Where a path rises steeply, the section across it is a disc.

    Args:
        line: Points (p, 3), mm.
        shape: Section of the trace.
    """
    axes = axes_from_normal(shape.up)
    radius = shape.width / 2
    upright = m3.Manifold.cylinder(shape.height, radius, radius, _SIDES, True)
    local = line[_keep_corners(line)] @ axes
    stations = [upright.translate(point.tolist()) for point in local]
    hulls = [m3.Manifold.batch_hull([a, b]) for a, b in itertools.pairwise(stations)]
    return triangle_kernel.from_plane_frame(triangle_kernel.union(hulls), axes, np.zeros(3))


def _keep_corners(line: Float) -> list[int]:
    """Return the numbers of points between which chords stay near the line."""
    kept = [0]
    for k in range(2, len(line)):
        start, chord = line[kept[-1]], line[k] - line[kept[-1]]
        across = np.cross(line[kept[-1] + 1 : k] - start, chord)
        far = np.linalg.norm(across, axis=1).max() / max(float(np.linalg.norm(chord)), 1e-12)
        if far > _SAG_MM:
            kept.append(k - 1)
    return [*kept, len(line) - 1]


def make_printed(
    surface: Surface,
    channels: Sequence[Channel],
    rules: PartRules,
    shape: TraceShape,
    report: Callable[[float, str], None] = lambda *_: None,
) -> PartSet:
    """Make the body in one piece, with its traces and their pads as solids that fill its voids.

    Args:
        surface: Surface of the body.
        channels: Lines of the traces.
        rules: Rules of the parts.
        shape: Section of the traces.
        report: Called with the share of the work that is done and its step.

    Returns:
        One part, with the traces in `PartSet.traces`.

    Raises:
        FabricationError: A wall is too thin, traces touch, a pad is across an edge, or a trace is
            not in one piece.
    """
    report(0.1, "sweeping traces")
    body = triangle_kernel.to_manifold(surface, "the body")
    checks = check_cord_walls(channels, surface, rules)
    pads = place_pads(channels, surface, shape.pad)
    hollows = [(c.inside, rules.channel / 2) for c in channels]
    hollows += [(pad.axis, shape.pad.room / 2) for pair in pads for pad in pair]
    hollows += [(fill_region(region, KEPT_SPACING_MM), KEPT_SPACING_MM) for region in rules.kept]
    seats = engraving.place_seats(surface, rules.seats, rules.tag, hollows, rules.wall, [])
    flat = triangle_kernel.cut_out(body, [t for s in seats for t in s.tools])
    for pad in itertools.chain(*pads):
        pad.check(flat)
    flat -= triangle_kernel.union([pad.holes for pair in pads for pad in pair])
    report(0.3, "cutting traces out of the body")
    swept = {c.name: make_trace(c.inside, shape, p) for c, p in zip(channels, pads, strict=True)}
    whole, solids, left_out = cut_traces_out(flat, swept)
    traces = tuple(_make_part(name, solid, shape.up) for name, solid in solids.items())
    part = _make_part("1-whole", whole, shape.up)
    bodies = (whole,)
    part_set = PartSet(
        parts=(part,),
        cuts=(),
        contacts=(),
        pins=(),
        labels=(),
        seats=tuple(seats),
        channels=tuple(channels),
        checks=(*checks, *_check_volumes(float(flat.volume()) - left_out, part, traces)),
        warnings=note_bends(pads, surface),
        cut_out=float(body.volume()) - float(whole.volume()),
        body_volume=float(body.volume()),
        rules=rules,
        bare=bodies,
        carved=bodies,
    )
    return replace(part_set, traces=traces)


def cut_traces_out(body: Any, traces: Mapping[str, Any]) -> tuple[Any, dict[str, Any], float]:
    """Divide a body into its traces and the rest.

    Args:
        body: Solid (manifold3d) of the body.
        traces: Solids that reach out of the body, by name.

    Returns:
        The body without traces, the traces cut flush with its skin, and the volume (mm^3) of
        slivers that are left out as voids.

    Raises:
        FabricationError: Traces touch, or cut the body in pieces.
    """
    solids = {name: trace ^ body for name, trace in traces.items()}
    for (a, one), (b, other) in itertools.combinations(solids.items(), 2):
        if float((one ^ other).volume()) > _MAX_OVERLAP_MM3:
            raise FabricationError(
                f"touches trace {b!r}, pads included",
                code="traces-touch",
                where=f"trace {a!r}",
                action="Move their ends apart",
                traces=(a, b),
            )
    whole, left_out = _drop_slivers(body - triangle_kernel.union(list(solids.values())))
    return whole, solids, left_out


def make_trace(line: Float, shape: TraceShape, pads: tuple[PlacedPad, PlacedPad]) -> Any:
    """Return a trace that reaches out of the body, with a pad at each end.

    Args:
        line: Center line (p, 3) from skin to skin, mm.
        shape: Section of the trace.
        pads: The pads at both ends.
    """
    first, last = (
        end + OUTSIDE_MM * (end - before) / np.linalg.norm(end - before)
        for end, before in ((line[0], line[1]), (line[-1], line[-2]))
    )
    reaching = np.concatenate([first[None], line, last[None]])
    return triangle_kernel.union([sweep_trace(reaching, shape), *(pad.solid for pad in pads)])


def _drop_slivers(whole: Any) -> tuple[Any, float]:
    """Drop the slivers of a body that a trace cuts off where it reaches the skin.

    Returns:
        The body, and the volume of the slivers, mm^3.

    Raises:
        FabricationError: A piece is too large to be left out.
    """
    pieces = sorted(whole.decompose(), key=lambda piece: float(piece.volume()))
    for piece in pieces[:-1]:
        if float(piece.volume()) > _MAX_SLIVER_MM3:
            at = triangle_kernel.to_surface(piece).centroid
            raise FabricationError(
                f"traces cut a piece of {piece.volume():.0f} mm3 off near {format_point(at)}",
                code="body-divided",
                where="the body",
                action="Move the trace there away from the skin",
                at=at.tolist(),
            )
    return pieces[-1], sum(float(piece.volume()) for piece in pieces[:-1])


def _make_part(name: str, solid: Any, up: Float) -> Part:
    surface = triangle_kernel.to_printable_surface(solid, name)
    return Part(name, surface, surface.volume, surface.centroid, -up)


def _check_volumes(volume: float, part: Part, traces: Sequence[Part]) -> tuple[Check, ...]:
    """Return the check that body and traces fill the body's volume (mm^3)."""
    filled = part.volume + sum(t.volume for t in traces)
    gap = abs(filled / volume - 1)
    return (
        Check("body and traces fill the volume", gap, 1e-3, "", "the whole body").require(
            0.0, "volume-differs"
        ),
    )
