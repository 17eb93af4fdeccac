"""The memory of printed conductive TPU: contacts that open, close and settle.

The resistance of a printed trace is that of a network of contacts between carbon particles, so that
causes multiply. With s = (R - R0)/R0 without memory, x = |s|, and m the largest x so far,

    ln(R/R0) = ln(1 + g s) + k s^2 + a (d z + o T) + Y - a p q

- z goes from -1 to 1 within a change of x by 2 w m: contacts open as the trace is strained, and
  close as soon as it returns. R is higher while straining than while returning.
- T is the share of the paths, made under strain, that have opened again. A path opens as x falls
  below its threshold, and closes by strain, or with time. So R rises for a moment as a trace
  returns to rest: a secondary peak.
- Y are further contacts that any movement breaks. Each of their classes is finite, so that fast
  movement saturates them; they heal with 0.5 to 20 s.
- q goes from 0 to 1 with the travel of x: the network settles in the first cycles, and R0 falls.
  The gain g falls by a share in hundreds of cycles. Both are forgotten slowly.
- k is the curvature of tunneling through gaps that widen.

Sizes d, o and p are absolute, as the number of weak contacts is limited: large signals have
relatively less memory. They were fitted to signals of 0.05; smaller ones have a = m / 0.05, others
a = 1. No family of cords and no decoder has such terms.

References:
    Long relaxation and secondary peaks of carbon-elastomer networks: arXiv 2505.11506.
    The constants and their sources: `data/filament_memory.csv`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ...core.storage.package_data import read_rows
from ..scenes.assumptions import assume
from .hysteretic_memory import FLUCTUATION_TIMES_S, MAX_PIECE_DEVIATION, filter_noise

#: Thresholds at which paths open, relative to the largest signal so far.
OPENING_THRESHOLDS = np.linspace(0.4, 0.6, 8)
#: Time constants with which opened paths close at rest, s, in the order of the thresholds.
CLOSING_TIMES_S = np.array([10.0, 22.0, 12.0, 26.0, 14.0, 30.0, 16.0, 19.0])
#: Time constants of the contacts that any movement breaks, s.
HEALING_TIMES_S = np.geomspace(0.5, 20.0, 6)
#: Range of the signals (R - R0)/R0 that the sizes were fitted to.
FITTED_RANGE = 0.05
MIN_RESISTANCE = 0.05  # of R0, below which a signal without memory is cut off


def _stated(name: str, trait: str, unit: str, meaning: str, *, keep: bool = False) -> float:
    """Declare a number of `data/filament_memory.csv`; `keep` keeps it if its trait is disabled."""
    row = read_rows("filament_memory.csv")[name]
    value = float(row["value"])
    source = f"{row['basis']}: {row['source']}"
    field: float = assume(value, trait, unit, meaning, source, off=value if keep else 0.0)
    return field


@dataclass(frozen=True)
class ContactNetwork:
    """Constants of the network of contacts, and how prints differ in them.

    The declaration of each field states its unit, meaning and source.
    """

    direction: float = _stated(
        "direction", "hysteresis", "ln R", "d, half of the difference between the directions"
    )
    width: float = _stated(
        "width", "hysteresis", "m", "w, half of the way in which the direction turns", keep=True
    )
    opened: float = _stated("opened", "hysteresis", "ln R", "o, of paths that open on release")
    broken: float = _stated("broken", "relaxation", "of the change", "broken by any movement")
    broken_limit: float = _stated(
        "broken_limit", "relaxation", "ln R", "largest part that movement breaks", keep=True
    )
    settled: float = _stated("settled", "mullins", "ln R", "p, fall of R0 in the first cycles")
    settling: float = _stated("settling", "mullins", "m", "travel of 63 % of that fall", keep=True)
    softening: float = _stated("softening", "mullins", "1", "share of the gain that is lost")
    fatigue: float = _stated("fatigue", "mullins", "m", "travel of 63 % of that loss", keep=True)
    curvature: float = _stated("curvature", "tunneling", "1", "k, of ln R over s^2")
    recovery: float = _stated(
        "recovery", "mullins", "h", "time constant of the way back at rest", keep=True
    )
    fresh: float = _stated("fresh", "mullins", "1", "largest s of a new trace", keep=True)
    fluctuation: float = _stated("fluctuation", "noise", "1", "1/f noise, standard deviation")
    spread: float = _stated(
        "spread", "spread", "1", "sizes in prints, standard deviation of their logarithm"
    )

    def draw(self, count: int, rng: np.random.Generator) -> Float:
        """Draw the sizes (c, 5) of prints, log-normal around those of the filament."""
        sizes = np.array([getattr(self, name) for name in SIZES])
        deviation = rng.normal(size=(count, len(sizes)))
        deviation = np.clip(deviation, -MAX_PIECE_DEVIATION, MAX_PIECE_DEVIATION)
        return np.asarray(sizes * np.exp(self.spread * deviation))

    def new_state(self, count: int) -> tuple[Float, ...]:
        """Return the state of new traces: z (c,), T (k, c), Y (j, c), q (2, c) and m (c,)."""
        return (
            np.zeros(count),
            np.zeros((len(OPENING_THRESHOLDS), count)),
            np.zeros((len(HEALING_TIMES_S), count)),
            np.zeros((2, count)),
            np.full(count, self.fresh),
        )

    def rest_state(self, state: tuple[Float, ...], hours: float) -> tuple[Float, ...]:
        """Return the state after hours at rest: paths closed, settling partly forgotten."""
        z, opened, broken, q, m = state
        seconds = 3600 * hours
        opened = opened * np.exp(-seconds / CLOSING_TIMES_S)[:, None]
        broken = broken * np.exp(-seconds / HEALING_TIMES_S)[:, None]
        return z, opened, broken, q * np.exp(-hours / self.recovery), m

    def respond(
        self, time: Float, signals: Float, state: tuple[Float, ...], pieces: Float
    ) -> tuple[Float, tuple[Float, ...]]:
        """Return the responses (n, c) and the state at the last time.

        Args:
            time: Times (n,) s.
            signals: Ideal signals (n, c), (R - R0)/R0.
            state: The state at the first time.
            pieces: Sizes (c, 5) of the prints.
        """
        common = (self.width, self.broken_limit, self.settling, self.fatigue, self.curvature)
        response, *end = _respond(
            time, signals, *state, pieces, common,
            OPENING_THRESHOLDS, CLOSING_TIMES_S, HEALING_TIMES_S,
        )  # fmt: skip
        return response, tuple(end)

    def fluctuate(self, time: Float, response: Float, rng: np.random.Generator) -> Float:
        """Draw 1/f noise (n, c)."""
        step = np.diff(time, prepend=time[0])
        noise = np.zeros_like(response)
        for constant in FLUCTUATION_TIMES_S:
            noise += filter_noise(step, constant, rng.normal(size=response.shape))
        return np.asarray(self.fluctuation / np.sqrt(len(FLUCTUATION_TIMES_S)) * noise)


#: Names of the sizes in which prints differ.
SIZES = ("direction", "opened", "broken", "settled", "softening")


@compiled(error_model="numpy")
def _respond(time, s, z0, opened0, broken0, q0, m0, pieces, common, thresholds, closing, healing):  # type: ignore[no-untyped-def]
    """Return R/R0 - 1 (n, c), and z, T, Y, q and m at the end."""
    width, limit, settling, fatigue, curvature = common
    n, c = s.shape
    out = np.empty((n, c))
    z, opened, broken, q, m = z0.copy(), opened0.copy(), broken0.copy(), q0.copy(), m0.copy()
    part = limit / len(healing)
    for j in range(c):
        direction, torn, broken_share, settled, softening = pieces[j]
        before, x_before = s[0, j], abs(s[0, j])
        for i in range(n):
            dt = time[i] - time[i - 1] if i else 0.0
            x = abs(s[i, j])
            change = x - x_before
            m[j] = max(m[j], x)
            z[j] = min(max(z[j] + change / (width * m[j]), -1.0), 1.0)
            for k in range(len(thresholds)):
                threshold = thresholds[k] * m[j]
                if x >= threshold:
                    opened[k, j] = 0.0
                elif x_before >= threshold:
                    opened[k, j] = 1.0
                else:
                    opened[k, j] *= np.exp(-dt / closing[k])
            travel = abs(s[i, j] - before)
            ohm = 0.0
            for k in range(len(healing)):
                left = broken[k, j] * np.exp(-dt / healing[k])
                # Of the contacts that are left, a share breaks that grows with the travel.
                share = np.exp(-broken_share * travel / limit)
                broken[k, j] = part - (part - left) * share
                ohm += broken[k, j]
            q[0, j] = 1 - (1 - q[0, j]) * np.exp(-travel / (settling * m[j]))
            q[1, j] = 1 - (1 - q[1, j]) * np.exp(-travel / (fatigue * m[j]))
            size = min(m[j] / FITTED_RANGE, 1.0)
            ideal = max(s[i, j] * (1 - softening * q[1, j]), MIN_RESISTANCE - 1)
            ohm += np.log(1 + ideal) + curvature * s[i, j] ** 2
            ohm += size * (direction * z[j] + torn * opened[:, j].mean() - settled * q[0, j])
            out[i, j] = np.exp(ohm) - 1
            before, x_before = s[i, j], x
    return out, z, opened, broken, q, m
