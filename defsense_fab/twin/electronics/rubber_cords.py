"""Cords of carbon-filled rubber: another family of models than what decoders of readings assume.

A cord's answer to its ideal signal s = (R - R0)/R0 without memory is

    a = gain (s (1 + mu phi(s/m)) + c z + y_1 + y_2 + y_3).

- y_i, resistance that stretching adds, as stress is in the elements of a generalised Maxwell model
  whose dashpots flow by a power of it (Bergstroem & Boyce 1998 for filled rubber):
      y' = b (1 + g s+) (s'+ + u s'-) - (y/T) h (1 + (y/y_c)^2),
  where letting go tears less (u), and the network heals slower while it is stretched and faster
  while it is let go (h). No linear filter of the signal does that, nor of its rate.
- z, friction between the filler's aggregates: z' = s' - |s'| z/w, an endochronic element, with a
  width w for stretching and another one for letting go.
- m, the largest s so far: up to it the cord has been softened (Mullins 1948; phi(r) = r^2 joins the
  first curve at m), beyond it not yet; it is forgotten slowly.

R = R0 (1 + drift) (1 + alpha dT) (1 + ageing) (1 + a) + joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ..scenes.assumptions import assume

_SHEET = (
    "chosen to agree with a supplier's data sheet (Images Scientific, stretch sensor, also the"
    " paper's): released after a stretch of 50 % R falls to about +10 % of R0 and then decays"
)
_MINUTES = "chosen to agree with sellers of 2 mm cord: a minute or two to recover"
_DRIFTS = "assumed; users: old cord drifts (5 to 13.5 kohm in one report)"
_TCR = (
    "assumed; published: near 0 (grafted black, J. Soc. Mater. Sci. Japan 25, 1005, 1976) to 0.07/K"
    " (styrene-butadiene with 50 phr of HAF black)"
)


@dataclass(frozen=True)
class RubberTraits:
    """What pieces of one cord have in common. Signals are those of (R - R0)/R0, times s."""

    tear: tuple[float, ...] = assume(
        (0.06, 0.05, 0.05), "relaxation", "of the change",
        "added by stretching in each element, that heals", _SHEET, off=(0.0, 0.0, 0.0),
    )  # fmt: skip
    times: tuple[float, ...] = assume(
        (0.4, 5.0, 50.0), "relaxation", "s", "healing of each element, held still", _MINUTES,
        off=(1.0, 1.0, 1.0),
    )  # fmt: skip
    steeper: float = assume(
        1.0, "relaxation", "1", "how much more is torn at s = 1 than near rest", off=0.0
    )
    released: float = assume(
        0.6, "relaxation", "1", "torn by letting go, relative to stretching", _SHEET
    )
    heal_stretched: float = assume(
        0.5, "relaxation", "1", "healing while it is stretched, relative to held still", off=1.0
    )
    heal_released: float = assume(
        1.8, "relaxation", "1", "healing while it is let go, relative to held still", off=1.0
    )
    turn: float = assume(
        0.02,
        "relaxation",
        "1/s",
        "rate of s at which that has come about by three quarters",
        off=1.0,
    )
    flow: float = assume(
        0.03, "relaxation", "1", "y at which the dashpots flow twice as fast", off=1e9
    )
    friction: float = assume(0.12, "hysteresis", "1", "share c of the friction elements")
    width_stretched: float = assume(
        0.05, "hysteresis", "1", "change of s that friction needs to build up, stretching", off=1.0
    )
    width_released: float = assume(0.03, "hysteresis", "1", "the same, letting go", off=1.0)
    mullins: float = assume(
        0.12, "mullins", "1", "mu, gain of the first stretch over later ones; that it is there:"
        " Mullins 1948 for stress; its size in resistance"
    )  # fmt: skip
    fresh: float = assume(0.01, "mullins", "1", "largest s of a cord as it is laid", off=0.01)
    recovery: float = assume(6.0, "mullins", "h", "by which softening is forgotten", off=6.0)
    drift_walk: float = assume(
        0.004, "drift", "1/sqrt(h)", "random walk of R0, standard deviation", _DRIFTS
    )
    drift_trend: float = assume(
        0.006, "drift", "1/h", "steady drift of R0, standard deviation over pieces", _DRIFTS
    )
    per_kelvin: float = assume(0.003, "temperature", "1/K", "alpha, the same of all pieces", _TCR)
    warming: float = assume(2.0, "temperature", "K", "warms up in a session, by half in 20 min")
    breeze: float = assume(0.3, "temperature", "K", "slow ups and downs, standard deviation")
    ageing: float = assume(
        0.004, "ageing", "1/day", "rise of R0 since the device was made", _DRIFTS
    )
    stiffening: float = assume(0.002, "ageing", "1/day", "loss of gain since then")
    ohm_spread: float = assume(
        0.06, "spread", "1", "R0 of pieces of one length, standard deviation",
        "sellers: 130-160 ohm/cm, batches differ",
    )  # fmt: skip
    jitter_time: float = assume(0.3, "contact", "s", "by which the joints' resistances change",
                                 off=1.0)  # fmt: skip
    contact: float = assume(
        1.0, "contact", "ohm", "standard deviation of each of two joints", "data/cords.csv"
    )
    noise: float = assume(
        0.002, "noise", "1", "of one reading of (R - R0)/R0, white", "data/cords.csv"
    )


@dataclass(frozen=True)
class RubberState:
    """Of c cords: `y` (3, c), `z` (c,), `m` (c,), and R0's drift so far (c,)."""

    y: Float
    z: Float
    m: Float
    drift: Float

    @classmethod
    def new(cls, traits: RubberTraits, count: int) -> RubberState:
        """As they are laid."""
        return cls(
            np.zeros((len(traits.tear), count)), np.zeros(count), np.full(count, traits.fresh),
            np.zeros(count),
        )  # fmt: skip

    def rested(self, traits: RubberTraits, hours: float) -> RubberState:
        """After so many hours at rest: healed, softening partly forgotten, friction as it was."""
        keep = np.exp(-hours / traits.recovery)
        return replace(
            self, y=np.zeros_like(self.y), m=traits.fresh + keep * (self.m - traits.fresh)
        )


