"""The table [material] of a device file, and what is strange about a material."""

from __future__ import annotations

from collections.abc import Mapping

from ..storage.toml_table import Table
from .catalogue import read_rows
from .device import MaterialSpec
from .shore import from_shore

#: Of soft bodies: from the softest gels to thermoplastic polyurethane at Shore 60D, MPa.
_SOFT = (0.002, 500.0)
#: Solid rubbers and polyurethanes do not lie below; foams do.
_RUBBER = 0.4
#: From foams to filled rubbers, g/cm3.
_DENSITY = (0.05, 3.0)

#: The constants (MPa) that a model may be given by, in place of young_modulus.
_CONSTANTS: dict[str, tuple[str, ...]] = {
    "neo-hookean": (),
    "stable-neo-hookean": (),
    "mooney-rivlin": ("c10", "c01"),
    "yeoh": ("c10", "c20", "c30"),
}


def read_material(t: Table) -> MaterialSpec:
    """The material. Raises DeviceError for what is unknown, missing or out of range."""
    name = t.string("name", "custom")
    rows = read_rows("materials.csv")
    row = rows.get(name, {})
    model = t.string("model", "neo-hookean")
    t.choice("model", model, list(_CONSTANTS), "material model")
    wanted = _CONSTANTS[model]
    own = any(t.has(k) for k in ("young_modulus", "shore", *wanted))
    if not own and not (t.has("poisson_ratio") and row):
        t.choice("name", name, list(rows), "material")
    poisson = t.number("poisson_ratio", row.get("poisson_ratio") and float(row["poisson_ratio"]))
    if not -1 < poisson < 0.5:
        t.fail("poisson_ratio", f"must lie between -1 and 0.5 (below it), not {poisson:g}")
    density = t.number("density", float(row.get("density", 1.1)), low=0)
    if wanted:
        constants = {k: t.number(k) for k in wanted}
        young = 4 * (constants["c10"] + constants.get("c01", 0.0)) * (1 + poisson)
        if young <= 0:
            t.fail("c10", "the shear modulus 2 (c10 + c01) must be positive")
        for key in ("young_modulus", "shore"):
            if t.has(key):
                t.fail(key, f"follows from the constants of {model}; remove it")
    else:
        constants = {}
        young = _young_modulus(t, row)
    t.done()
    return MaterialSpec(name, young, poisson, model, density, constants)


def _young_modulus(t: Table, row: Mapping[str, str]) -> float:
    if t.has("shore") and t.has("young_modulus"):
        t.fail("shore", "give either shore or young_modulus")
    if not t.has("shore"):
        return t.number(
            "young_modulus", row.get("young_modulus") and float(row["young_modulus"]), low=0
        )
    try:
        return from_shore(t.string("shore")).value
    except ValueError as error:
        t.fail("shore", str(error))


def strange(material: MaterialSpec) -> tuple[str, ...]:
    """What no soft solid has, as sentences that ask for it: often another unit was meant."""
    found = []
    young, poisson, density = material.young_modulus, material.poisson_ratio, material.density
    if not _SOFT[0] <= young <= _SOFT[1]:
        kind = "softer than any gel" if young < _SOFT[0] else "stiffer than any rubber"
        meant = f"; {young:g} Pa are {young / 1e6:g} MPa" if 0.01 <= young / 1e6 <= 200 else ""
        found.append(
            f"material: Young's modulus is {young:g} MPa, {kind} ({_SOFT[0]:g} to {_SOFT[1]:g}):"
            f" is it given in MPa?{meant}"
        )
    if poisson < _RUBBER:
        found.append(
            f"material: a Poisson ratio of {poisson:g} is that of a foam or of a hard solid; solid"
            " rubbers and polyurethanes have 0.45 to 0.4999: is it meant?"
        )
    if not _DENSITY[0] <= density <= _DENSITY[1]:
        meant = f"; {density:g} kg/m3 are {density / 1000:g} g/cm3" if density > 50 else ""
        found.append(
            f"material: the density is {density:g} g/cm3, which no soft solid has: is it given in"
            f" g/cm3?{meant}"
        )
    return tuple(found)
