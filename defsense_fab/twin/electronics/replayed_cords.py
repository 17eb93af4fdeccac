"""Cords that replay a simulated recording, with faults of cords and plugs."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

CUT, SHORT, STUCK, SWAP = "cut", "short", "stuck", "swap"
FAULT_KINDS = (CUT, SHORT, STUCK, SWAP)
OPEN_OHM, SHORTED_OHM = 1e9, 1e-3
REST_SHARE = 200  # the first 1/200 of a recording is at rest


@dataclass(frozen=True)
class CordFault:
    """A fault of cords or plugs.

    Attributes:
        kind: `cut`, `short`, `stuck` (the reading stays as it was at the start) or `swap`.
        channels: Indices of the channels: two for `swap`, else one.
        begin: Start, s.
        end: End, s.
    """

    kind: str
    channels: tuple[int, ...]
    begin: float
    end: float = np.inf


class ReplayedCords:
    """Cords that repeat a recording forwards and backwards without end.

    Args:
        channels: Names of the channels (c).
        time: Times of the recording (n,) s, from 0 on.
        ohm: Resistances (n, c) ohm; interpolated linearly.
        faults: Faults by time.

    Attributes:
        rest: Resistances at rest (c,) ohm.
        time: Time since the start, s.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        time: Float,
        ohm: Float,
        faults: tuple[CordFault, ...] = (),
    ) -> None:
        self.channels = channels
        self.rest = ohm[: max(len(ohm) // REST_SHARE, 1)].mean(axis=0)
        self.time = 0.0
        self._recorded_time, self._recorded_ohm = time, ohm
        self._lock = threading.Lock()
        self._faults = list(faults)

    def add_fault(self, kind: str, channels: tuple[int, ...], seconds: float = np.inf) -> None:
        """Add a fault that starts now and lasts for `seconds`."""
        with self._lock:
            self._faults.append(CordFault(kind, channels, self.time, self.time + seconds))

    def clear_faults(self) -> None:
        """Remove all faults now."""
        with self._lock:
            self._faults = []

    def measure(self, duration: float, rate: float) -> tuple[Float, Float]:
        """Continue the replay and measure.

        Args:
            duration: Duration, s.
            rate: Sample rate, Hz.

        Returns:
            Times (t,) s from now on, and resistances (t, c) ohm.
        """
        count = max(round(duration * rate), 1)
        step = duration / count
        times = np.asarray(self.time + step * np.arange(1, count + 1), float)
        self.time = float(times[-1])
        return np.asarray(times - times[0] + step, float), self.resistances_at(times)

    def resistances_at(self, times: Float) -> Float:
        """Return the resistances (t, c) ohm at times (t,) s, with the faults."""
        ohm = self._replay(times)
        with self._lock:
            faults = list(self._faults)
        for fault in faults:
            is_active = (times >= fault.begin) & (times < fault.end)
            if not is_active.any():
                continue
            channels = np.array(fault.channels)
            rows = ohm[is_active]
            if fault.kind == SWAP:
                rows[:, channels] = rows[:, channels[::-1]]
            elif fault.kind == STUCK:
                rows[:, channels] = self._replay(np.array([fault.begin]))[0, channels]
            else:
                rows[:, channels] = OPEN_OHM if fault.kind == CUT else SHORTED_OHM
            ohm[is_active] = rows
        return ohm

    def _replay(self, times: Float) -> Float:
        end = float(self._recorded_time[-1])
        phase = np.mod(times, 2 * end)
        position = np.where(phase > end, 2 * end - phase, phase)
        columns = [np.interp(position, self._recorded_time, c) for c in self._recorded_ohm.T]
        return np.stack(columns, axis=1)
