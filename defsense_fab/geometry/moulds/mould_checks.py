"""Check finished moulds before anything is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..parts.records import Check, Part
from .records import MouldPiece, MouldRules

#: Volumes of rounding: of a piece, and of two that pass each other.
CRUMB_MM3, MAX_OVERLAP_MM3 = 1.0, 0.6
CAVITY_TOLERANCE, BLOCK_TOLERANCE = 1e-3, 1e-4
OPEN_DISTANCES_MM = (0.3, 1.0, 3.0, 10.0, 30.0)  # of a piece that comes off
LAYERS, CORNER_TOLERANCE_MM = 24, 0.02
MAX_THIN_SHARE, NOTED_THIN_SHARE = 0.3, 0.02


def check_block_volume(name: str, pieces: float, block: float, fed: float) -> Check:
    """Check that pieces, cavity, play and drilled holes make up the block."""
    error = abs((pieces + fed) / block - 1)
    if not error <= BLOCK_TOLERANCE:
        raise FabricationError(
            f"the mould of {name} and its cavity add up to {pieces + fed:.1f} mm3, but its"
            f" block has {block:.1f}",
            code="volume-not-conserved",
            action="Move a cord's plane slightly",
            part=name,
        )
    return Check(f"mould of {name}: volume lost or gained", error, BLOCK_TOLERANCE, "", "")


def check_cavity(name: str, volume: float, part: Part) -> Check:
    """Check that the cavity, before enlargement by the shrinkage, is the part."""
    error = abs(volume / part.volume - 1)
    if not error <= CAVITY_TOLERANCE:
        raise FabricationError(
            f"the mould of {name} holds {volume:.1f} mm3, but the part has {part.volume:.1f}",
            code="cavity-differs-from-part",
            action="Move a cord's plane slightly",
            part=name,
        )
    return Check(f"mould of {name}: cavity against the part", error, CAVITY_TOLERANCE, "", "")


def check_opening(
    name: str,
    solids: Sequence[Any],
    directions: Sequence[Float],
    cast: Any,
    allowed_overlaps: Sequence[float],
) -> list[Check]:
    """Check that every piece in its turn comes off without passing through the others or the part.

    Args:
        name: Name of the part.
        solids: Pieces in the order in which they come off.
        directions: Direction (3,) of each.
        cast: The cast part.
        allowed_overlaps: Volume of the part, mm^3, that each piece may pass through, where the part
            stretches over an undercut.

    Raises:
        FabricationError: If a piece locks.
    """
    worst, worst_in_part, where = 0.0, 0.0, ""
    for k, (solid, direction, allowed) in enumerate(
        zip(solids, directions, allowed_overlaps, strict=True)
    ):
        for distance in OPEN_DISTANCES_MM:
            moved = solid.translate((distance * direction).tolist())
            for j in range(k + 1, len(solids)):
                common = moved ^ solids[j]
                worst = max(worst, float(common.volume()))
                if common.volume() > MAX_OVERLAP_MM3:
                    at = triangle_kernel.to_surface(common).centroid
                    raise FabricationError(
                        f"the pieces {k + 1} and {j + 1} of the mould of {name} lock near"
                        f" {format_point(at)}, by {common.volume():.1f} mm3",
                        code="mould-pieces-lock",
                        action="Move a cord's plane there",
                        part=name,
                    )
            common = moved ^ cast
            volume = float(common.volume())
            if volume > worst_in_part:
                worst_in_part = volume
                where = format_point(triangle_kernel.to_surface(common).centroid)
            if volume > max(MAX_OVERLAP_MM3, allowed):
                raise FabricationError(
                    f"the mould of {name} does not open: its piece {k + 1} passes through"
                    f" {volume:.1f} mm3 of the part near {where}",
                    code="mould-does-not-open",
                    action="Move a cord's plane there, or choose a process that prints",
                    part=name,
                )
    limit = max(MAX_OVERLAP_MM3, *allowed_overlaps)
    return [
        Check(f"mould of {name}: pieces that lock", worst, MAX_OVERLAP_MM3, "mm3", ""),
        Check(
            f"mould of {name}: part in the way of a piece",
            worst_in_part,
            limit,
            "mm3",
            where if worst_in_part > MAX_OVERLAP_MM3 else "",
        ),
    ]


def check_keys(name: str, count: int) -> Check:
    """Return the number of keys and screws between the two pieces that have the fewest."""
    note = (
        f"the mould of {name} has no room for keys between two of its pieces: align their outsides"
        " and hold them with tape"
    )
    name_of_check = f"mould of {name}: keys and screws"
    return Check(name_of_check, count, 1, "in all", "", "" if count else note, at_least=True)


def check_thin_cores(pieces: Sequence[MouldPiece], rules: MouldRules) -> list[Check]:
    """Measure how much of each piece's cores is thinner than two lines of the printer."""
    out, width = [], 2 * rules.line
    for piece in pieces:
        solid = triangle_kernel.to_manifold(piece.surface, piece.name)
        thin = triangle_kernel.find_thin_places(
            solid, piece.down, width, LAYERS, CORNER_TOLERANCE_MM
        )
        at = "" if thin.point is None else format_point(thin.point)
        name = f"{piece.name}: share thinner than {width:.1f} mm"
        note = f"{name}: {thin.share:.0%}, near {at}: a core may break there as it is printed"
        note = note if thin.share > NOTED_THIN_SHARE else ""
        out.append(Check(name, thin.share, MAX_THIN_SHARE, "", at, note, point=thin.point))
    return out
