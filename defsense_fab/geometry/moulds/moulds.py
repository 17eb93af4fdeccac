"""From parts to the moulds in which they are cast.

Every face in which a part meets others gets a lid that carries the face's grooves, pockets and
sockets as cores and comes off along its normal, as the device itself opens there. What is left of
the mould is its shell, in one or two pieces (`openings`). A part with one face is cast in two
pieces: a cup and its lid.
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
from ..kernels.cutting_tools import frame
from ..parts.records import PartSet
from ..printing.print_bed import least_turn
from . import mould_checks
from .cores import faces, filled, hollows_of, mouths
from .fittings import fed, joined
from .openings import Opening, shell_opening, skin_of
from .planar import over_core, through, widened
from .records import Face, Mould, MouldPiece, MouldRules

_ROUND = 2e-3  # mm, far below what a printer resolves
#: Of a part's volume, what a piece of the shell may pass through: of a part that is stretched over
#: an undercut, and of one in two half shells.
_EASED, _FACETS = 0.05, 2e-4
#: Orders in which lids are taken off that are tried; each costs seconds.
_MOST_ORDERS = 24
_PARALLEL = 0.9998  # cosine of directions that are taken for one


def make_moulds(
    made: PartSet, rules: MouldRules, report: Callable[[float, str], None] = lambda *_: None
) -> list[Mould]:
    """A mould for every part, in the parts' order.

    Raises FabricationError for a part that no mould of this kind gives, with the place.
    """
    out = []
    for i, part in enumerate(made.parts):
        report(i / len(made.parts), f"mould of {part.name}")
        out.append(_mould(made, i, rules))
    return out


def check_openings(made: PartSet, rules: MouldRules) -> None:
    """Whether every part's mould can come off its skin, which takes a tenth of the time of the
    moulds themselves; their lids may lock all the same.

    Raises FabricationError for a part that no mould of this kind gives, with the place.
    """
    for i in range(len(made.parts)):
        _opening(made, i, rules)


def _opening(made: PartSet, index: int, rules: MouldRules) -> tuple[list[Face], Opening]:
    """The faces of a part, and how the shell of its mould comes off."""
    sides = faces(made, index)
    skin = skin_of(triangle_kernel.to_surface(filled(made.bare[index], sides)), sides)
    return sides, shell_opening(made.parts[index].name, skin, sides, rules)


def _mould(made: PartSet, index: int, rules: MouldRules) -> Mould:
    """The mould of one part: of the orders in which its lids may be taken off the first that lets
    all of them pass each other."""
    sides, opening = _opening(made, index, rules)
    problem: FabricationError | None = None
    orders = itertools.permutations(range(len(sides)))
    for order in itertools.islice(orders, _MOST_ORDERS):
        try:
            return _made(made, index, [sides[k] for k in order], opening, rules)
        except FabricationError as error:
            problem = problem or error
    assert problem is not None
    raise problem


def _made(
    made: PartSet, index: int, sides: Sequence[Face], opening: Opening, rules: MouldRules
) -> Mould:
    part, bare = made.parts[index], made.bare[index]
    closed = filled(bare, sides)
    surface = triangle_kernel.to_surface(closed)
    hollows = hollows_of(made, index)
    cast = bare if hollows is None else bare - hollows
    block = _block(surface.vertices, sides, rules)
    lids, shell, free = _divided(made, closed, block, sides, hollows, rules)
    shells = _shells(shell, lids, sides, opening)
    own = [f for f in sides if not _merged(f, opening, sides)]
    lids = [lid for lid in lids if lid is not None]
    total = sum(float(s.volume()) for s in (*lids, *shells, cast))
    checks = [mould_checks.adds_up(part.name, total, float(block.volume()), free)]
    feed = fed(part.name, lids[0], cast, sides[0].normal, sides[0].origin)
    solids, keys = _fitted([feed.lid, *lids[1:], *shells], cast, own, opening, rules)
    names = _names(part.name, len(lids), len(shells))
    solids = [whole(s, n) for s, n in zip(solids, names, strict=True)]
    ways = [*(f.normal for f in own), *opening.directions]
    # Halves of a round part meet beside its widest line by what facets are wide.
    eased = _EASED if opening.strain else _FACETS if opening.plane else 0.0
    eased *= float(cast.volume())
    checks += mould_checks.opens(
        part.name, solids, ways, cast, [0.0] * len(lids) + [eased] * len(shells)
    )
    factor = 1 / (1 - rules.shrinkage)
    pieces = tuple(
        MouldPiece(
            name,
            triangle_kernel.printable(whole(solid.scale([factor] * 3), name), name),
            way,
            # Cores and cavities up: a cup stands on its bottom, halves lie on their outsides.
            way if k < len(lids) or len(shells) > 1 else -ways[0],
        )
        for k, (name, solid, way) in enumerate(zip(names, solids, ways, strict=True))
    )
    checks += mould_checks.thin(pieces, rules)
    checks.append(mould_checks.cavity(part.name, float(cast.volume()), part))
    checks.append(mould_checks.keyed(part.name, keys))
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


def _block(vertices: Float, sides: Sequence[Face], rules: MouldRules) -> Any:
    """What the mould is cut from: the least box around the part that stands on the side opposite
    its largest face, with a lid's thickness beyond each face."""
    first = sides[0]
    axes = frame(first.normal)
    local = vertices @ axes
    turn = least_turn(local[ConvexHull(local[:, :2]).vertices, :2])
    c, s = np.cos(turn), np.sin(turn)
    axes = axes @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    local = vertices @ axes
    low, high = local.min(0), local.max(0)
    bottom = rules.wall if len(sides) == 1 else rules.rim
    low = low - [rules.rim, rules.rim, bottom]
    high = np.array([high[0] + rules.rim, high[1] + rules.rim, first.height + rules.wall])
    box = m3.Manifold.cube((high - low).tolist()).translate(low.tolist())
    box = box.transform(np.column_stack([axes, np.zeros(3)]))
    for face in sides[1:]:
        box = box.trim_by_plane((-face.normal).tolist(), -(face.height + rules.wall))
    return box