@dataclass(frozen=True)
class RubberPieces:
    """c pieces of cord of resistances `ohm` (c,), their steady `trend` (c,) of R0, 1/h, and the
    device's `age`, days."""

    traits: RubberTraits
    ohm: Float
    trend: Float
    age: float = 0.0

    @classmethod
    def drawn(cls, traits: RubberTraits, nominal: Float, rng: np.random.Generator) -> RubberPieces:
        """Pieces of `nominal` (c,) ohm, each its own. All that is drawn is drawn with any traits,
        so that switching one off leaves the others as they were."""
        apart, trend = rng.normal(size=(2, len(nominal)))
        return cls(traits, nominal * (1 + traits.ohm_spread * apart), traits.drift_trend * trend)

    def resistances(
        self, time: Float, signals: Float, state: RubberState, rng: np.random.Generator
    ) -> tuple[Float, RubberState]:
        """Ohm (n, c) at times (n,) s of ideal signals (n, c), and how the cords are then."""
        t = self.traits
        answer, y, z, m = _answers(
            np.ascontiguousarray(time, float), np.ascontiguousarray(signals, float), state.y,
            state.z, state.m, np.array(t.tear), np.array(t.times), t.steeper, t.released,
            t.heal_stretched, t.heal_released, t.turn, t.flow, t.friction, t.width_stretched,
            t.width_released, t.mullins, t.fresh, 3600 * t.recovery,
        )  # fmt: skip
        n, c = signals.shape
        step = np.diff(time, prepend=time[0])[:, None]
        walk = t.drift_walk * np.sqrt(step / 3600) * rng.normal(size=(n, c))
        drift = state.drift + np.cumsum(walk + self.trend * step / 3600, axis=0)
        kelvin = t.per_kelvin * self._kelvin(time, rng)[:, None]
        aged, gain = t.ageing * self.age, 1 - t.stiffening * self.age
        noise = t.noise * rng.normal(size=(n, c))
        shakes = _jitter(step[:, 0], t.jitter_time, rng.normal(size=(n, c)))
        ohm = self.ohm * (1 + drift) * (1 + kelvin) * (1 + aged) * (1 + gain * answer + noise)
        return ohm + np.sqrt(2) * t.contact * shakes, RubberState(y, z, m, drift[-1])

    def _kelvin(self, time: Float, rng: np.random.Generator) -> Float:
        """Temperatures (n,) above that at the start."""
        t, since = self.traits, time - time[0]
        slow = rng.uniform(300, 1200, 3), rng.uniform(0, 2 * np.pi, 3)
        waves = np.sin(2 * np.pi * since[:, None] / slow[0] + slow[1]) - np.sin(slow[1])
        warm = t.warming * (1 - 0.5 ** (since / 1200))
        return np.asarray(warm + t.breeze * np.sqrt(2 / 3) * waves.sum(1))


