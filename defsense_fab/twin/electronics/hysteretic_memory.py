"""The memory of cords that depends on turning points: a family fitted to recordings of sensors.

The response of a cord to its ideal signal s = (R - R0)/R0, with m the largest |s| so far, is

    a = s (1 + mu (1 - q)) + sum_k c_k z_k + y_1 + y_2

- z_k are stop operators with thresholds r_k m (Prandtl-Ishlinskii): they depend on the turning
  points of s, and creep back within minutes. Thresholds of stretching and releasing differ.
- y_i is resistance of contacts that movement breaks and that recombine by a power of their number:
  y' = b |s'| - k |y/m|^(1/n) y, with b of stretching and b of releasing. Held still, y falls as
  t^-n, and a constant rate v of s leads to y in proportion to v^(n/(n+1)). If releasing breaks more
  than the signal falls, R rises although the cord is released: a second peak.
- q goes from 0 to 1 with the travel of s: the first cycles respond otherwise than later ones
  (Mullins), and again when s exceeds m.

No sum of exponential memories of s or of its travel equals a. Noise is 1/f and grows with a.

References:
    P. Krejci, K. Kuhnen: Inverse control of systems with hysteresis and creep. 2001.
    The constants and their sources: `data/cord_memory.csv`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ...core.storage.package_data import read_rows
from ..scenes.assumptions import assume

#: Thresholds of the stop operators, relative to the largest signal so far.
THRESHOLDS = np.geomspace(0.01, 0.8, 8)
#: Time constants of the fluctuations (s), one an octave of 1/f noise, from 0.1 s to 1000 s.
FLUCTUATION_TIMES_S = np.geomspace(0.1, 1000.0, 14)
MAX_PIECE_DEVIATION = 2.0  # standard deviations, at which pieces are cut off


def _fitted(name: str, trait: str, unit: str, meaning: str, *, keep: bool = False) -> float:
    """Declare a number of `data/cord_memory.csv`; `keep` keeps it if its trait is disabled."""
    row = read_rows("cord_memory.csv")[name]
    value = float(row["value"])
    source = f"{row['basis']}: {row['source']}"
    field: float = assume(value, trait, unit, meaning, source, off=value if keep else 0.0)
    return field


@dataclass(frozen=True)
class HystereticMemory:
    """Constants of the memory, and how pieces of one cord differ in them.

    The declaration of each field states its unit, meaning and source. `_respond` reads the fields
    up to `conditioning` in this order.
    """

    friction: float = _fitted("friction", "hysteresis", "1", "share of the stop operators")
    exponent: float = _fitted(
        "exponent", "hysteresis", "1", "power of the thresholds in their shares", keep=True
    )
    release_ratio: float = _fitted(
        "release_ratio", "hysteresis", "1", "thresholds of releasing over stretching", keep=True
    )
    slow_stretched: float = _fitted(
        "slow_stretched", "relaxation", "of the change", "broken by stretching, healing slowly"
    )
    slow_released: float = _fitted(
        "slow_released", "relaxation", "of the change", "broken by releasing, healing slowly"
    )
    fast_stretched: float = _fitted(
        "fast_stretched", "relaxation", "of the change", "broken by stretching, healing fast"
    )
    fast_released: float = _fitted(
        "fast_released", "relaxation", "of the change", "broken by releasing, healing fast"
    )
    slow_rate: float = _fitted(
        "slow_rate", "relaxation", "1/s", "rate k of the slow healing", keep=True
    )
    fast_rate: float = _fitted(
        "fast_rate", "relaxation", "1/s", "rate k of the fast healing", keep=True
    )
    order: float = _fitted(
        "order", "relaxation", "1", "power n of time by which broken contacts heal", keep=True
    )
    softening: float = _fitted(
        "softening", "mullins", "1", "gain of the first stretch over later ones"
    )
    conditioning: float = _fitted(
        "conditioning", "mullins", "m", "travel that removes 63 % of the softening", keep=True
    )
    creep: float = _fitted("creep", "hysteresis", "1/s", "rate of the stops' way back", keep=True)
    recovery: float = assume(
        6.0, "mullins", "h", "time constant with which softening is forgotten", off=6.0
    )
    fresh: float = assume(0.01, "mullins", "1", "largest s of a new cord", off=0.01)
    fluctuation: float = _fitted(
        "fluctuation", "noise", "1", "1/f noise over the signal, standard deviation"
    )
    spread: float = _fitted(
        "spread", "spread", "1", "constants of pieces, standard deviation of their logarithm"
    )

    def draw(self, count: int, rng: np.random.Generator) -> Float:
        """Draw the constants (c, 12) of pieces of cord, log-normal around those of the cord."""
        constants = np.array([getattr(self, name) for name in CONSTANTS])
        deviation = rng.normal(size=(count, len(constants)))
        deviation = np.clip(deviation, -MAX_PIECE_DEVIATION, MAX_PIECE_DEVIATION)
        pieces: Float = constants * np.exp(self.spread * deviation)
        # An exponent has no scale: it differs by a sum instead.
        exponent = CONSTANTS.index("exponent")
        pieces[:, exponent] = constants[exponent] + self.spread * deviation[:, exponent]
        return pieces

    def new_state(self, count: int) -> tuple[Float, ...]:
        """Return the state of new cords: stops (k, c), y (2, c), q (c,) and m (c,)."""
        stops, broken = np.zeros((len(THRESHOLDS), count)), np.zeros((2, count))
        return stops, broken, np.zeros(count), np.full(count, self.fresh)

    def rest_state(self, state: tuple[Float, ...], hours: float) -> tuple[Float, ...]:
        """Return the state after hours at rest: contacts healed, softening partly forgotten."""
        stops, broken, q, m = state
        remaining = np.exp(-hours / self.recovery)
        seconds, rates = 3600 * hours, np.array([[self.slow_rate], [self.fast_rate]])
        healed = _heal(broken, m, rates, self.order, seconds)
        return _heal(stops, m, self.creep, self.order, seconds), healed, q * remaining, m

    def respond(
        self, time: Float, signals: Float, state: tuple[Float, ...], pieces: Float
    ) -> tuple[Float, tuple[Float, ...]]:
        """Return the responses (n, c) and the state at the last time.

        Args:
            time: Times (n,) s.
            signals: Ideal signals (n, c), (R - R0)/R0.
            state: The state at the first time.
            pieces: Constants (c, 12) of the pieces.
        """
        response, *end = respond(time, signals, *state, THRESHOLDS, pieces, self.creep)
        return response, tuple(end)

    def fluctuate(self, time: Float, response: Float, rng: np.random.Generator) -> Float:
        """Draw 1/f noise (n, c) that grows with the response."""
        step = np.diff(time, prepend=time[0])
        noise = np.zeros_like(response)
        for constant in FLUCTUATION_TIMES_S:
            noise += filter_noise(step, constant, rng.normal(size=response.shape))
        scale = self.fluctuation / np.sqrt(len(FLUCTUATION_TIMES_S))
        return np.asarray(scale * np.abs(response) * noise)


#: Names of the constants in which pieces of cord differ.
CONSTANTS = (
    "friction",
    "exponent",
    "release_ratio",
    "slow_stretched",
    "slow_released",
    "fast_stretched",
    "fast_released",
    "slow_rate",
    "fast_rate",
    "order",
    "softening",
    "conditioning",
)
MAX_STEP_S = 0.1  # longer steps are divided
MAX_STEP_SHARE = 0.05  # of the largest signal; larger changes are divided
MAX_DIVISIONS = 256  # of a step; healing after a longer pause is exact where s is constant


@compiled(error_model="numpy")
def _heal(y, m, rate, order, dt):  # type: ignore[no-untyped-def]
    """Return y after `dt` s at y' = -rate |y/m|^(1/order) y."""
    return y * (1 + rate * (np.abs(y) / m) ** (1 / order) * dt / order) ** (-order)