def _divided(
    made: PartSet, bare: Any, block: Any, sides: Sequence[Face], hollows: Any, rules: MouldRules
) -> tuple[list[Any], Any, float]:
    """A lid for each face, with its cores, and the shell around the part; the volume, mm^3, that is
    left free at the ends of cores so that lids can be closed."""
    rest, lids = block, []
    for face in sides:
        above, rest = rest.split_by_plane(face.normal.tolist(), face.height)
        lids.append(above)
    shell = rest - bare
    shell = shell - triangle_kernel.union([through(bare, f.normal, f.origin, 0.5) for f in sides])
    free = 0.0
    if hollows is not None:
        ends = [bare.translate((rules.play * way).tolist()) for way in mouths(made)]
        wider = (hollows ^ triangle_kernel.union(ends)) - bare
        smaller = shell - wider
        free += float(shell.volume() - smaller.volume())
        shell = smaller
    later = [*lids, shell]
    for k, face in enumerate(sides):
        if face.core is None:
            continue
        own = [later[k], face.core, through(face.core, face.normal, face.origin, 0.3)]
        # What lies in the way of a core, where the skin leans over it, comes off with the lid.
        for j in range(k + 1, len(later)):
            over = over_core(later[j], face)
            if over is not None:
                own += [over, through(over, face.normal, face.origin, 0.3)]
                smaller = later[j] - widened(over, face.normal, rules.play)
                free += float(later[j].volume() - smaller.volume() - over.volume())
                later[j] = smaller
        later[k] = triangle_kernel.union(own)
        if k:  # what holds the core may reach beyond its own lid, into those over it
            later[k] = later[k] - triangle_kernel.union(later[:k])
    return later[:-1], later[-1], free


def _merged(face: Face, opening: Opening, sides: Sequence[Face]) -> bool:
    """Whether a face's lid comes off as the shell does, and needs no piece of its own."""
    return face is not sides[0] and any(
        float(face.normal @ d) > _PARALLEL for d in opening.directions
    )


def _shells(shell: Any, lids: list[Any], sides: Sequence[Face], opening: Opening) -> list[Any]:
    """The shell's pieces, with the lids that come off as they do: those are None afterwards."""
    if opening.plane is None:
        pieces = [shell]
    else:
        normal, height = opening.plane
        pieces = list(shell.split_by_plane(normal.tolist(), height))
    for k, face in enumerate(sides):
        if _merged(face, opening, sides):
            own = int(np.argmax([float(face.normal @ d) for d in opening.directions]))
            seam = through(pieces[own], face.normal, face.origin, 0.3)
            pieces[own] = triangle_kernel.union([pieces[own], lids[k], seam])
            lids[k] = None
    return pieces


def _fitted(
    solids: list[Any], cast: Any, own: Sequence[Face], opening: Opening, rules: MouldRules
) -> tuple[list[Any], int]:
    """Pieces around what is `cast` with keys and screws: lids first, then the shell's. And how many
    of them there are between those two that have the fewest."""
    out = list(solids)
    least = []
    first = len(own)
    for k, face in enumerate(own):
        found = 0
        for j in range(k + 1, len(out)):
            joint = joined(out[k], out[j], cast, face.normal, face.origin, face.normal, rules.play)
            out[k], out[j] = joint.above, joint.below
            found += joint.keys + joint.screws
        least.append(found)
    if opening.plane is not None:
        normal, height = opening.plane
        joint = joined(
            out[first],
            out[first + 1],
            cast,
            normal,
            height * normal,
            opening.directions[0],
            rules.play,
        )
        out[first], out[first + 1] = joint.above, joint.below
        least.append(joint.keys + joint.screws)
    return out, min(least)


def _names(part: str, lids: int, shells: int) -> list[str]:
    def several(what: str, count: int) -> list[str]:
        return [f"mould-{part}-{what}" + (f"-{k + 1}" if count > 1 else "") for k in range(count)]

    return [*several("lid", lids), *several("cup", shells)]


def whole(solid: Any, name: str) -> Any:
    """The piece as one solid, without the slivers that would be solids of their own in single
    precision. Raises FabricationError where it falls apart."""
    surface = triangle_kernel.to_surface(solid.as_original().simplify(_ROUND))
    rounded = Surface(surface.vertices.astype(np.float32).astype(float), surface.faces)
    found = sorted(
        triangle_kernel.to_manifold(rounded, name).decompose(), key=lambda p: -float(p.volume())
    )
    if len(found) > 1 and found[1].volume() > mould_checks.CRUMB:
        at = format_point(triangle_kernel.centroid(triangle_kernel.to_surface(found[1])))
        raise FabricationError(
            f"{name} falls apart: {found[1].volume():.1f} mm^3 come off near {at}; move a cord's"
            " plane there, or choose a process that prints",
            code="not-one-piece",
            part=name,
        )
    return found[0]
