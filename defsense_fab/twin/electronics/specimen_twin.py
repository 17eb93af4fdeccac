"""A bending specimen with three cords, and whole calibration sessions on it."""

from __future__ import annotations

import numpy as np

from ...core.curves.bending import bent_strain
from .cord_twin import CordTraits, CordTwins


class SpecimenTwin:
    """A specimen of the cords bottom, neutral and top (in this order), `offset` mm from the faces
    of a bar of this `length` and `thickness`, mm, that can be laid on jigs."""

    channels = ("bottom", "neutral", "top")

    def __init__(
        self,
        traits: CordTraits,
        rng: np.random.Generator,
        length: float = 150.0,
        thickness: float = 15.0,
        offset: float = 2.0,
        misplaced: float = 0.0,
    ) -> None:
        """`misplaced` mm is the standard deviation of the cords' heights."""
        self._thickness = thickness
        self._heights = np.array([offset, thickness / 2, thickness - offset])
        self._heights += misplaced * rng.normal(size=3)
        self.cords = CordTwins(traits, np.full(3, length + 20.0), rng)

    def lay(self, radius: float | None, face: str = "a") -> None:
        """On the jig of this surface radius, mm, or the flat one (None), with the bottom down
        (face a) or the top (face b)."""
        heights = self._heights if face == "a" else self._thickness - self._heights
        strain = [0.0 if radius is None else bent_strain(radius, z, self._thickness)
                  for z in heights]  # fmt: skip
        self.cords.bend(np.array(strain))
