"""Make the moulds in which parts are cast.

Every face in which a part meets others gets a lid that carries the face's grooves, pockets and
sockets as cores and comes off along its normal, as the device itself opens there. The rest of the
mould is its shell, in one or two pieces (`openings`). A part with one face is cast in two pieces: a
cup and its lid.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import manifold3d as m3
import numpy as np
from scipy.spatial import ConvexHull

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from ..parts.records import PartSet
from ..printing.print_bed import find_least_turn
from . import mould_checks
from .cores import (
    bridge_face,
    fill_notches,
    find_core_cover,
    find_faces,
    mouth_directions,
    unite_hollows,
    widen,
)
from .fittings import join_pieces, make_feed
from .openings import Opening, find_shell_opening, sample_part_skin
from .records import Face, Mould, MouldPiece, MouldRules

#: Width around the cavity where pieces meet, and play between pieces.
RIM_MM, PLAY_MM = 9.0, 0.15
SIMPLIFY_MM = 2e-3  # far below what a printer resolves
#: Share of a part's volume that a piece of the shell may pass through: if the part is stretched
#: over an undercut, and in two half shells.
STRETCH_SHARE, FACET_SHARE = 0.05, 2e-4
#: Orders of lids that are compared; each takes seconds.
MAX_ORDERS = 24
PARALLEL_COSINE = 0.9998  # between directions that count as equal


def make_moulds(
    part_set: PartSet, rules: MouldRules, report: Callable[[float, str], None] = lambda *_: None
) -> list[Mould]:
    """Make a mould for every part, in the parts' order.

    Args:
        part_set: The parts.
        rules: Rules of moulds.
        report: Called with the share of the work that is done and its step.

    Raises:
        FabricationError: If no mould of this kind gives a part, with the place.
    """
    out = []
    for i, part in enumerate(part_set.parts):
        report(i / len(part_set.parts), f"mould of {part.name}")
        out.append(_make_mould(part_set, i, rules))
    return out


def check_openings(part_set: PartSet) -> None:
    """Check that every part's mould can come off its skin.

    This takes a tenth of the time of the moulds themselves; their lids may still lock.

    Raises:
        FabricationError: If no mould of this kind gives a part, with the place.
    """
    for i in range(len(part_set.parts)):
        _find_opening(part_set, i)


def _find_opening(part_set: PartSet, index: int) -> tuple[list[Face], Opening]:
    """Return the faces of a part, and how the shell of its mould comes off."""
    sides = find_faces(part_set, index)
    skin = sample_part_skin(
        triangle_kernel.to_surface(fill_notches(part_set.bare[index], sides)), sides
    )
    return sides, find_shell_opening(part_set.parts[index].name, skin, sides)


def _make_mould(part_set: PartSet, index: int, rules: MouldRules) -> Mould:
    """Return the mould of one part, with the first order of lids in which they pass each other."""
    sides, opening = _find_opening(part_set, index)
    problem: FabricationError | None = None
    orders = itertools.permutations(range(len(sides)))
    for order in itertools.islice(orders, MAX_ORDERS):
        try:
            return _make_with_order(part_set, index, [sides[k] for k in order], opening, rules)
        except FabricationError as error:
            problem = problem or error
    assert problem is not None
    raise problem


def _make_with_order(
    part_set: PartSet, index: int, sides: Sequence[Face], opening: Opening, rules: MouldRules
) -> Mould:
    part, bare = part_set.parts[index], part_set.bare[index]
    closed = fill_notches(bare, sides)
    surface = triangle_kernel.to_surface(closed)
    hollows = unite_hollows(part_set, index)
    cast = bare if hollows is None else bare - hollows
    block = _make_block(surface.vertices, sides, rules)
    lids, shell, free = _divide_block(part_set, closed, block, sides, hollows)
    shells = _divide_shell(shell, lids, sides, opening)
    lid_faces = [f for f in sides if not _is_merged(f, opening, sides)]
    lids = [lid for lid in lids if lid is not None]
    total = sum(float(s.volume()) for s in (*lids, *shells, cast))
    checks = [mould_checks.check_block_volume(part.name, total, float(block.volume()), free)]
    feed = make_feed(part.name, lids[0], cast, sides[0].normal, sides[0].origin)
    solids, keys = _add_fittings([feed.lid, *lids[1:], *shells], cast, lid_faces, opening)
    names = _piece_names(part.name, len(lids), len(shells))
    solids = [take_whole_piece(s, n) for s, n in zip(solids, names, strict=True)]
    directions = [*(f.normal for f in lid_faces), *opening.directions]
    # Halves of a round part meet next to its widest line, within a facet's width.
    allowed_overlap = STRETCH_SHARE if opening.strain else FACET_SHARE if opening.plane else 0.0
    allowed_overlap *= float(cast.volume())
    checks += mould_checks.check_opening(
        part.name, solids, directions, cast, [0.0] * len(lids) + [allowed_overlap] * len(shells)
    )
    factor = 1 / (1 - rules.shrinkage)
    pieces = tuple(
        MouldPiece(
            name,
            triangle_kernel.to_printable_surface(
                take_whole_piece(solid.scale([factor] * 3), name), name
            ),
            direction,
            # Cores and cavities point up: a cup stands on its bottom, halves lie on their outsides.
            direction if k < len(lids) or len(shells) > 1 else -directions[0],
        )
        for k, (name, solid, direction) in enumerate(zip(names, solids, directions, strict=True))
    )
    checks += mould_checks.check_thin_cores(pieces, rules)
    checks.append(mould_checks.check_cavity(part.name, float(cast.volume()), part))
    checks.append(mould_checks.check_keys(part.name, keys))
    return Mould(
        part.name,
        pieces,
        sides[0].normal,
        feed.pour * factor,
        feed.vents * factor,
        float(cast.volume()) * factor**3,
        float(block.volume()) * factor**3,
        opening.strain,
        opening.at,
        tuple(checks),
    )


def _make_block(vertices: Float, sides: Sequence[Face], rules: MouldRules) -> Any:
    """Return the block that the mould is cut from: the smallest box around the part that stands on
    the side opposite its largest face, with a lid's thickness beyond each face.
    """
    first = sides[0]
    axes = axes_from_normal(first.normal)
    local = vertices @ axes
    turn = find_least_turn(local[ConvexHull(local[:, :2]).vertices, :2])
    cosine, sine = np.cos(turn), np.sin(turn)
    axes = axes @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    local = vertices @ axes
    low, high = local.min(0), local.max(0)
    bottom = rules.wall if len(sides) == 1 else RIM_MM
    low = low - [RIM_MM, RIM_MM, bottom]
    high = np.array([high[0] + RIM_MM, high[1] + RIM_MM, first.height + rules.wall])
    box = m3.Manifold.cube((high - low).tolist()).translate(low.tolist())
    box = box.transform(np.column_stack([axes, np.zeros(3)]))
    for face in sides[1:]:
        box = box.trim_by_plane((-face.normal).tolist(), -(face.height + rules.wall))
    return box


def _divide_block(
    part_set: PartSet, bare: Any, block: Any, sides: Sequence[Face], hollows: Any
) -> tuple[list[Any], Any, float]:
    """Return a lid for each face, with its cores, the shell around the part, and the volume, mm^3,
    that is left free at the ends of cores so that lids can be closed.
    """
    rest, lids = block, []
    for face in sides:
        above, rest = rest.split_by_plane(face.normal.tolist(), face.height)
        lids.append(above)
    shell = rest - bare
    shell = shell - triangle_kernel.union(
        [bridge_face(bare, f.normal, f.origin, 0.5) for f in sides]
    )
    free = 0.0
    if hollows is not None:
        ends = [bare.translate((PLAY_MM * way).tolist()) for way in mouth_directions(part_set)]
        ends_with_play = (hollows ^ triangle_kernel.union(ends)) - bare
        smaller = shell - ends_with_play
        free += float(shell.volume() - smaller.volume())
        shell = smaller
    pieces = [*lids, shell]
    for k, face in enumerate(sides):
        if face.core is None:
            continue
        lid_parts = [pieces[k], face.core, bridge_face(face.core, face.normal, face.origin, 0.3)]
        # What blocks a core, where the skin leans over it, comes off with the lid.
        for j in range(k + 1, len(pieces)):
            cover = find_core_cover(pieces[j], face)
            if cover is not None:
                lid_parts += [cover, bridge_face(cover, face.normal, face.origin, 0.3)]
                smaller = pieces[j] - widen(cover, face.normal, PLAY_MM)
                free += float(pieces[j].volume() - smaller.volume() - cover.volume())
                pieces[j] = smaller
        pieces[k] = triangle_kernel.union(lid_parts)
        if k:  # the holder of a core may reach beyond its lid, into those over it
            pieces[k] = pieces[k] - triangle_kernel.union(pieces[:k])
    return pieces[:-1], pieces[-1], free


def _is_merged(face: Face, opening: Opening, sides: Sequence[Face]) -> bool:
    """Whether a face's lid comes off as the shell does, and needs no piece of its own."""
    return face is not sides[0] and any(
        float(face.normal @ d) > PARALLEL_COSINE for d in opening.directions
    )


