"""Pieces of cord of carbon-filled rubber, and printed traces, with one of the families of memories.

`HystereticMemory` and `ContactNetwork`, the default of printed traces, are fitted to published
recordings (see their modules). `MemoryTraits`, the default of cords, has assumed numbers. It is
nonlinear, but made of relaxing elements, as the decoders assume. Its response to the ideal signal
s = (R - R0)/R0 without memory is

    a = gain (s (1 + mu phi(s/m)) + c z + y_1 + y_2 + y_3).

- y_i is resistance that stretching adds, like the stress in the elements of a generalized Maxwell
  model whose dashpots flow by a power of it (Bergstroem & Boyce 1998 for filled rubber):

      y' = b (1 + g s+) (s'+ + u s'-) - (y/T) h (1 + (y/y_c)^2)

  Releasing tears less (u), and the network heals slower while it is stretched and faster while it
  is released (h). No linear filter of the signal or of its rate does that.
- z is friction between the filler's aggregates: z' = s' - |s'| z/w, an endochronic element, with
  one width w for stretching and another for releasing.
- m is the largest s so far. Up to m the cord has been softened (Mullins 1948; phi(r) = r^2 joins
  the first curve at m), beyond m it has not. m is forgotten slowly.

The resistance is R = R0 (1 + drift) (1 + alpha dT) (1 + ageing) (1 + a) + joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field, replace
from typing import get_args

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from ..options import CordFamilyName
from ..scenes.assumptions import assume
from .contact_network import ContactNetwork
from .hysteretic_memory import HystereticMemory, filter_noise

_DATA_SHEET = (
    "chosen to agree with a supplier's data sheet (Images Scientific, stretch sensor, also the"
    " paper's): released after a stretch of 50 % R falls to about +10 % of R0 and then decays"
)
_SELLERS = "chosen to agree with sellers of 2 mm cord: a minute or two to recover"
_USERS = "assumed; users: old cord drifts (5 to 13.5 kohm in one report)"
_LITERATURE = (
    "assumed; published: near 0 (grafted black, J. Soc. Mater. Sci. Japan 25, 1005, 1976) to 0.07/K"
    " (styrene-butadiene with 50 phr of HAF black)"
)
_CORD_TABLE = "data/cords.csv, for printed traces data/traces.csv"
WARMING_HALF_TIME_S = 1200  # 20 min
BREEZE_PERIODS_S = (300, 1200)  # range of the periods of slow temperature changes


@dataclass(frozen=True)
class MemoryTraits:
    """Assumptions on the memory of a cord: relaxation, hysteresis and softening.

    The declaration of each field states its unit, meaning and source. Signals are (R - R0)/R0.
    `_respond` reads the fields in this order.
    """

    tear: tuple[float, ...] = assume(
        (0.06, 0.05, 0.05),
        "relaxation",
        "of the change",
        "resistance that stretching adds in each element, and that heals",
        _DATA_SHEET,
        off=(0.0, 0.0, 0.0),
    )
    times: tuple[float, ...] = assume(
        (0.4, 5.0, 50.0),
        "relaxation",
        "s",
        "time constants of the healing of each element, held still",
        _SELLERS,
        off=(1.0, 1.0, 1.0),
    )
    steeper: float = assume(
        1.0, "relaxation", "1", "how much more is torn at s = 1 than near rest", off=0.0
    )
    released: float = assume(
        0.6, "relaxation", "1", "torn by releasing, relative to stretching", _DATA_SHEET
    )
    heal_stretched: float = assume(
        0.5, "relaxation", "1", "rate of healing while stretched, relative to held still", off=1.0
    )
    heal_released: float = assume(
        1.8, "relaxation", "1", "rate of healing while released, relative to held still", off=1.0
    )
    turn: float = assume(
        0.02,
        "relaxation",
        "1/s",
        "rate of s at which three quarters of the change of healing are reached",
        off=1.0,
    )
    flow: float = assume(
        0.03, "relaxation", "1", "y at which the dashpots flow twice as fast", off=1e9
    )
    friction: float = assume(0.12, "hysteresis", "1", "share c of the friction elements")
    width_stretched: float = assume(
        0.05, "hysteresis", "1", "change of s in which friction builds up, stretching", off=1.0
    )
    width_released: float = assume(
        0.03, "hysteresis", "1", "change of s in which friction builds up, releasing", off=1.0
    )
    mullins: float = assume(
        0.12,
        "mullins",
        "1",
        "mu, gain of the first stretch over later ones; the effect is known for stress (Mullins"
        " 1948), its size in resistance is not",
    )
    fresh: float = assume(0.01, "mullins", "1", "largest s of a new cord", off=0.01)
    recovery: float = assume(
        6.0, "mullins", "h", "time constant with which softening is forgotten", off=6.0
    )

    def draw(self, count: int, rng: np.random.Generator) -> Float:  # noqa: ARG002 - draws none
        """Return no constants (c, 0): pieces of cord have the same memory."""
        return np.empty((count, 0))

    def new_state(self, count: int) -> tuple[Float, ...]:
        """Return the state of new cords: torn resistances y (k, c), friction z (c,), and m (c,)."""
        return np.zeros((len(self.tear), count)), np.zeros(count), np.full(count, self.fresh)

    def rest_state(self, state: tuple[Float, ...], hours: float) -> tuple[Float, ...]:
        """Return the state after hours at rest: healed, softening partly forgotten.

        Friction stays as it was.
        """
        y, z, m = state
        remaining = np.exp(-hours / self.recovery)
        return np.zeros_like(y), z, self.fresh + remaining * (m - self.fresh)

    def respond(
        self,
        time: Float,
        signals: Float,
        state: tuple[Float, ...],
        pieces: Float,  # noqa: ARG002 - pieces do not differ
    ) -> tuple[Float, tuple[Float, ...]]:
        """Return the responses (n, c) and the state at the last time.

        Args:
            time: Times (n,) s.
            signals: Ideal signals (n, c), (R - R0)/R0.
            state: The state at the first time.
            pieces: Not used.
        """
        response, *end = _respond(time, signals, *state, astuple(self))
        return response, tuple(end)

    def fluctuate(
        self,
        time: Float,  # noqa: ARG002
        response: Float,  # noqa: ARG002
        rng: np.random.Generator,  # noqa: ARG002
    ) -> float:
        """Return no additional noise."""
        return 0.0


#: A memory of cords or printed traces.
Memory = MemoryTraits | HystereticMemory | ContactNetwork
#: The families of memories by their names.
CORD_FAMILIES: dict[CordFamilyName, Callable[[], Memory]] = {
    "viscoelastic": MemoryTraits,
    "hysteretic": HystereticMemory,
    "network": ContactNetwork,
}
assert set(CORD_FAMILIES) == set(get_args(CordFamilyName))


@dataclass(frozen=True)
class RubberTraits:
    """Assumptions on what pieces of one cord have in common.

    The declaration of each field states its unit, meaning and source.

    Attributes:
        memory: Relaxation, hysteresis and softening, of one of the families.
    """

    memory: Memory = field(default_factory=MemoryTraits)
    drift_walk: float = assume(
        0.004, "drift", "1/sqrt(h)", "random walk of R0, standard deviation", _USERS
    )
    drift_trend: float = assume(
        0.006, "drift", "1/h", "steady drift of R0, standard deviation over pieces", _USERS
    )
    per_kelvin: float = assume(
        0.003, "temperature", "1/K", "alpha, the same for all pieces", _LITERATURE
    )
    warming: float = assume(
        2.0, "temperature", "K", "warming in a session, half of it in 20 minutes"
    )
    breeze: float = assume(0.3, "temperature", "K", "slow fluctuations, standard deviation")
    ageing: float = assume(0.004, "ageing", "1/day", "rise of R0 since the device was made", _USERS)
    stiffening: float = assume(0.002, "ageing", "1/day", "loss of gain since then")
    ohm_spread: float = assume(
        0.06,
        "spread",
        "1",
        "R0 of pieces of one length, standard deviation",
        "sellers: 130-160 ohm/cm, batches differ; for printed traces data/traces.csv",
    )
    jitter_time: float = assume(
        0.3, "contact", "s", "time constant of the joints' resistances", off=1.0
    )
    contact: float = assume(
        1.0, "contact", "ohm", "standard deviation of each of two joints", _CORD_TABLE
    )
    noise: float = assume(
        0.002, "noise", "1", "white noise of one reading of (R - R0)/R0", _CORD_TABLE
    )


@dataclass(frozen=True)
class RubberState:
    """The state of c cords.

    Attributes:
        memory: State of the memory: what `new_state` of its family returns.
        drift: Relative drift of R0 so far (c,).
    """

    memory: tuple[Float, ...]
    drift: Float

    @classmethod
    def new(cls, traits: RubberTraits, count: int) -> RubberState:
        """Return the state of `count` new cords."""
        return cls(traits.memory.new_state(count), np.zeros(count))

    def after_rest(self, traits: RubberTraits, hours: float) -> RubberState:
        """Return the state after hours at rest."""
        return replace(self, memory=traits.memory.rest_state(self.memory, hours))


@dataclass(frozen=True)
class RubberPieces:
    """c pieces of cord.

    Attributes:
        traits: What they have in common.
        ohm: Resistances at rest (c,) ohm.
        trend: Steady relative drift of R0 (c,) per hour.
        constants: In what the memories of the pieces differ (c, p).
        age: Age of the device, days.
    """

    traits: RubberTraits
    ohm: Float
    trend: Float
    constants: Float
    age: float = 0.0

    @classmethod
    def draw(cls, traits: RubberTraits, nominal: Float, rng: np.random.Generator) -> RubberPieces:
        """Draw pieces of nominal resistances (c,) ohm.

        The same numbers are drawn with any traits: disabling one leaves the others as they were.
        """
        deviation, trend = rng.normal(size=(2, len(nominal)))
        ohm = nominal * (1 + traits.ohm_spread * deviation)
        constants = traits.memory.draw(len(nominal), rng)
        return cls(traits, ohm, traits.drift_trend * trend, constants)

    def respond(
        self, time: Float, signals: Float, memory: tuple[Float, ...]
    ) -> tuple[Float, tuple[Float, ...]]:
        """Return the relative changes of the resistances (n, c), and the memory at the last time.

        Args:
            time: Times (n,) s.
            signals: Ideal signals (n, c), (R - R0)/R0.
            memory: The memory at the first time.
        """
        response, memory = self.traits.memory.respond(
            np.ascontiguousarray(time, float),
            np.ascontiguousarray(signals, float),
            memory,
            self.constants,
        )
        return (1 - self.traits.stiffening * self.age) * response, memory

    def simulate(
        self, time: Float, signals: Float, state: RubberState, rng: np.random.Generator
    ) -> tuple[Float, RubberState]:
        """Simulate the resistances.

        Args:
            time: Times (n,) s.
            signals: Ideal signals (n, c), (R - R0)/R0.
            state: The state at the first time.
            rng: Random generator.

        Returns:
            Resistances (n, c) ohm, and the state at the last time.
        """
        t = self.traits
        response, memory = self.respond(time, signals, state.memory)
        n, c = signals.shape
        step = np.diff(time, prepend=time[0])[:, None]
        walk = t.drift_walk * np.sqrt(step / 3600) * rng.normal(size=(n, c))
        drift = state.drift + np.cumsum(walk + self.trend * step / 3600, axis=0)
        thermal = t.per_kelvin * self._draw_warming(time, rng)[:, None]
        aged = t.ageing * self.age
        noise = t.noise * rng.normal(size=(n, c))
        jitter = filter_noise(step[:, 0], t.jitter_time, rng.normal(size=(n, c)))
        noise += t.memory.fluctuate(time, response, rng)
        ohm = self.ohm * (1 + drift) * (1 + thermal) * (1 + aged) * (1 + response + noise)
        return ohm + np.sqrt(2) * t.contact * jitter, RubberState(memory, drift[-1])

    def _draw_warming(self, time: Float, rng: np.random.Generator) -> Float:
        """Draw the temperatures (n,) K above that at the start."""
        t, elapsed = self.traits, time - time[0]
        period, phase = rng.uniform(*BREEZE_PERIODS_S, 3), rng.uniform(0, 2 * np.pi, 3)
        waves = np.sin(2 * np.pi * elapsed[:, None] / period + phase) - np.sin(phase)
        warming = t.warming * (1 - 0.5 ** (elapsed / WARMING_HALF_TIME_S))
        return np.asarray(warming + t.breeze * np.sqrt(2 / 3) * waves.sum(1))


@compiled(error_model="numpy")
def _respond(time, s, y0, z0, m0, memory):  # type: ignore[no-untyped-def]
    """Return a (n, c) without the gain, and y, z and m at the end.

    Healing and friction are exact for signals that are linear between samples, except that h and
    the speed of the flow are those at the start of each step.
    """
    (tear, times, steeper, released, heal_stretched, heal_released, turn, flow, friction,
     width_stretched, width_released, mullins, fresh, recovery_h) = memory  # fmt: skip
    n, c = s.shape
    recovery = 3600 * recovery_h
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
                    constant = times[k] / (heal * (1 + (y[k, j] / flow) ** 2))
                    remaining = np.exp(-dt / constant)
                    y[k, j] = y[k, j] * remaining + tear[k] * torn * constant * (1 - remaining)
                m[j] = fresh + (m[j] - fresh) * np.exp(-dt / recovery)
            direction = 1.0 if change > 0 else -1.0
            width = direction * (width_stretched if change > 0 else width_released)
            z[j] = width + (z[j] - width) * np.exp(-change / width)
            m[j] = max(m[j], now)
            share = max(now, 0.0) / m[j]
            a = now * (1 + mullins * share * share) + friction * z[j]
            for k in range(len(tear)):
                a += y[k, j]
            out[i, j] = a
            before = now
    return out, y, z, m


@dataclass(frozen=True)
class CordKind:
    """A kind of cord that the paper compares, as it is simulated.

    Attributes:
        title: Name of the kind.
        assumed: What is assumed of it, in words.
        traits: Its properties.
    """

    title: str
    assumed: str
    traits: RubberTraits


CORD_KINDS = {
    "ecord": CordKind(
        "ready-made conductive rubber cord",
        "the cord of defsense twin: a stretch adds resistance that heals within a minute, friction"
        " takes 12 % of a change, and the first stretch responds by 12 % more"
        " (docs/twin-assumptions.md)",
        RubberTraits(),
    ),
    "etpu": CordKind(
        "printed conductive TPU filament",
        "the same model, with ten times the resistance that a stretch adds and that heals, four"
        " times the friction and five times the softening: chosen to look similar to the paper's"
        " Fig. 10, which gives no numbers",
        RubberTraits(MemoryTraits(tear=(0.6, 0.5, 0.5), flow=0.3, friction=0.48, mullins=0.6)),
    ),
}
