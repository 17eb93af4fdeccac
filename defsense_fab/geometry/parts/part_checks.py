"""Check finished parts before anything is written.

Every check returns its measurement; one that fails raises an error that names the cord or part and
the place (mm). The numbers come from the parts' facets and from samples of the channels, not from
the values that the parts were made with.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.surface_queries import signed_distance_of
from ..printing.print_bed import MIN_FIRST_LAYER_MM2, first_layer_area
from .records import Check, Part, PartRules, PartSet
from .wall_checks import check_sockets


def part_notes(part_set: PartSet, i: int, piece: bool = False) -> dict[str, Float]:
    """Return notes on one part: how it stands on the bed, and whether it has its number.

    Args:
        part_set: The parts.
        i: Index of the part.
        piece: Whether it is a piece of a part that was cut across.

    Returns:
        The point (3,) mm that each note is about, by its text.
    """
    part, out = part_set.parts[i], dict[str, Float]()
    if (
        first_layer_area(triangle_kernel.to_manifold(part.surface, part.name), part.down)
        < MIN_FIRST_LAYER_MM2
    ):
        text = f"{part.name} has no flat face to stand on: print it with a brim and supports"
        out[text] = part.center
    if len(part_set.parts) > 1 and i not in {m.part for m in part_set.labels}:
        why = "has no number engraved" if piece else "has no face large enough for its number"
        out[f"{part.name} {why}: write the number on it"] = part.center
    return out


def joint_notes(part_set: PartSet) -> dict[str, Float]:
    """Return notes on the joints that too few pins align, each with a point (3,) mm."""
    out: dict[str, Float] = {}
    for k, cut in enumerate(part_set.cuts):
        fitted = [p for p in part_set.pins if part_set.contacts[p.contact].cut == k]
        if len(fitted) < 2:
            a, b = (" + ".join(part_set.parts[i].name for i in side) for side in cut.sides)
            centers = [part_set.parts[i].center for side in cut.sides for i in side]
            text = (
                f"{len(fitted)} of 2 pins fit between {a} and {b}: align the outlines by hand while"
                " the glue sets"
            )
            out[text] = np.mean(centers, axis=0)
    return out


#: Largest share of a part that may be thinner than two lines: such places print as gaps. Wedges
#: between planes that cross at small angles are noted far below that.
MAX_THIN_SHARE, NOTED_THIN_SHARE = 0.5, 0.05
#: Length of all walls without thickness in a layer; rounding leaves short ones at the tips of
#: wedges.
MAX_FILM_MM = 5.0
LAYERS, CORNER_TOLERANCE_MM = 30, 0.01


def check_thin_places(
    part_set: PartSet, pieces: Sequence[Any], which: Iterable[int], rules: PartRules
) -> list[Check]:
    """Measure how much of each part is thinner than two lines of the printer.

    Args:
        part_set: The parts.
        pieces: Their manifold3d solids.
        which: Indices of the parts to measure.
        rules: Rules of the parts.

    Raises:
        FabricationError: If a part is thin in most of it, or has films without thickness.
    """
    width, checks = rules.inner_wall, []
    for i in which:
        part = part_set.parts[i]
        thin = triangle_kernel.find_thin_places(
            pieces[i], part.down, width, LAYERS, CORNER_TOLERANCE_MM
        )
        film = triangle_kernel.find_film(pieces[i], part.down, LAYERS, MAX_FILM_MM)
        share, at = thin.share, part.center if thin.point is None else thin.point
        if film is not None or share > MAX_THIN_SHARE:
            near = {c for cut in part_set.cuts for c in cut.cords if any(i in s for s in cut.sides)}
            cords = [part_set.channels[c].name for c in sorted(near)]
            planes = f"the planes of {' and '.join(map(repr, cords))}" if cords else "the cuts"
            if film is not None:
                at = film
                fault = f"has walls without thickness near {format_point(at)}, between {planes}"
            else:
                fault = (
                    f"is thinner than {width:.1f} mm in {share:.0%} of it, near"
                    f" {format_point(at)}, between {planes} and the skin"
                )
            raise FabricationError(
                fault,
                code="part-too-thin",
                where=part.name,
                action="Move a plane",
                part=part.name,
                cords=cords,
                at=at.tolist(),
            )
        name = f"{part.name}: share thinner than {width:.1f} mm"
        note = f"{name}: {share:.0%}, near {format_point(at)}: it may print with gaps"
        checks.append(
            Check(
                name,
                share,
                MAX_THIN_SHARE,
                "",
                "" if thin.point is None else format_point(at),
                note if share > NOTED_THIN_SHARE else "",
                point=at,
            )
        )
    return checks


#: Volume of solid that a cord may touch: rounding of facets.
MAX_OVERLAP_MM3 = 0.02
OPEN_DISTANCES_MM = (0.3, 2.0, 10.0)  # between two halves


def check_insertion(part_set: PartSet, pieces: Sequence[Any], rules: PartRules) -> Check:
    """Check that every cord with its wires lies in its groove and can be inserted.

    When closed it touches no part; while the two sides of a cut are apart, the cords of the cut
    touch neither.

    Args:
        part_set: The parts.
        pieces: Their manifold3d solids.
        rules: Rules of the parts.

    Raises:
        FabricationError: If a cord touches a part.
    """
    worst = 0.0
    wire = rules.pockets.wires.wire if rules.pockets and rules.pockets.wires else 0.0
    cords = [triangle_kernel.union([c.cord(rules.cord), *c.wires(wire)]) for c in part_set.channels]
    for channel, cord in zip(part_set.channels, cords, strict=True):
        what = f"cord {channel.name!r} in its closed groove"
        for piece in pieces:
            worst = max(worst, check_overlap(cord, piece, what, cord=channel.name))
    for cut in part_set.cuts:
        for c in cut.cords:
            name = part_set.channels[c].name
            what = f"cord {name!r} as its groove is closed"
            for side, direction in zip(
                cut.sides, (-cut.plane.normal, cut.plane.normal), strict=True
            ):
                for i, lift in itertools.product(side, OPEN_DISTANCES_MM):
                    piece = pieces[i].translate(lift * direction)
                    worst = max(worst, check_overlap(cords[c], piece, what, cord=name))
    return Check("cord in solid, closed and opened", worst, MAX_OVERLAP_MM3, "mm3", "")


def check_overlap(
    rod: Any,
    piece: Any,
    what: str,
    remedy: str = "Move the cord or its plane",
    cord: str = "",
) -> float:
    """Return the volume that two manifold3d solids share, mm^3.

    Args:
        rod: A solid that should lie in air.
        piece: The other solid.
        what: Noun phrase for the first one.
        remedy: Action for the error.
        cord: Name of the cord that the first one is; empty for anything else.

    Raises:
        FabricationError: If it is more than facets are rounded by.
    """
    common = rod ^ piece
    volume = float(common.volume())
    if volume > MAX_OVERLAP_MM3:
        at = triangle_kernel.to_surface(common).centroid
        data = {"cord": cord} if cord else {}
        raise FabricationError(
            f"{what} meets {volume:.2f} mm3 of solid near {format_point(at)}",
            code="overlaps-solid",
            action=remedy,
            volume=volume,
            at=at.tolist(),
            **data,
        )
    return volume


#: Largest relative difference between the body and its parts plus what was removed.
VOLUME_TOLERANCE = 1e-3
#: Share of the body's volume by which two parts may overlap: rounding to single precision.
MAX_OVERLAP_SHARE = 1e-5
OVERLAP_SAMPLES = 100_000


def check_volumes(part_set: PartSet) -> Check:
    """Check that the parts and what was removed add up to the body.

    Raises:
        FabricationError: If they do not.
    """
    total = sum(p.volume for p in part_set.parts) + part_set.cut_out
    error = abs(total / part_set.body_volume - 1)
    if not error <= VOLUME_TOLERANCE:
        raise FabricationError(
            f"parts and what was cut out add up to {total:.1f} mm3, but the body has"
            f" {part_set.body_volume:.1f}",
            code="volume-not-conserved",
            where="the cut failed",
            action="Move a cord plane slightly",
        )
    return Check("volume lost or gained, of the body", error, VOLUME_TOLERANCE, "", "")


def check_overlaps(part_set: PartSet) -> Check:
    """Check that no two exported parts overlap.

    Raises:
        FabricationError: If two do.
    """
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in part_set.parts]
    worst, at = 0.0, ""
    for i, a in enumerate(solids):
        for j in range(i):
            common = a ^ solids[j]
            volume = float(common.volume())
            if volume > MAX_OVERLAP_SHARE * part_set.body_volume:
                volume = min(volume, _common_volume(common, part_set.parts[i], part_set.parts[j]))
            if volume > worst:
                worst, at = (
                    volume,
                    format_point(triangle_kernel.to_surface(common).centroid),
                )
            if volume > MAX_OVERLAP_SHARE * part_set.body_volume:
                raise FabricationError(
                    f"{part_set.parts[j].name} and {part_set.parts[i].name} overlap by"
                    f" {volume:.1f} mm3 near {at}",
                    code="parts-overlap",
                    where="the cut failed",
                    action="Move a cord plane slightly",
                    volume=volume,
                )
    return Check("overlap of two parts", worst, MAX_OVERLAP_SHARE * part_set.body_volume, "mm3", at)


def _common_volume(claimed: Any, a: Part, b: Part) -> float:
    """Return the volume that two parts really share in a claimed overlap, mm^3, by random points.

    Faces of one cut are rounded apart by 1e-5 mm, and a boolean operation sometimes overestimates
    that.
    """
    bounds = triangle_kernel.to_surface(claimed).bounds
    points = np.random.default_rng(0).uniform(bounds[0], bounds[1], (OVERLAP_SAMPLES, 3))
    both = np.ones(len(points), bool)
    for s in (a.surface, b.surface):
        both &= signed_distance_of(s).inside(points)
    return float(both.mean() * np.prod(np.ptp(bounds, axis=0)))


def check_parts(
    part_set: PartSet, pieces: Sequence[Any], body: Surface, rules: PartRules
) -> list[Check]:
    """Make all checks of the parts.

    Args:
        part_set: The parts.
        pieces: Their manifold3d solids.
        body: Surface of the body.
        rules: Rules of the parts.

    Raises:
        FabricationError: For the first check that fails.
    """
    return [
        check_volumes(part_set),
        check_overlaps(part_set),
        *check_sockets(part_set, body, rules),
        *check_thin_places(part_set, pieces, range(len(pieces)), rules),
        check_insertion(part_set, pieces, rules),
    ]
