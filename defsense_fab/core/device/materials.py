"""Materials: modulus from the Shore hardness, the processes that make them, and silicones."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ..errors import DeviceError
from ..schema.declare import Problem
from ..storage.package_data import read_rows

#: Shore A hardness between which the conversion holds. Above, the formula diverges; below, it does
#: not reach zero.
MIN_SHORE_A, MAX_SHORE_A = 20.0, 80.0
#: Standard deviation of ln(conversion / modulus), over the 13 materials of `data/materials.csv`
#: between 20A and 80A whose modulus does not come from their hardness. The mean ratio is 0.97.
LOG_SPREAD = 0.32
_MATERIALS = "materials.csv"
#: Materials of new devices, by the start of the process's name.
_DEFAULT_MATERIALS = {
    "fdm-tpu": "ninjaflex-85a",
    "polyjet-agilus": "agilus30-black",
    "polyjet": "tango-black-plus",
    "sla-elastic": "formlabs-elastic-50a",
    "sla-flexible": "formlabs-flexible-80a",
    "dls-epu": "carbon-epu-40",
    "sls-tpu": "eos-tpu-1301",
    "cast-silicone": "dragon-skin-20",
}


@dataclass(frozen=True)
class ShoreModulus:
    """Young's modulus estimated from a hardness.

    Attributes:
        value: The estimate, MPa.
        low: Lower end of the 90 % band, MPa.
        high: Upper end of the 90 % band, MPa.
    """

    value: float
    low: float
    high: float


def gent_modulus(shore_a: float) -> float:
    """Return Young's modulus (MPa) of a Shore A hardness.

    The model is a rigid punch on a linear elastic half-space; its source gives no error. A reading
    that is 5 units wrong changes the modulus by 20 to 28 %.

    References:
        Gent 1958, "On the relation between indentation hardness and Young's modulus", Rubber
        Chemistry and Technology 31, 896, eq. 6 in SI units.
    """
    return 0.0981 * (56 + 7.62336 * shore_a) / (0.137505 * (254 - 2.54 * shore_a))


def modulus_from_shore(hardness: str) -> ShoreModulus:
    """Estimate Young's modulus from a hardness on a data sheet.

    Args:
        hardness: A Shore A hardness such as "30A". Other scales, such as Shore 00, have no
            accepted conversion.

    Returns:
        The modulus with its 90 % band, a factor of 1.7 either way.

    Raises:
        ValueError: The text is not a Shore A hardness from 20A to 80A.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*A\s*", hardness)
    if match is None:
        raise ValueError(
            f"{hardness!r} is not a Shore A hardness such as '30A'; other scales have no accepted"
            " conversion, give young_modulus"
        )
    reading = float(match[1])
    if not MIN_SHORE_A <= reading <= MAX_SHORE_A:
        raise ValueError(
            f"{hardness} is outside of {MIN_SHORE_A:g}A to {MAX_SHORE_A:g}A, where the conversion"
            " holds; give young_modulus"
        )
    value = gent_modulus(reading)
    factor = math.exp(1.645 * LOG_SPREAD)
    return ShoreModulus(value, value / factor, value * factor)


def elongation_at_break(name: str) -> float | None:
    """Return the strain at which a material of `data/materials.csv` breaks, or None if unknown."""
    percent = read_rows(_MATERIALS).get(name, {}).get("elongation_at_break")
    return float(percent) / 100 if percent else None


def list_processes(material: str) -> tuple[str, ...]:
    """Return the processes of `data/printers.csv` that make a material; none if it is custom."""
    return tuple(read_rows(_MATERIALS).get(material, {}).get("processes", "").split())


def list_materials(process: str) -> tuple[str, ...]:
    """Return the materials of `data/materials.csv` that a process makes."""
    return tuple(name for name in read_rows(_MATERIALS) if process in list_processes(name))


def is_makeable(material: str, process: str) -> bool:
    """Return whether a process makes a material; custom materials are accepted by all processes."""
    return material not in read_rows(_MATERIALS) or process in list_processes(material)


def find_process_problem(material: str, process: str) -> Problem | None:
    """Return the problem of a process that does not make a material; None if it does."""
    if is_makeable(material, process):
        return None
    processes, materials = list_processes(material), list_materials(process)
    return Problem(
        ("name",),
        f"the process {process!r} does not make {material!r}",
        "material-not-for-process",
        f"Use a process for this material ({', '.join(processes)}), a material for this process"
        f" ({', '.join(materials)}), or another name with custom values",
        {"material": material, "processes": processes, "materials": materials},
    )


def default_material(process: str) -> str:
    """Return the material of new devices that a process makes.

    Raises:
        DeviceError: The process is user-defined (`unknown-material`).
    """
    for start, material in _DEFAULT_MATERIALS.items():
        if process.startswith(start):
            return material
    raise DeviceError(
        f"the material of the process {process} is not known",
        code="unknown-material",
        where="process",
        action="Give a material",
        process=process,
    )


@dataclass(frozen=True)
class Silicone:
    """How a silicone is mixed and cast: a row of `data/silicones.csv`.

    Attributes:
        name: Name of the silicone.
        ratio: Parts A and B.
        by: Whether the parts are by "weight" or "volume".
        shrinkage: Linear shrinkage as it cures, as a share of the length.
        pot_life: Time in which it can be poured at 23 C, min; None where it is not known.
        cure: Time until it can be demolded at 23 C, h; None where it is not known.
        cures: Kind of cure.
    """

    name: str
    ratio: tuple[float, float]
    by: str
    shrinkage: float
    pot_life: float | None
    cure: float | None
    cures: str


def find_silicone(name: str) -> Silicone | None:
    """Return the silicone of a name, or None."""
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
