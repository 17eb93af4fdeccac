"""Kinds of cords that the paper compares, as the twin has them: what is assumed of each."""

from __future__ import annotations

from dataclasses import dataclass

from .rubber_cords import RubberTraits


@dataclass(frozen=True)
class CordKind:
    """By a `title`, what is `assumed` of it in words, and the `traits` of its rubber."""

    title: str
    assumed: str
    traits: RubberTraits


CORD_KINDS = {
    "ecord": CordKind(
        "ready-made conductive rubber cord",
        "the cord of defsense twin: a stretch adds resistance that heals within a minute, friction"
        " takes 12 % of a change, and the first stretch answers by 12 % more (docs/twin.md)",
        RubberTraits(),
    ),
    "etpu": CordKind(
        "printed conductive TPU filament",
        "the same model, with ten times the resistance that a stretch adds and that heals, four"
        " times the friction and five times the softening: chosen to look in kind as the paper's"
        " Fig. 10 does, which gives no numbers",
        RubberTraits(tear=(0.6, 0.5, 0.5), flow=0.3, friction=0.48, mullins=0.6),
    ),
}
