"""What a maker needs to know of a silicone: a row of `data/silicones.csv`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ..storage.package_data import read_rows

# Shore A hardness to Young's modulus, with how far such a conversion can be trusted.
#
# Gent 1958 ("On the relation between indentation hardness and Young's modulus", Rubber Chemistry
# and Technology 31, 896): a rigid punch on a linear elastic half space. It gives no error of its own.
# Over the 13 materials of `data/materials.csv` between 20A and 80A whose modulus does not come from
# their hardness, the conversion's mean ratio to that modulus is 0.97 and the standard deviation of
# its logarithm 0.32: a 90 % band of a factor 1.7 either way. A reading that is 5 units off is 20 to
# 28 %. Above 80A the formula diverges, below 20A it does not reach zero; Shore 00 has no accepted
# conversion.

LOW, HIGH = 20.0, 80.0
#: Standard deviation of ln(conversion / modulus); see the module's text.
SPREAD = 0.32


@dataclass(frozen=True)
class ShoreModulus:
    """Young's modulus in MPa with its 90 % band."""

    value: float
    low: float
    high: float


def gent(shore_a: float) -> float:
    """Young's modulus (MPa) of a Shore A reading, Gent 1958 eq. 6 in SI units."""
    return 0.0981 * (56 + 7.62336 * shore_a) / (0.137505 * (254 - 2.54 * shore_a))


def from_shore(hardness: str) -> ShoreModulus:
    """The modulus of a hardness such as "30A". Raises ValueError outside 20A to 80A."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*A\s*", hardness)
    if match is None:
        raise ValueError(
            f"{hardness!r} is not a Shore A hardness such as '30A'; other scales have no accepted"
            " conversion, give young_modulus"
        )
    reading = float(match[1])
    if not LOW <= reading <= HIGH:
        raise ValueError(
            f"{hardness} lies outside {LOW:g}A to {HIGH:g}A, where the conversion holds; give"
            " young_modulus"
        )
    value = gent(reading)
    factor = math.exp(1.645 * SPREAD)
    return ShoreModulus(value, value / factor, value * factor)


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
