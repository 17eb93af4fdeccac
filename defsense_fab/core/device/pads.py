"""Pads in which printed traces end on the skin, and the fasteners that connect wires to them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Fastener:
    """A round piece of metal on a pad, around its axis.

    Attributes:
        name: Name in drawings.
        diameter: Outer diameter, mm.
        low: Height of its lower end above the skin, mm; negative in the body.
        high: Height of its upper end above the skin, mm.
    """

    name: str
    diameter: float
    low: float
    high: float


@dataclass(frozen=True)
class PadSpec:
    """A kind of pad: a cylinder of conductive filament below the skin, with holes from above.

    Attributes:
        name: Value of `[wires] pad`.
        diameter: Diameter of the cylinder, mm.
        depth: Depth of the cylinder below the skin, mm.
        hole_diameter: Diameter of the holes, mm.
        hole_depth: Depth of the holes below the skin, mm.
        hole_spacing: Distance of two holes, which a tunnel joins at their bottoms, mm; 0 for one
            hole in the middle.
        fasteners: Pieces of metal on the pad.
        needs: What connects one pad, for the bill of materials.
        instruction: How to connect a wire, as a sentence.
        sources: Where the sizes come from.
    """

    name: str
    diameter: float
    depth: float
    hole_diameter: float
    hole_depth: float
    hole_spacing: float
    fasteners: tuple[Fastener, ...]
    needs: str
    instruction: str
    sources: str

    @property
    def room(self) -> float:
        """Diameter (mm) of the circle on the skin that the pad and its fasteners need."""
        return max([self.diameter, *(f.diameter for f in self.fasteners)])

    @property
    def reach(self) -> float:
        """Largest distance (mm) of the pad's filament from its middle on the skin."""
        return math.hypot(self.diameter / 2, self.depth)

    @property
    def hole_offsets(self) -> tuple[float, ...]:
        """Distances (mm) of the holes' axes from the pad's axis, with their sign."""
        return (-self.hole_spacing / 2, self.hole_spacing / 2) if self.hole_spacing else (0.0,)


_FLOOR = "The filament below a hole is 0.8 mm thick: four layers of 0.2 mm (assumed)."

#: Kinds of pads by their names; the first is the default.
PADS: Mapping[str, PadSpec] = {
    pad.name: pad
    for pad in (
        PadSpec(
            name="screw",
            diameter=4.5,
            depth=4.6,
            hole_diameter=1.6,
            hole_depth=3.8,
            hole_spacing=0.0,
            fasteners=(
                Fastener("M2 x 4 screw", 2.0, -3.7, 0.3),
                Fastener("washer", 4.5, 0.0, 0.3),
                Fastener("head", 4.0, 0.3, 1.9),
            ),
            needs="screw M2 x 4 and washer of 4.5 mm",
            instruction="Wind the bare wire around an M2 x 4 screw below its washer, and turn the"
            " screw into the pad until the washer touches the wire. Do not tighten it further: the"
            " thread is in soft filament",
            sources="The pad is as wide as a small M2 washer (ISO 7092). The hole has the diameter"
            " of the tap drill of M2 (ISO 2306), and is deeper than an M2 x 4 screw reaches"
            f" through its washer of 0.3 mm. The head is that of ISO 7045. {_FLOOR}",
        ),
        PadSpec(
            name="eyelet",
            diameter=6.0,
            depth=6.2,
            hole_diameter=2.5,
            hole_depth=5.4,
            hole_spacing=0.0,
            fasteners=(
                Fastener("M3 x 6 screw", 3.0, -5.2, 0.8),
                Fastener("eyelet", 6.0, 0.0, 0.8),
                Fastener("head", 5.6, 0.8, 3.2),
            ),
            needs="screw M3 x 6 and crimp eyelet for M3",
            instruction="Crimp an eyelet for M3 to the wire, and fasten it to the pad with an M3 x"
            " 6 screw. Do not tighten it further than until the eyelet does not turn",
            sources="The pad is as wide as the ring of an eyelet for M3, which is 6 mm wide and 0.8"
            " mm thick (assumed; makers differ by 0.5 mm). The hole has the diameter of the tap"
            " drill of M3 (ISO 2306), and is deeper than an M3 x 6 screw reaches through the"
            f" eyelet. The head is that of ISO 7045. {_FLOOR}",
        ),
        PadSpec(
            name="spring-pin",
            diameter=4.0,
            depth=1.2,
            hole_diameter=2.0,
            hole_depth=0.4,
            hole_spacing=0.0,
            fasteners=(
                Fastener("plunger", 1.5, -0.4, 2.0),
                Fastener("spring pin", 2.0, 2.0, 5.0),
            ),
            needs="spring pin with a tip of up to 1.5 mm, in a holder",
            instruction="Press a spring pin with a round or flat tip into the dimple of the pad,"
            " and fix its holder to the body or to the table",
            sources="The dimple is two layers of 0.2 mm deep, and 0.5 mm wider than a tip of 1.5"
            " mm. The rim of 1 mm around it allows for a holder that is 1 mm off (all assumed).",
        ),
        PadSpec(
            name="thread",
            diameter=7.2,
            depth=4.0,
            hole_diameter=2.0,
            hole_depth=3.2,
            hole_spacing=3.6,
            fasteners=(),
            needs="conductive thread, 0.3 m",
            instruction="Pull conductive thread with a curved needle into one hole of the pad and"
            " out of the other, five times around the bridge between them, and knot it",
            sources="The holes are the smallest that stay open (`hole` of fdm-tpu in"
            " data/printers.csv). The bridge between them is 1.6 mm wide and 1.2 mm thick, and the"
            f" rim 0.8 mm wide: four and two lines of 0.4 mm (assumed). {_FLOOR}",
        ),
    )
}
