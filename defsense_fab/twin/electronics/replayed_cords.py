"""The cords of a run that was simulated before, as the read-out board's twin reads them: forth and
back without end, and with what can go wrong with cords and plugs."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

CUT, SHORT, STUCK, SWAP = "cut", "short", "stuck", "swap"
FAULT_KINDS = (CUT, SHORT, STUCK, SWAP)
_OPEN, _CLOSED = 1e9, 1e-3  # ohm


@dataclass(frozen=True)
class CordFault:
    """What happens to `channels` (by index: two that are swapped, else one) from `begin` to `end`,
    s. What is stuck stays at what it was."""

    kind: str
    channels: tuple[int, ...]
    begin: float
    end: float = np.inf


class ReplayedCords:
    """Resistances `ohm` (n, c) at times (n,) s from 0 on, linear between."""

    def __init__(
        self, channels: tuple[str, ...], time: Float, ohm: Float,
        faults: tuple[CordFault, ...] = (),
    ) -> None:  # fmt: skip
        self.channels = channels
        self.rest = ohm[: max(len(ohm) // 200, 1)].mean(axis=0)
        self.now = 0.0
        self._time, self._ohm = time, ohm
        self._lock = threading.Lock()
        self._faults = list(faults)

    @property
    def cords(self) -> ReplayedCords:
        """As a specimen has them."""
        return self

    def fail(self, kind: str, channels: tuple[int, ...], seconds: float = np.inf) -> None:
        """From now on, for so many s."""
        with self._lock:
            self._faults.append(CordFault(kind, channels, self.now, self.now + seconds))

    def mend(self) -> None:
        """Everything, now."""
        with self._lock:
            self._faults = []

    def hold(self, duration: float, rate: float) -> tuple[Float, Float]:
        """Go on for `duration` s and read at `rate` Hz: times (t,) s, resistances (t, c) ohm."""
        count = max(round(duration * rate), 1)
        step = duration / count
        at = np.asarray(self.now + step * np.arange(1, count + 1), float)
        self.now = float(at[-1])
        return np.asarray(at - at[0] + step, float), self.at(at)

    def at(self, seconds: Float) -> Float:
        """(t, c) ohm at times (t,) s."""
        out = self._played(seconds)
        with self._lock:
            faults = list(self._faults)
        for fault in faults:
            on = (seconds >= fault.begin) & (seconds < fault.end)
            if not on.any():
                continue
            which = np.array(fault.channels)
            now = out[on]
            if fault.kind == SWAP:
                now[:, which] = now[:, which[::-1]]
            elif fault.kind == STUCK:
                now[:, which] = self._played(np.array([fault.begin]))[0, which]
            else:
                now[:, which] = _OPEN if fault.kind == CUT else _CLOSED
            out[on] = now
        return out

    def _played(self, seconds: Float) -> Float:
        last = float(self._time[-1])
        there = np.mod(seconds, 2 * last)
        when = np.where(there > last, 2 * last - there, there)
        return np.stack([np.interp(when, self._time, c) for c in self._ohm.T], axis=1)
