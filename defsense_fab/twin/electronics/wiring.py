"""The wires between cords, reference resistors and converter, with faults at the circuit's level.

Each pin is connected to the supply through its reference resistor, to ground through its wire and
its cord, and possibly to other pins. The voltages of the pins solve Kirchhoff's law; induced
voltages and the converter's noise are added to every single conversion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...sensing.serial_frames import MAX_COUNT, NOT_READ
from ...sensing.voltage_divider import conversion_time
from .cords import CUT, FAULT_KINDS, OPEN_OHM, SHORT, STUCK, SWAP, CordFault

BRIDGE, LOOSE, HUM_50, HUM_60 = "bridge", "loose", "hum50", "hum60"
NOISE, REFERENCE, SUPPLY, SERIES, UNREAD = "noise", "reference", "supply", "series", "unread"
#: Usual sizes of the faults that wires can have, in addition to those of cords: resistance between
#: two pins, ohm; resistance of a contact that opens while its wire moves, ohm; amplitudes of an
#: induced voltage, mV; standard deviation of a noise voltage, mV; actual reference resistor over
#: the assumed one; actual supply over the assumed one; additional resistance, ohm.
USUAL_AMOUNTS = {
    BRIDGE: 0.5,
    LOOSE: 200.0,
    HUM_50: 20.0,
    HUM_60: 20.0,
    NOISE: 30.0,
    REFERENCE: 10.0,
    SUPPLY: 1.5,
    SERIES: 600.0,
    UNREAD: 1.0,
}
WIRING_KINDS = (*(k for k in FAULT_KINDS if k != STUCK), *USUAL_AMOUNTS)
#: A short circuit goes through wires and plugs of this resistance, ohm.
_SHORT_OHM = 0.3
#: Rates at which a loose contact opens and closes, 1/s: while its wire moves, and at rest.
_MOVING_RATE_HZ, _RESTING_RATE_HZ = 12.0, 0.02
_JOINT_TIME_S = 0.15  # time constant of joints whose wire is moved
_SUPPLY_MV = {0: 5000.0, 1: 3300.0}  # by converter
_CONVERTER_NOISE = 0.5  # standard deviation of one conversion, counts (as in `BoardTraits`)
_HARMONIC_SHARE = 0.3  # of twice the mains' frequency in a hum


@dataclass(frozen=True)
class WiringTraits:
    """Properties of a board and its wires.

    Attributes:
        converter: Converter, 0 or 1, as in `Info`.
        full_scale: Counts at the supply's nominal voltage.
        reference: Nominal reference resistors (c,), ohm.
        contact: Standard deviation of the resistance of a joint whose wire is moved, ohm.
        supply: Actual supply over the nominal one; a converter that is supplied with the dividers
            does not see it.
        clock: Mains' frequency as the board's clock shows it, relative to the nominal one.
    """

    converter: int
    full_scale: int
    reference: Float
    contact: float = 1.0
    supply: float = 1.0
    clock: float = 1.0


class Wiring:
    """Wires and a converter whose readings depend on faults and on the moved wire.

    Args:
        traits: Properties of the board and its wires.
        faults: Faults by time.
        rng: Random generator.

    Attributes:
        moved: Index of the cord whose wire is moved; None for none.
    """

    def __init__(
        self, traits: WiringTraits, faults: tuple[CordFault, ...], rng: np.random.Generator
    ) -> None:
        self._traits, self._faults, self._rng = traits, faults, rng
        count = len(traits.reference)
        self.moved: int | None = None
        self._joints = np.zeros(count)
        self._is_contact_open = np.zeros(count, bool)
        self._phases = rng.uniform(0, 2 * np.pi, (count, 2))
        self._time = 0.0
        self._resistors = traits.reference * (1 + 0.01 * rng.normal(size=count))  # 1 % parts

    def convert(self, ohm: Float, time: float, averages: int, channels: int) -> Int:
        """Return the sums of conversions of a sample.

        Args:
            ohm: Resistances of the cords (c,), ohm.
            time: Time of the middle of the conversions, s.
            averages: Conversions per channel.
            channels: Number of channels that are read.

        Returns:
            Sums (channels,), `NOT_READ` for channels without a converter.
        """
        t = self._traits
        faults = [f for f in self._faults if f.is_present(time)]
        shares = self._shares(ohm, time, faults)[:channels]
        step = conversion_time(t.converter, channels, averages) / (channels * averages)
        order = np.arange(channels * averages).reshape(channels, averages)
        times = time + step * (order - channels * averages / 2)
        volts = shares[:, None] + np.zeros_like(times)
        for fault in faults:
            (c, *_), amount = fault.channels, _amount(fault)
            if c >= channels:
                continue
            millivolts = amount / _SUPPLY_MV[t.converter]
            if fault.kind in (HUM_50, HUM_60):
                # Induced in the loop of wire and cord; the divider passes a part of it on.
                hertz = t.clock * (50 if fault.kind == HUM_50 else 60)
                angle = 2 * np.pi * hertz * times[c]
                wave = np.sin(angle + self._phases[c, 0])
                wave += _HARMONIC_SHARE * np.sin(2 * angle + self._phases[c, 1])
                volts[c] += (1 - shares[c]) * millivolts * wave
            elif fault.kind == NOISE:
                volts[c] += (1 - shares[c]) * millivolts * self._rng.normal(size=averages)
        counts = volts * t.full_scale + _CONVERTER_NOISE * self._rng.normal(size=volts.shape)
        # The board's own converter ends one step below its supply.
        top = MAX_COUNT if t.converter else t.full_scale - 1
        sums = np.clip(np.rint(counts), 0, top).astype(np.int64).sum(axis=1)
        for fault in faults:
            if fault.kind == UNREAD and fault.channels[0] < channels:
                sums[fault.channels[0]] = NOT_READ
        return np.asarray(sums)

    def _shares(self, ohm: Float, time: float, faults: list[CordFault]) -> Float:
        """Return the voltages of all pins (c,) relative to the nominal supply."""
        t = self._traits
        count = len(ohm)
        wires, resistors = np.arange(count), self._resistors.copy()
        supply = t.supply if t.converter else 1.0
        for fault in faults:
            if fault.kind == SWAP:
                wires[list(fault.channels)] = wires[list(fault.channels)[::-1]]
            elif fault.kind == REFERENCE:
                resistors[fault.channels[0]] *= _amount(fault)
            elif fault.kind == SUPPLY:
                supply *= _amount(fault)
        to_ground = self._add_wires(ohm[wires], wires, time, faults)
        bridges = [fault for fault in faults if fault.kind == BRIDGE]
        if not bridges:
            return np.asarray(supply * to_ground / (to_ground + resistors))
        conductance = np.diag(1 / resistors + 1 / to_ground)
        for fault in bridges:
            i, j = fault.channels
            g = 1 / _amount(fault)
            conductance[[i, j], [i, j]] += g
            conductance[[i, j], [j, i]] -= g
        return np.asarray(np.linalg.solve(conductance, supply / resistors))

    def _add_wires(self, ohm: Float, wires: Int, time: float, faults: list[CordFault]) -> Float:
        """Return the resistances from each pin to ground (c,), ohm."""
        step, self._time = max(time - self._time, 1e-6), time
        is_moved = wires == (-1 if self.moved is None else self.moved)
        remaining = np.exp(-step / _JOINT_TIME_S)
        drawn = np.sqrt(2) * self._traits.contact * self._rng.normal(size=len(ohm))
        moving = remaining * self._joints + np.sqrt(1 - remaining**2) * drawn
        self._joints = np.where(is_moved, moving, self._joints)
        out = ohm + self._joints
        rate = np.where(is_moved, _MOVING_RATE_HZ, _RESTING_RATE_HZ)
        switches = self._rng.random(len(ohm)) < 1 - np.exp(-rate * step)
        self._is_contact_open ^= switches
        # A wire that is left alone comes to rest with its contact closed.
        self._is_contact_open &= is_moved | (self._rng.random(len(ohm)) < np.exp(-step / 0.5))
        for fault in faults:
            c = fault.channels[0]
            if fault.kind == CUT:
                out[c] = OPEN_OHM
            elif fault.kind == SHORT:
                out[c] = _SHORT_OHM
            elif fault.kind == SERIES or (fault.kind == LOOSE and self._is_contact_open[c]):
                out[c] += _amount(fault)
        return out


def _amount(fault: CordFault) -> float:
    return USUAL_AMOUNTS.get(fault.kind, 0.0) if fault.amount is None else fault.amount
