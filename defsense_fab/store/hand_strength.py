"""Strength of hands, from published measurements, to judge the force that a pose needs.

The limits are for design: most adults are stronger, children and many elderly people are weaker.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

#: What a pose needs: fingers, a whole hand, or more than one hand can do.
Effort = Literal["fingers", "hand", "beyond"]


@dataclass(frozen=True)
class Strength:
    """What fingers or a hand can apply to a region.

    Attributes:
        force: Force, N.
        torque: Torque, N mm.
    """

    force: float
    torque: float

    def share_of(self, push: float, force: float, moment: float) -> float:
        """Return the largest share of the strength that holding a region needs.

        A resultant force has to be held. A moment can be applied by turning the region, or by
        pushing it aside; the easier of both counts.

        Args:
            push: Force along the movement of the region, N.
            force: Size of the resultant force, N.
            moment: Size of the resultant moment, N mm.
        """
        couple = min(push / self.force, moment / self.torque)
        return max(force / self.force, couple)


#: Force: grip of thumb and finger tips, held for a moment, 5th percentile of men (FAA Human Factors
#: Design Standard, 2003, amended 2009, exhibit 14.5.2.1). That fingers push as hard as they pinch
#: is assumed. Torque: limit proposed for jars that everybody from 5 to 74 years can open ("Mismatch
#: between jar opening demands and wrist torque strength of consumers in Iran", Applied Ergonomics
#: 94, 2021, 103421, 758 participants).
FINGERS = Strength(force=48.0, torque=1800.0)
#: Force: mean of the largest push along a cylindrical handle without turning it, 12 adults ("The
#: effect of handle friction and inward or outward torque on maximum axial push force", Human
#: Factors 50, 2008, 227-236). Torque: the least that opens vacuum-sealed jars with a lid of 65 mm,
#: which many people cannot apply (the same study of jars).
HAND = Strength(force=85.0, torque=4100.0)


def judge_effort(push: float, force: float, moment: float) -> Effort:
    """Return what holding a region needs; see `Strength.share_of` for the arguments."""
    if FINGERS.share_of(push, force, moment) <= 1:
        return "fingers"
    return "hand" if HAND.share_of(push, force, moment) <= 1 else "beyond"
