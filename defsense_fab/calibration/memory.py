"""What a piece of cord remembers of the strains before: terms that a fit can take apart from
w(eps).

Hysteresis: the Prandtl-Ishlinskii operator, a sum of plays of given width, each as far behind the
strain as its width lets it be (Brokate & Sprekels 1996, ch. 2). Relaxation: any change of strain
adds resistance, which heals; what is left of the last change, and of those before it.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float

#: Half widths of the plays, strains.
PLAYS = np.array([0.001, 0.003, 0.009])
#: The plays, the last change, changes before it.
TERMS = len(PLAYS) + 2
_SLOW = 60.0  # s, by which earlier changes heal


class Memory:
    """Of one piece that was at rest for long."""

    def __init__(self) -> None:
        self._plays, self._strain = np.zeros(len(PLAYS)), 0.0
        self._time, self._changes = 0.0, 0.0

    def at(self, strain: float, begun: float, read: float) -> Float:
        """(TERMS,) for a piece that was brought to this strain at the time `begun`, s, and read at
        `read`."""
        self._plays = np.clip(self._plays, strain - PLAYS, strain + PLAYS)
        change, self._strain = abs(strain - self._strain), strain
        earlier = self._changes * np.exp(-max(read - self._time, 0.0) / _SLOW)
        self._changes = self._changes * np.exp(-max(begun - self._time, 0.0) / _SLOW) + change
        self._time = begun
        return np.array([*(self._plays - strain), change, earlier])


def half_width(coefficients: Float) -> float:
    """Of the hysteresis between large strains, of (R - R0)/R0, for the terms' coefficients
    (TERMS,)."""
    return abs(float(coefficients[: len(PLAYS)] @ PLAYS))
