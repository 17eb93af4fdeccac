"""What finished moulds are measured for before anything is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import frame
from ..parts.records import Check, Part
from .records import MouldPiece, MouldRules

#: mm^3 of rounding: of a piece, and of two that pass each other.
CRUMB, _TOUCH = 1.0, 0.6
CAVITY, _SUM = 1e-3, 1e-4
_MOVED = (0.3, 1.0, 3.0, 10.0, 30.0)  # mm, of a piece that is taken off
_LAYERS, THIN, TOLD = 24, 0.3, 0.02


def adds_up(name: str, pieces: float, block: float, fed: float) -> Check:
    """Pieces, cavity, play and what was drilled make up the block."""
    error = abs((pieces + fed) / block - 1)
    if not error <= _SUM:
        raise FabricationError(
            f"the mould of {name} and its cavity add up to {pieces + fed:.1f} mm^3, but its block"
            f" has {block:.1f}; move a cord's plane slightly",
            code="volume-not-conserved",
            part=name,
        )
    return Check(f"mould of {name}: volume lost or gained", error, _SUM, "", "")


def cavity(name: str, volume: float, part: Part) -> Check:
    """The cavity, less the shrinkage, is the part."""
    error = abs(volume / part.volume - 1)
    if not error <= CAVITY:
        raise FabricationError(
            f"the mould of {name} holds {volume:.1f} mm^3 but the part has {part.volume:.1f}; move"
            " a cord's plane slightly",
            code="cavity-differs-from-part",
            part=name,
        )
    return Check(f"mould of {name}: cavity against the part", error, CAVITY, "", "")


def opens(
    name: str,
    solids: Sequence[Any],
    ways: Sequence[Float],
    cast: Any,
    eased: Sequence[float],
) -> list[Check]:
    """Every piece in its turn comes off without passing through the ones that are still there,
    and not through the part either, or through no more of it than `eased`, mm^3, where the part is
    known to be stretched over an undercut."""
    worst, rubbed, where = 0.0, 0.0, ""
    for k, (solid, way, most) in enumerate(zip(solids, ways, eased, strict=True)):
        for far in _MOVED:
            moved = solid.translate((far * way).tolist())
            for j in range(k + 1, len(solids)):
                common = moved ^ solids[j]
                worst = max(worst, float(common.volume()))
                if common.volume() > _TOUCH:
                    at = triangle_kernel.centroid(triangle_kernel.to_surface(common))
                    raise FabricationError(
                        f"the pieces {k + 1} and {j + 1} of the mould of {name} lock near"
                        f" {format_point(at)}, by {common.volume():.1f} mm^3; move a cord's plane there",
                        code="mould-pieces-lock",
                        part=name,
                    )
            common = moved ^ cast
            volume = float(common.volume())
            if volume > rubbed:
                rubbed = volume
                where = format_point(triangle_kernel.centroid(triangle_kernel.to_surface(common)))
            if volume > max(_TOUCH, most):
                raise FabricationError(
                    f"the mould of {name} does not open: its piece {k + 1} passes through"
                    f" {volume:.1f} mm^3 of the part near {where}; move a cord's plane there, or"
                    " choose a process that prints",
                    code="mould-does-not-open",
                    part=name,
                )
    limit = max(_TOUCH, *eased)
    return [
        Check(f"mould of {name}: pieces that lock", worst, _TOUCH, "mm3", ""),
        Check(
            f"mould of {name}: part in the way of a piece",
            rubbed,
            limit,
            "mm3",
            where if rubbed > _TOUCH else "",
        ),
    ]


def keyed(name: str, count: int) -> Check:
    """Keys and screws between those two pieces that have the fewest."""
    told = (
        f"the mould of {name} has no room for keys between two of its pieces: align their outsides"
        " and hold them with tape"
    )
    said = f"mould of {name}: keys and screws"
    return Check(said, count, 1, "in all", "", "" if count else told, at_least=True)


def thin(pieces: Sequence[MouldPiece], rules: MouldRules) -> list[Check]:
    """How much of each piece's cores is thinner than two lines in the layers that it is printed
    in: of a layer, what is lost when its outline is opened by that width."""
    out = []
    for piece in pieces:
        lying = _lying(piece)
        low, high = lying.bounding_box()[2], lying.bounding_box()[5]
        whole, lost, at = 0.0, 0.0, ""
        most = 0.0
        width = 2 * rules.line
        for z in low + (np.arange(_LAYERS) + 0.5) / _LAYERS * (high - low):
            layer = lying.slice(float(z))
            whole += float(layer.area())
            gone = layer - layer.offset(-width / 2).offset(width / 2 + 0.02)
            for shape in gone.decompose():
                area = float(shape.area())
                if area > width**2:
                    lost += area
                    if area > most:
                        most = area
                        x = np.asarray(shape.to_polygons()[0]).mean(axis=0)
                        at = format_point(frame(-piece.down) @ np.array([*x, z]))
        share = lost / whole if whole else 1.0
        said = f"{piece.name}: share thinner than {width:.1f} mm"
        told = f"{said}: {share:.0%}, near {at}: a core may break there as it is printed"
        out.append(Check(said, share, THIN, "", at, told if share > TOLD else ""))
    return out


def _lying(piece: MouldPiece) -> Any:
    axes = frame(-piece.down)
    surface = piece.surface
    return triangle_kernel.to_manifold(Surface(surface.vertices @ axes, surface.faces), piece.name)
