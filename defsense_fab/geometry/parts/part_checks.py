"""All checks of finished parts.

Every check returns its measurement; one that fails raises an error that names the cord or part and
the place (mm). The numbers come from the parts' facets and from samples of the channels, not from
the values that the parts were made with.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import igl
import numpy as np

from ...core.arrays import format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import frame
from ..printing.print_bed import FOOTHOLD, first_layer_area
from .records import Check, PartSet, Part, PartRules
from .wall_checks import sockets

# What a maker should know of parts and joints, by their names.


def of_part(made: PartSet, i: int, piece: bool = False) -> list[str]:
    """Of the part of this index, or the `piece` of one that was cut across: how it stands on the
    bed, and whether it has its number."""
    part, out = made.parts[i], []
    if first_layer_area(triangle_kernel.to_manifold(part.surface, part.name), part.down) < FOOTHOLD:
        out.append(f"{part.name} has no flat face to stand on: print it with a brim and supports")
    if len(made.parts) > 1 and i not in {m.part for m in made.labels}:
        why = "has no number engraved" if piece else "has no face large enough for its number"
        out.append(f"{part.name} {why}: write the number on it")
    return out


def of_joints(made: PartSet) -> list[str]:
    """Of the joints that too few pins align."""
    out = []
    for k, cut in enumerate(made.cuts):
        fitted = [p for p in made.pins if made.contacts[p.contact].cut == k]
        if len(fitted) < 2:
            a, b = (" + ".join(made.parts[i].name for i in side) for side in cut.sides)
            out.append(
                f"{len(fitted)} of 2 pins fit between {a} and {b}: align the outlines by hand while"
                " the glue sets"
            )
    return out


# How much of a part is too thin for the printer.

#: Most of a part that may be thinner than two lines: such places print as gaps. Wedges between
#: planes that cross at small angles are told of long before that.
THIN, TOLD = 0.5, 0.05
_LAYERS = 30


def thin_places(
    made: PartSet, pieces: Sequence[Any], which: Iterable[int], rules: PartRules
) -> list[Check]:
    """How much of each part of `which` (indices) is thinner than two lines of the printer, in the
    layers in which it is printed: what is lost when their outlines are opened by that width. Raises
    FabricationError for a part that is thin in most of it."""
    width, out = rules.inner_wall, []
    for i in which:
        part, piece = made.parts[i], pieces[i]
        axes = frame(-part.down)
        lying = piece.transform(np.column_stack([axes.T, np.zeros(3)]))
        low, high = lying.bounding_box()[2], lying.bounding_box()[5]
        whole, thin, at, most = 0.0, 0.0, part.center, 0.0
        for z in low + (np.arange(_LAYERS) + 0.5) / _LAYERS * (high - low):
            layer = lying.slice(z)
            whole += float(layer.area())
            lost = layer - layer.offset(-width / 2).offset(width / 2 + 0.01)
            for shape in lost.decompose():
                area = float(shape.area())
                if area > width**2:  # not just a corner
                    thin += area
                    if area > most:
                        most = area
                        x = np.asarray(shape.to_polygons()[0]).mean(axis=0)
                        at = axes @ np.array([*x, z])
        share = thin / whole if whole else 1.0
        if share > THIN:
            near = {c for cut in made.cuts for c in cut.cords if any(i in s for s in cut.sides)}
            cords = " and ".join(repr(made.channels[c].name) for c in sorted(near))
            raise FabricationError(
                f"{part.name} is thinner than {width:.1f} mm in {share:.0%} of it, near"
                f" {format_point(at)}, between the planes of {cords}"
                " and the skin: move a plane",
                code="part-too-thin",
                part=part.name,
            )
        name = f"{part.name}: share thinner than {width:.1f} mm"
        told = f"{name}: {share:.0%}, near {format_point(at)}: it may print with gaps"
        out.append(
            Check(name, share, THIN, "", format_point(at) if thin else "", told if share > TOLD else "")
        )
    return out


# Whether cords and wires lie in their grooves, and can be laid in.

#: mm^3 of solid that a cord may touch: rounding of facets.
TOUCH = 0.02
_OPENED = (0.3, 2.0, 10.0)  # mm between two halves


def insertion(made: PartSet, pieces: Sequence[Any], rules: PartRules) -> Check:
    """Whether every cord with its wires lies in its groove and can be laid in: closed it touches no
    part; with the two sides of a cut apart, those of the cut touch neither.
    Raises FabricationError where one does."""
    worst = 0.0
    wire = rules.pockets.wires.wire if rules.pockets and rules.pockets.wires else 0.0
    cords = [triangle_kernel.union([c.cord(rules.cord), *c.wires(wire)]) for c in made.channels]
    for channel, cord in zip(made.channels, cords, strict=True):
        for piece in pieces:
            worst = max(worst, touch(cord, piece, f"cord {channel.name!r} in its closed groove"))
    for cut in made.cuts:
        for c in cut.cords:
            what = f"cord {made.channels[c].name!r} as its groove is closed"
            for side, way in zip(cut.sides, (-cut.plane.normal, cut.plane.normal), strict=True):
                for i, lift in itertools.product(side, _OPENED):
                    worst = max(worst, touch(cords[c], pieces[i].translate(lift * way), what))
    return Check("cord in solid, closed and opened", worst, TOUCH, "mm3", "")


def touch(rod: Any, piece: Any, what: str, remedy: str = "move the cord or its plane") -> float:
    """How much of a piece two solids (manifold3d) share, mm^3; `what` the first is. Raises
    FabricationError, with the `remedy`, where it is more than facets are rounded by."""
    common = rod ^ piece
    volume = float(common.volume())
    if volume > TOUCH:
        at = triangle_kernel.centroid(triangle_kernel.to_surface(common))
        raise FabricationError(
            f"{what} meets {volume:.2f} mm^3 of solid near {format_point(at)}; {remedy}",
            code="overlaps-solid",
            volume=volume,
        )
    return volume


# Parts and what was removed are the body, and no two parts are in one place.

#: Largest relative difference between the body and its parts plus what was removed.
CONSERVATION = 1e-3
#: Of the body's volume, that two parts may overlap: rounding to single precision.
_OVERLAP = 1e-5
_POINTS = 100_000


def volumes(made: PartSet) -> Check:
    """Conservation of volume. Raises FabricationError where it fails."""
    total = sum(p.volume for p in made.parts) + made.cut_out
    error = abs(total / made.body_volume - 1)
    if not error <= CONSERVATION:
        raise FabricationError(
            f"parts and what was cut out add up to {total:.1f} mm^3 but the body has"
            f" {made.body_volume:.1f}; the cut failed: move a cord plane slightly",
            code="volume-not-conserved",
        )
    return Check("volume lost or gained, of the body", error, CONSERVATION, "", "")


def apart(made: PartSet) -> Check:
    """No two exported parts overlap. Raises FabricationError where two do."""
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in made.parts]
    worst, at = 0.0, ""
    for i, a in enumerate(solids):
        for j in range(i):
            common = a ^ solids[j]
            volume = float(common.volume())
            if volume > _OVERLAP * made.body_volume:
                volume = min(volume, _common(common, made.parts[i], made.parts[j]))
            if volume > worst:
                worst, at = (
                    volume,
                    format_point(triangle_kernel.centroid(triangle_kernel.to_surface(common))),
                )
            if volume > _OVERLAP * made.body_volume:
                raise FabricationError(
                    f"{made.parts[j].name} and {made.parts[i].name} overlap by {volume:.1f} mm^3"
                    f" near {at}; the cut failed: move a cord plane slightly",
                    code="parts-overlap",
                    volume=volume,
                )
    return Check("overlap of two parts", worst, _OVERLAP * made.body_volume, "mm3", at)


def _common(claimed: Any, a: Part, b: Part) -> float:
    """The volume (mm^3) that two parts have in common where they are said to: the share of points
    there that lie in both. Faces of one cut are rounded apart by 1e-5 mm, and now and then a
    boolean operation makes much of that."""
    bounds = triangle_kernel.to_surface(claimed).bounds
    points = np.random.default_rng(0).uniform(bounds[0], bounds[1], (_POINTS, 3))
    both = np.ones(len(points), bool)
    for s in (a.surface, b.surface):
        both &= np.asarray(igl.fast_winding_number(s.vertices, s.faces, points)) > 0.5
    return float(both.mean() * np.prod(np.ptp(bounds, axis=0)))


def inspect(made: PartSet, pieces: Sequence[Any], body: Surface, rules: PartRules) -> list[Check]:
    """All checks of the parts, whose manifold3d solids are `pieces`, of a `body`. Raises
    FabricationError for the first that fails."""
    return [
        volumes(made),
        apart(made),
        *sockets(made, body, rules),
        *thin_places(made, pieces, range(len(pieces)), rules),
        insertion(made, pieces, rules),
    ]
