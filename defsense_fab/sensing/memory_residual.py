"""What the memory of cords (hysteresis, relaxation, drift) leaves in their signals after training.

A trained decoder removes part of the memory. The rest is an error of each signal. It changes as
slowly as the movement, so averaging does not remove it. In cords it grows with the signal: its
standard deviation is a share of the largest |(R - R0)/R0| over the states. In printed traces it
does not depend on the signal. `data/memory_residuals.csv` contains the sizes with their spread over
pieces of cord or trace, what they are relative to, their basis and their source;
`data/cord_families.csv` which kind of memory a cord has, where that is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.storage.package_data import read_rows

#: Kinds of decoders: as `train` chooses them, and the paper's, which has no memory.
TRAINED, AFFINE = "trained", "affine"

_TABLE = "memory_residuals.csv"
_FAMILIES = "cord_families.csv"
_SIMULATED = "simulated"
_ABSOLUTE = "R0"  # what sizes are relative to; otherwise the largest signal
_ONE, _SEVERAL = "one", "several"
_ANY_CORD = "any"
#: Cord of the rows of printed traces; `data/cord_families.csv` names the filaments of their family.
TRACES = "trace"
_SCORE_90 = 1.645  # standard deviations of a normal distribution at its 5 % and 95 % quantiles


@dataclass(frozen=True)
class MemoryResidual:
    """The error of a signal that is left, over pieces of cord.

    Its size is a standard deviation, as a share of the cord's largest |(R - R0)/R0|.

    Attributes:
        family: Kind of memory that was simulated.
        low: 5 % quantile of the size.
        median: Median.
        high: 95 % quantile.
        is_absolute: Whether the size is one of (R - R0)/R0, whatever the largest signal.
    """

    family: str
    low: float
    median: float
    high: float
    is_absolute: bool = False

    def unit(self, largest: Float) -> Float:
        """Return what the size is relative to, for largest signals (c,), |(R - R0)/R0|."""
        return np.ones_like(largest) if self.is_absolute else largest

    def draw(self, largest: Float, rng: np.random.Generator) -> Float:
        """Draw the errors of pieces of cord: two halves of normal distributions.

        Args:
            largest: Largest signals (c,), |(R - R0)/R0|.
            rng: Random generator.

        Returns:
            Standard deviations (c,) of (R - R0)/R0.
        """
        score = rng.normal(size=len(largest)) / _SCORE_90
        spread = np.where(score < 0, self.median - self.low, self.high - self.median)
        return np.asarray(np.maximum(self.median + score * spread, 0.0) * self.unit(largest))


def known_family(cord: str) -> str:
    """Return the kind of memory that a cord has; empty if it is not known.

    Args:
        cord: Name of the cord, a row of `data/cord_families.csv`; others are not known.
    """
    row = read_rows(_FAMILIES).get(cord)
    return "" if row is None else row["family"]


def memory_residuals(cord: str, decoder: str, count: int) -> tuple[MemoryResidual, ...]:
    """Return the simulated residuals of a cord, one for each family of simulated memories.

    Several cords in one device know more of each other's memory than a single cord does.

    Args:
        cord: Name of the cord or of the filament of printed traces. Filaments of a known family
            have its residuals too; the others have those of any cord.
        decoder: TRAINED or AFFINE.
        count: Number of cords of the device.

    Returns:
        The residuals.
    """
    rows = [
        row
        for row in read_rows(_TABLE).values()
        if row["basis"] == _SIMULATED
        and row["decoder"] == decoder
        and row["cords"] == (_ONE if count == 1 else _SEVERAL)
    ]
    of_cord = [row for row in rows if row["cord"] == cord]
    family = known_family(cord)
    chosen = of_cord or [
        row
        for row in rows
        if row["cord"] == _ANY_CORD or (row["cord"] == TRACES and row["family"] == family)
    ]
    return tuple(
        MemoryResidual(
            row["family"],
            float(row["low"]),
            float(row["median"]),
            float(row["high"]),
            is_absolute=row["relative_to"] == _ABSOLUTE,
        )
        for row in chosen
    )
