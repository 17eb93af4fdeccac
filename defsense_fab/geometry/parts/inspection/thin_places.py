"""How much of a part is too thin for the printer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ....core.arrays import xyz
from ....core.errors import FabricationError
from ...kernels.cutting_tools import frame
from ..check import Check
from ..records import Made, Rules

#: Most of a part that may be thinner than two lines: such places print as gaps. Wedges between
#: planes that cross at small angles are told of long before that.
THIN, TOLD = 0.5, 0.05
_LAYERS = 30


def thin_places(
    made: Made, pieces: Sequence[Any], which: Iterable[int], rules: Rules
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
                f" {xyz(at)}, between the planes of {cords}"
                " and the skin: move a plane",
                code="part-too-thin",
                part=part.name,
            )
        name = f"{part.name}: share thinner than {width:.1f} mm"
        told = f"{name}: {share:.0%}, near {xyz(at)}: it may print with gaps"
        out.append(
            Check(name, share, THIN, "", xyz(at) if thin else "", told if share > TOLD else "")
        )
    return out
