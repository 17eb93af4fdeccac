"""Nearly incompressible neo-Hookean material in the volumetric-deviatoric split.

W(F) = mu/2 (J^(-2/3) tr(F^T F) - 3) + kappa/2 (J - 1)^2, with mu = E / (2 (1 + nu)) and
kappa = E / (3 (1 - 2 nu)) (Bonet & Wood, Nonlinear Continuum Mechanics, sec. 6.5). It is what
CalculiX calls NEO HOOKE with C10 = mu/2, D1 = 2/kappa.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.device import MaterialSpec

MODEL = "neo-Hookean, volumetric-deviatoric split"


@dataclass(frozen=True)
class NeoHookean:
    """Shear modulus `mu` and bulk modulus `kappa`, MPa."""

    mu: float
    kappa: float

    @classmethod
    def from_spec(cls, spec: MaterialSpec) -> NeoHookean:
        e, nu = spec.young_modulus, spec.poisson_ratio
        return cls(e / (2 * (1 + nu)), e / (3 * (1 - 2 * nu)))
