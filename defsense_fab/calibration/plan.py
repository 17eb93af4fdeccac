"""The protocol of a calibration: which jig next, and which way up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FACES = ("a", "b")


@dataclass(frozen=True)
class JigStep:
    """One reading of the round `turn` (from 0): the specimen lies on the jig of this surface
    `radius`, mm, or on the flat one (None), with its `face` down."""

    turn: int
    radius: float | None
    face: str

    @property
    def jig(self) -> str:
        """The jig's name, as it is engraved."""
        return "FLAT" if self.radius is None else f"R{self.radius:g}"


def plan(
    radii: Sequence[float], rounds: int, faces: Sequence[str], rng: np.random.Generator
) -> tuple[JigStep, ...]:
    """Rounds that begin and end on the flat jig; in between, one face after the other, in random
    order, and on each the jigs in random order: what drifts with time then looks like noise, not
    like an answer to strain."""
    out = []
    for turn in range(rounds):
        out.append(JigStep(turn, None, faces[0]))
        for face in rng.permutation(faces):
            out += [JigStep(turn, float(r), str(face)) for r in rng.permutation(radii)]
        out.append(JigStep(turn, None, faces[0]))
    return tuple(out)
