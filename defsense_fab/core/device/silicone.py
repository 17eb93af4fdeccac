"""What a maker needs to know of a silicone: a row of `data/silicones.csv`."""

from __future__ import annotations

from dataclasses import dataclass

from .catalogue import read_rows


@dataclass(frozen=True)
class Silicone:
    """Parts A and B `by` weight or volume; linear shrinkage as it cures; how long it can be poured
    (min) and until it is taken out (h) at 23 C, None where that is not known; how it `cures`."""

    name: str
    ratio: tuple[float, float]
    by: str
    shrinkage: float
    pot_life: float | None
    cure: float | None
    cures: str


def silicone(name: str) -> Silicone | None:
    """The row of this name, if there is one."""
    row = read_rows("silicones.csv").get(name)
    if row is None:
        return None
    return Silicone(
        name,
        (float(row["part_a"]), float(row["part_b"])),
        row["by"],
        float(row["shrinkage"]),
        float(row["pot_life"]) if row["pot_life"] else None,
        float(row["cure"]) if row["cure"] else None,
        row["cures"],
    )