@compiled(error_model="numpy")
def respond(time, s, stops0, broken0, q0, m0, thresholds, pieces, creep):  # type: ignore[no-untyped-def]
    """Return a (n, c), and stops, y, q and m at the end.

    Args:
        time: Times (n,) s.
        s: Ideal signals (n, c), linear between samples.
        stops0: Stop operators (k, c).
        broken0: Broken contacts y (2, c).
        q0: Conditioning (c,).
        m0: Largest signals (c,).
        thresholds: Thresholds (k,) over m.
        pieces: Constants (c, 12), in the order of `CONSTANTS`.
        creep: Rate of the stop operators' way back, 1/s.
    """
    n, c = s.shape
    out = np.empty((n, c))
    stops, broken, q, m = stops0.copy(), broken0.copy(), q0.copy(), m0.copy()
    rates, torn_up, torn_down = np.empty(2), np.empty(2), np.empty(2)
    for j in range(c):
        (friction, exponent, ratio, torn_up[0], torn_down[0], torn_up[1], torn_down[1], rates[0],
         rates[1], order, softening, conditioning) = pieces[j]  # fmt: skip
        shares = thresholds**exponent
        shares *= friction / (shares * thresholds).sum()
        before = s[0, j]
        for i in range(n):
            whole = time[i] - time[i - 1] if i else 0.0
            travel = s[i, j] - before
            parts = max(np.ceil(abs(travel) / (MAX_STEP_SHARE * m[j])), 1.0)
            if travel != 0:
                parts = max(parts, np.ceil(whole / MAX_STEP_S))
            divisions = int(min(parts, MAX_DIVISIONS))
            change, dt = travel / divisions, whole / divisions
            for _ in range(divisions):
                before += change
                if abs(before) > m[j]:
                    q[j] *= m[j] / abs(before)
                    m[j] = abs(before)
                q[j] = 1 - (1 - q[j]) * np.exp(-abs(change) / (conditioning * m[j]))
                for k in range(len(thresholds)):
                    width = thresholds[k] * m[j]
                    z = min(max(stops[k, j] + change, -ratio * width), width)
                    stops[k, j] = _heal(z, m[j], creep, order, dt)
                for k in range(2):
                    # Half of the contacts break before the step's healing, half after it.
                    torn = 0.5 * (torn_up[k] * change if change > 0 else -torn_down[k] * change)
                    broken[k, j] = _heal(broken[k, j] + torn, m[j], rates[k], order, dt) + torn
            before = s[i, j]
            a = before * (1 + softening * (1 - q[j])) + broken[0, j] + broken[1, j]
            for k in range(len(thresholds)):
                a += shares[k] * stops[k, j]
            out[i, j] = a
    return out, stops, broken, q, m


@compiled(error_model="numpy")
def filter_noise(step, constant, normal):  # type: ignore[no-untyped-def]
    """Turn normal numbers (n, c) into an Ornstein-Uhlenbeck process of unit variance."""
    out = np.empty_like(normal)
    out[0] = normal[0]
    for i in range(1, len(normal)):
        remaining = np.exp(-step[i] / constant)
        out[i] = remaining * out[i - 1] + np.sqrt(1 - remaining * remaining) * normal[i]
    return out
