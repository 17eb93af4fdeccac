"""The table `[material]` of `device.toml`, and questions about unusual materials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

from msgspec import Meta

from ..schema.declare import Positive, Problem, Table, key, missing, unknown_choice
from ..storage.package_data import read_rows
from .device import MaterialSpec
from .materials import modulus_from_shore

#: Young's modulus of soft bodies: from the softest gels to thermoplastic polyurethane, Shore 60D.
SOFT_YOUNG_MODULUS_MPA = (0.002, 500.0)
#: Smallest Poisson's ratio of solid rubbers and polyurethanes; that of foams is smaller.
MIN_RUBBER_POISSON_RATIO = 0.4
#: From foams to filled rubbers.
SOFT_DENSITY_G_CM3 = (0.05, 3.0)

_DEFAULT_DENSITY_G_CM3 = 1.1
_ROWS = "materials.csv"
#: The constants (MPa) that replace young_modulus, by model.
_CONSTANTS: Mapping[str, tuple[str, ...]] = {
    "neo-hookean": (),
    "stable-neo-hookean": (),
    "mooney-rivlin": ("c10", "c01"),
    "yeoh": ("c10", "c20", "c30"),
}


class MaterialTable(Table, frozen=True):
    """What the body is made of."""

    name: Annotated[
        str,
        key(
            "Name in `defsense list materials`, which gives the source of each modulus and what"
            " it was compared with; any name if you give your own values.",
        ),
    ] = "custom"
    model: Annotated[str, key("Hyperelastic model.", choices=_CONSTANTS)] = "neo-hookean"
    young_modulus: Annotated[
        Positive | None,
        key(
            "Young's modulus at small strain, in place of the row's; not together with `shore`.",
            unit="MPa",
            rows=_ROWS,
        ),
    ] = None
    shore: Annotated[
        str | None,
        key('Hardness, as `"30A"`, in place of `young_modulus`.', default="none"),
    ] = None
    poisson_ratio: Annotated[
        Annotated[float, Meta(gt=-1, lt=0.5)] | None,
        key("Poisson's ratio.", rows=_ROWS),
    ] = None
    density: Annotated[
        Positive | None,
        key("Density, for gravity and vibration modes.", unit="g/cm³", default="the row's, or 1.1"),
    ] = None
    c10: Annotated[
        float | None,
        key(
            "Constant of Mooney-Rivlin and Yeoh, in place of `young_modulus`.",
            unit="MPa",
            default="required by these models",
        ),
    ] = None
    c01: Annotated[
        float | None,
        key("Constant of Mooney-Rivlin.", unit="MPa", default="required by this model"),
    ] = None
    c20: Annotated[
        float | None, key("Constant of Yeoh.", unit="MPa", default="required by this model")
    ] = None
    c30: Annotated[
        float | None, key("Constant of Yeoh.", unit="MPa", default="required by this model")
    ] = None

    @property
    def _row(self) -> Mapping[str, str]:
        return read_rows(_ROWS).get(self.name, {})

    def check(self) -> Iterator[Problem]:
        """Yield problems of values that are missing, or that exclude each other."""
        constants, rows = _CONSTANTS[self.model], read_rows(_ROWS)
        row = rows.get(self.name, {})
        alternatives = ("young_modulus", "shore", *constants)
        has_modulus = any(getattr(self, name) is not None for name in alternatives)
        if not row and not has_modulus:
            yield unknown_choice(("name",), self.name, rows, "material", "unknown-material")
            return
        if self.poisson_ratio is None and not row:
            yield missing("poisson_ratio")
        yield from self._check_constants(constants)
        if self.shore is None:
            return
        if self.young_modulus is not None:
            text = "young_modulus is given too"
            yield Problem(("shore",), text, "keys-exclusive", "Give only one of the two")
        try:
            modulus_from_shore(self.shore)
        except ValueError as error:
            yield Problem(("shore",), str(error), "hardness-invalid")

    def _check_constants(self, constants: tuple[str, ...]) -> Iterator[Problem]:
        for name in ("c10", "c01", "c20", "c30"):
            is_given = getattr(self, name) is not None
            if name in constants and not is_given:
                yield missing(name)
            elif is_given and name not in constants:
                text = f"is not a constant of the model {self.model!r}"
                yield Problem((name,), text, "key-not-applicable", "Remove it")
        if not constants:
            return
        if self.c10 is not None and self.c10 + (self.c01 or 0.0) <= 0:
            text = "the shear modulus 2 (c10 + c01) must be positive"
            yield Problem(("c10",), text, "out-of-range", "Increase c10")
        for name in ("young_modulus", "shore"):
            if getattr(self, name) is not None:
                text = f"follows from the constants of {self.model}"
                yield Problem((name,), text, "keys-exclusive", "Remove it")

    def record(self) -> MaterialSpec:
        """Return the material, completed from its row."""
        row, constants = self._row, _CONSTANTS[self.model]
        poisson = self.poisson_ratio
        poisson = float(row["poisson_ratio"]) if poisson is None else poisson
        density = self.density
        if density is None:
            density = float(row.get("density", _DEFAULT_DENSITY_G_CM3))
        given = {name: float(getattr(self, name)) for name in constants}
        if given:
            young = 4 * (given["c10"] + given.get("c01", 0.0)) * (1 + poisson)
        elif self.shore is not None:
            young = modulus_from_shore(self.shore).value
        else:
            young = self.young_modulus or float(row["young_modulus"])
        return MaterialSpec(self.name, young, poisson, self.model, density, given)


def unusual_properties(material: MaterialSpec) -> tuple[str, ...]:
    """Return a question for each property that no soft solid has; often another unit was meant."""
    questions = []
    young, poisson, density = material.young_modulus, material.poisson_ratio, material.density
    low, high = SOFT_YOUNG_MODULUS_MPA
    if not low <= young <= high:
        kind = "softer than any gel" if young < low else "stiffer than any rubber"
        in_mpa = f" {young:g} Pa are {young / 1e6:g} MPa." if 0.01 <= young / 1e6 <= 200 else ""
        questions.append(
            f"material: Young's modulus is {young:g} MPa, {kind} ({low:g} to {high:g})."
            f" Is it given in MPa?{in_mpa}"
        )
    if poisson < MIN_RUBBER_POISSON_RATIO:
        questions.append(
            f"material: a Poisson's ratio of {poisson:g} is that of a foam or of a hard solid;"
            f" solid"
            " rubbers and polyurethanes have 0.45 to 0.4999. Is it intended?"
        )
    low, high = SOFT_DENSITY_G_CM3
    if not low <= density <= high:
        in_g_cm3 = f" {density:g} kg/m3 are {density / 1000:g} g/cm3." if density > 50 else ""
        questions.append(
            f"material: the density is {density:g} g/cm3, which no soft solid has ({low:g} to"
            f" {high:g}). Is it given in g/cm3?{in_g_cm3}"
        )
    return tuple(questions)
