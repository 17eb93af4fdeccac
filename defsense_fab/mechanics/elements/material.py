"""Define isotropic hyperelastic materials by their energy as a function of the invariants of F.

I1 = tr(F^T F), I2 = (I1^2 - tr((F^T F)^2)) / 2, J = det F. Stress and tangent follow from the first
and second derivatives of W(I1, I2, J), `evaluate_law` in `kernels/energy_density.c`.

- Split models, with I1* = J^(-2/3) I1 and I2* = J^(-4/3) I2 (Bonet & Wood, Nonlinear Continuum
  Mechanics, sec. 6.5; Yeoh 1993; Mooney 1940, Rivlin 1948):
  W = c10 (I1* - 3) + c20 (I1* - 3)^2 + c30 (I1* - 3)^3 + c01 (I2* - 3) + kappa/2 (J - 1)^2.
  Neo-Hookean has c10 alone, Mooney-Rivlin c10 and c01, Yeoh c10, c20 and c30.
- Stable neo-Hookean (Smith, De Goes & Kim 2018, eq. 14):
  W = mu/2 (I1 - 3) + lambda/2 (J - alpha)^2 - mu/2 log((I1 + 1)/4), finite for inverted elements.

The split and the stable model are different materials near nu = 0.49: name the model with a result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device.device import MaterialSpec

SPLIT, STABLE = 0, 1  # as in `evaluate_law`

#: Title of each model in results, by its name in `device.toml`.
TITLES = {
    "neo-hookean": "neo-Hookean, volumetric-deviatoric split",
    "stable-neo-hookean": "stable neo-Hookean (Smith et al. 2018)",
    "mooney-rivlin": "Mooney-Rivlin, volumetric-deviatoric split",
    "yeoh": "Yeoh, volumetric-deviatoric split",
}


@dataclass(frozen=True)
class Material:
    """An isotropic hyperelastic material.

    Attributes:
        model: Name of the model, a key of `TITLES`.
        kind: `SPLIT` or `STABLE`, the family of the energy.
        parameters: (5,) MPa: c10, c20, c30, c01, kappa of the split family, or mu, lambda, alpha
            (alpha without unit) and two zeros of the stable model.
        shear: Shear modulus at small strain, MPa.
        bulk: Bulk modulus at small strain, MPa.
    """

    model: str
    kind: int
    parameters: Float
    shear: float
    bulk: float

    @property
    def law(self) -> tuple[int, Float]:
        """The family and the parameters, as compiled loops take them."""
        return self.kind, self.parameters

    @property
    def title(self) -> str:
        """Title of the model for people."""
        return TITLES[self.model]

    @property
    def young(self) -> float:
        """Young's modulus at small strain, MPa."""
        return 9 * self.bulk * self.shear / (3 * self.bulk + self.shear)

    @property
    def volumetric(self) -> float:
        """Second derivative of the energy's quadratic part in J, MPa."""
        return float(self.parameters[4 if self.kind == SPLIT else 1])

    @classmethod
    def from_spec(cls, spec: MaterialSpec) -> Material:
        """Create the material of a `[material]` table.

        The moduli follow from Young's modulus E and Poisson's ratio nu:
        mu = E / (2 (1 + nu)), kappa = E / (3 (1 - 2 nu)).
        """
        e, nu = spec.young_modulus, spec.poisson_ratio
        mu, kappa = e / (2 * (1 + nu)), e / (3 * (1 - 2 * nu))
        if spec.model == "stable-neo-hookean":
            return stable_neo_hookean(mu, kappa)
        c = dict(spec.constants) or {"c10": mu / 2}
        return split(kappa, model=spec.model, **c)


def split(
    kappa: float,
    c10: float,
    c20: float = 0.0,
    c30: float = 0.0,
    c01: float = 0.0,
    model: str = "neo-hookean",
) -> Material:
    """Create a material whose energy splits into a volumetric and a deviatoric part.

    Args:
        kappa: Bulk modulus, MPa.
        c10: Coefficient of I1* - 3, MPa.
        c20: Coefficient of (I1* - 3)^2, MPa.
        c30: Coefficient of (I1* - 3)^3, MPa.
        c01: Coefficient of I2* - 3, MPa.
        model: Name of the model.
    """
    parameters = np.array([c10, c20, c30, c01, kappa], float)
    return Material(model, SPLIT, parameters, 2 * (c10 + c01), kappa)


def neo_hookean(mu: float, kappa: float) -> Material:
    """Create a split neo-Hookean material from its moduli at small strain, MPa.

    CalculiX calls it NEO HOOKE, with C10 = mu/2 and D1 = 2/kappa.
    """
    return split(kappa, mu / 2)


def stable_neo_hookean(mu: float, kappa: float) -> Material:
    """Create a stable neo-Hookean material from its moduli at small strain, MPa.

    References:
        Smith, De Goes & Kim 2018, "Stable Neo-Hookean Flesh Simulation", sec. 3.4.
    """
    m, lame = 4 / 3 * mu, kappa - 2 / 3 * mu + 5 / 6 * mu
    parameters = np.array([m, lame, 1 + 0.75 * m / lame, 0.0, 0.0])
    return Material("stable-neo-hookean", STABLE, parameters, mu, kappa)