@compiled(error_model="numpy")
def _answers(  # type: ignore[no-untyped-def]
    time, s, y0, z0, m0, tear, times, steeper, released, heal_stretched, heal_released, turn, flow,
    friction, width_stretched, width_released, mullins, fresh, recovery,
):  # fmt: skip
    """a (n, c) without gain, and y, z, m at the end. Exact for healing and friction of a signal
    that runs straight between samples, but for h and the flow's speed, which are the step's
    first."""
    n, c = s.shape
    out = np.empty((n, c))
    y, z, m = y0.copy(), z0.copy(), m0.copy()
    for j in range(c):
        before = s[0, j]
        for i in range(n):
            now = s[i, j]
            dt = time[i] - time[i - 1] if i else 0.0
            change = now - before
            if dt > 0:
                rate = change / dt
                sign = np.tanh(rate / turn)
                heal = (
                    1 + (heal_stretched - 1) * sign if sign > 0 else 1 - (heal_released - 1) * sign
                )
                torn = rate if rate > 0 else -released * rate
                torn *= 1 + steeper * max(before, 0.0)
                for k in range(len(tear)):
                    within = times[k] / (heal * (1 + (y[k, j] / flow) ** 2))
                    keep = np.exp(-dt / within)
                    y[k, j] = y[k, j] * keep + tear[k] * torn * within * (1 - keep)
                m[j] = fresh + (m[j] - fresh) * np.exp(-dt / recovery)
            way = 1.0 if change > 0 else -1.0
            width = way * (width_stretched if change > 0 else width_released)
            z[j] = width + (z[j] - width) * np.exp(-change / width)
            m[j] = max(m[j], now)
            part = max(now, 0.0) / m[j]
            a = now * (1 + mullins * part * part) + friction * z[j]
            for k in range(len(tear)):
                a += y[k, j]
            out[i, j] = a
            before = now
    return out, y, z, m


@compiled(error_model="numpy")
def _jitter(step, within, normal):  # type: ignore[no-untyped-def]
    """An Ornstein-Uhlenbeck process (n, c) of unit variance, from `normal` numbers."""
    out = np.empty_like(normal)
    out[0] = normal[0]
    for i in range(1, len(normal)):
        keep = np.exp(-step[i] / within)
        out[i] = keep * out[i - 1] + np.sqrt(1 - keep * keep) * normal[i]
    return out


# Kinds of cords that the paper compares, as the twin has them: what is assumed of each.


@dataclass(frozen=True)
class CordKind:
    """By a `title`, what is `assumed` of it in words, and the `traits` of its rubber."""

    title: str
    assumed: str
    traits: RubberTraits


CORD_KINDS = {
    "ecord": CordKind(
        "ready-made conductive rubber cord",
        "the cord of defsense twin: a stretch adds resistance that heals within a minute, friction"
        " takes 12 % of a change, and the first stretch answers by 12 % more (docs/twin.md)",
        RubberTraits(),
    ),
    "etpu": CordKind(
        "printed conductive TPU filament",
        "the same model, with ten times the resistance that a stretch adds and that heals, four"
        " times the friction and five times the softening: chosen to look in kind as the paper's"
        " Fig. 10 does, which gives no numbers",
        RubberTraits(tear=(0.6, 0.5, 0.5), flow=0.3, friction=0.48, mullins=0.6),
    ),
}
