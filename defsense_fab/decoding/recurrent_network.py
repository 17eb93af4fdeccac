"""A small gated recurrent network over signals, as a memory that training shapes freely.

Exponential memories of `signal_history.py` are exact for cords that relax linearly. Other sensors
have hysteresis whose branches depend on where the signal turned. A gated recurrent unit learns what
to keep. Its state h is computed at the steps of a clock of its own, at

    r = sigmoid(W_r x + U_r h + b_r),  z = sigmoid(W_z x + U_z h + b_z)
    n = tanh(W_n x + b_n + r (U_n h + c_n)),  h' = (1 - z) n + z h

where x are the signals at the step, scaled and limited. All entries of h stay between -1 and 1,
whatever the signals are. The state is an input of a linear decoder like any other memory.

Before the first sample, and after a pause, the signals are taken to have been constant for
`WARM_UP_STEPS` steps.

References:
    Cho et al. 2014, Learning Phrase Representations using RNN Encoder-Decoder for Statistical
    Machine Translation (in the variant of cuDNN, in which r multiplies after the matrix).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.machine.compiled import compiled

#: Steps with the first signals before the first sample.
WARM_UP_STEPS = 100
#: Largest scaled signal; larger ones are cut.
MAX_INPUT = 4.0
_PAUSE_S = 60.0  # without a sample, after which the network starts afresh


@dataclass(frozen=True)
class RecurrentNetwork:
    """A gated recurrent unit with h states over c signals.

    Attributes:
        step: Time between its steps, s.
        middle: Signals (c,) that are an input of 0.
        spread: Change of the signals (c,) that is an input of 1.
        inputs: Weights (c, 3 h) of the inputs, for r, z and n.
        recurrent: Weights (h, 3 h) of the states.
        input_constants: Constants (3 h,) next to the inputs.
        state_constants: Constants (3 h,) next to the states.
    """

    step: float
    middle: Float
    spread: Float
    inputs: Float
    recurrent: Float
    input_constants: Float
    state_constants: Float

    @property
    def size(self) -> int:
        """Number of states h."""
        return len(self.recurrent)

    def __call__(self, time: Float, signals: Float) -> Float:
        """Return the states (n, h) at samples of the signals.

        Args:
            time: Times of the samples (n,), s.
            signals: Signals (n, c), linear between samples and over gaps.

        Returns:
            The states at the last step before each sample; NaN where a signal is NaN.
        """
        out = np.empty((len(time), self.size))
        stream = RecurrentStream(self)
        _run(
            np.ascontiguousarray(time, float),
            np.ascontiguousarray((signals - self.middle) / self.spread, float),
            stream.clock,
            stream.last,
            stream.state,
            self.step,
            self.inputs,
            self.recurrent,
            self.input_constants,
            self.state_constants,
            out,
        )
        return out


class RecurrentStream:
    """The state of a network, advanced one sample at a time.

    Args:
        network: The network.

    Attributes:
        clock: Time of the next step and of the last known sample (2,), s; NaN before the first.
        last: Scaled signals (c,) of the last known sample.
        state: The network's state (h,).
    """

    def __init__(self, network: RecurrentNetwork) -> None:
        self._network = network
        self.clock, self.last = np.full(2, np.nan), np.zeros(len(network.middle))
        self.state = np.zeros(network.size)

    def __call__(self, time: float, signals: Float) -> Float:
        """Return the states (h,) at a sample of the signals (c,); NaN if a signal is NaN."""
        network = self._network
        return np.asarray(
            _advance(
                time,
                (signals - network.middle) / network.spread,
                self.clock,
                self.last,
                self.state,
                network.step,
                network.inputs,
                network.recurrent,
                network.input_constants,
                network.state_constants,
            )
        )

    def reset(self) -> None:
        """Start afresh at the next sample."""
        self.clock[:] = np.nan


@compiled(error_model="numpy")
def _step(x, state, inputs, recurrent, input_constants, state_constants):  # type: ignore[no-untyped-def]
    """Advance `state` (h,) by one step with scaled signals x (c,)."""
    h = len(state)
    a, b = input_constants.copy(), state_constants.copy()
    for k in range(len(x)):
        value = min(max(x[k], -MAX_INPUT), MAX_INPUT)
        for j in range(3 * h):
            a[j] += value * inputs[k, j]
    for k in range(h):
        value = state[k]
        for j in range(3 * h):
            b[j] += value * recurrent[k, j]
    for j in range(h):
        r = 1 / (1 + np.exp(-a[j] - b[j]))
        z = 1 / (1 + np.exp(-a[h + j] - b[h + j]))
        n = np.tanh(a[2 * h + j] + r * b[2 * h + j])
        state[j] = (1 - z) * n + z * state[j]


@compiled(error_model="numpy")
def _advance(  # type: ignore[no-untyped-def]
    time, x, clock, last, state, step, inputs, recurrent, input_constants, state_constants
):
    """Run all steps up to a sample x (c,) at `time`, and return the states (h,)."""
    for k in range(len(x)):
        if not np.isfinite(x[k]):
            return np.full(len(state), np.nan)
    if not time - clock[1] <= _PAUSE_S:  # the first sample, or the first after a pause
        state[:] = 0.0
        for _ in range(WARM_UP_STEPS):
            _step(x, state, inputs, recurrent, input_constants, state_constants)
        clock[0] = time + step
    else:
        span = time - clock[1]
        while clock[0] <= time:
            share = (clock[0] - clock[1]) / span if span > 0 else 1.0
            _step(
                last + share * (x - last),
                state,
                inputs,
                recurrent,
                input_constants,
                state_constants,
            )
            clock[0] += step
    clock[1] = time
    last[:] = x
    return state.copy()


@compiled(error_model="numpy")
def _run(  # type: ignore[no-untyped-def]
    time, x, clock, last, state, step, inputs, recurrent, input_constants, state_constants, out
):
    for i in range(len(time)):
        out[i] = _advance(
            time[i],
            x[i],
            clock,
            last,
            state,
            step,
            inputs,
            recurrent,
            input_constants,
            state_constants,
        )