def _divide_shell(
    shell: Any, lids: list[Any], sides: Sequence[Face], opening: Opening
) -> list[Any]:
    """Return the shell's pieces, with the lids that come off with them; those become None in
    `lids`.
    """
    if opening.plane is None:
        pieces = [shell]
    else:
        normal, height = opening.plane
        pieces = list(shell.split_by_plane(normal.tolist(), height))
    for k, face in enumerate(sides):
        if _is_merged(face, opening, sides):
            owner = int(np.argmax([float(face.normal @ d) for d in opening.directions]))
            seam = bridge_face(pieces[owner], face.normal, face.origin, 0.3)
            pieces[owner] = triangle_kernel.union([pieces[owner], lids[k], seam])
            lids[k] = None
    return pieces


def _add_fittings(
    solids: list[Any], cast: Any, lid_faces: Sequence[Face], opening: Opening
) -> tuple[list[Any], int]:
    """Return the pieces with keys and screws, lids first, then the shell's; and the number of keys
    and screws between the two pieces that have the fewest.
    """
    out = list(solids)
    counts = []
    first = len(lid_faces)
    for k, face in enumerate(lid_faces):
        count = 0
        for j in range(k + 1, len(out)):
            joint = join_pieces(
                out[k], out[j], cast, face.normal, face.origin, face.normal, PLAY_MM
            )
            out[k], out[j] = joint.above, joint.below
            count += joint.keys + joint.screws
        counts.append(count)
    if opening.plane is not None:
        normal, height = opening.plane
        joint = join_pieces(
            out[first],
            out[first + 1],
            cast,
            normal,
            height * normal,
            opening.directions[0],
            PLAY_MM,
        )
        out[first], out[first + 1] = joint.above, joint.below
        counts.append(joint.keys + joint.screws)
    return out, min(counts)


def _piece_names(part: str, lids: int, shells: int) -> list[str]:
    def names_of(what: str, count: int) -> list[str]:
        return [f"mould-{part}-{what}" + (f"-{k + 1}" if count > 1 else "") for k in range(count)]

    return [*names_of("lid", lids), *names_of("cup", shells)]


def take_whole_piece(solid: Any, name: str) -> Any:
    """Return a piece as one solid, without slivers that would be separate solids in single
    precision.

    Raises:
        FabricationError: If it falls apart.
    """
    surface = triangle_kernel.to_surface(solid.as_original().simplify(SIMPLIFY_MM))
    rounded = Surface(surface.vertices.astype(np.float32).astype(float), surface.faces)
    pieces = sorted(
        triangle_kernel.to_manifold(rounded, name).decompose(), key=lambda p: -float(p.volume())
    )
    if len(pieces) > 1 and pieces[1].volume() > mould_checks.CRUMB_MM3:
        at = format_point(triangle_kernel.to_surface(pieces[1]).centroid)
        raise FabricationError(
            f"falls apart: {pieces[1].volume():.1f} mm3 come off near {at}",
            code="not-one-piece",
            where=name,
            action="Move a cord's plane there, or choose a process that prints",
            part=name,
        )
    return pieces[0]
