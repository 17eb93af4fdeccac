"""The twin of a built device on a table, wired to its board: a hand moves wires and holds poses.

It starts at once: cords are moved by the displacement fields of the build. Cords lie off their
axes, differ in their response and resistance, and have play and relaxation (`electronics/cords`);
a hand holds poses less far than designed and trembles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.boards import CONVERTERS
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...optimization.studies.tolerance_monte_carlo import Tolerances, sample_built_cord
from ...sensing.built_cord import CordReading
from ...sensing.response import Response
from ...sensing.serial_frames import NOT_READ, converter_code
from ...store.build import Build
from ..devices.simulated_device import load_simulated_device
from ..electronics.cords import CordFault, CordTraits, DeviceCords
from ..electronics.fault_words import parse_faults
from ..electronics.readout_board import ReadoutTwin
from ..electronics.wiring import WIRING_KINDS, Wiring, WiringTraits

_ARDUINO_FULL_SCALE = 1024
_HAND_TIME_S = 0.25  # in which a hand reaches a pose
_REACH = (0.7, 1.05)  # range of how far a hand holds a pose
_TREMOR, _TREMOR_HZ = 0.02, 6.0  # of the level of a pose
_WIRE_SWAY = 0.03  # level of a pose that a moved wire adds, at about 2 Hz
_WIRE_HZ = 2.1
_SPREADS = (0.04, 0.07)  # range of the deviation of R0 of pieces between batches
_SUPPLY_SPREAD, _CLOCK_SPREAD = 0.005, 0.002  # of a 3.3 V regulator and of a resonator
_NOISE_RANGE = (0.7, 1.5)  # range of the noise of units, relative to that of the cord's table
_MAX_SPEED = 10.0  # a sample takes 0.1 ms; a slower computer could not keep up
_FIRST_SEED = 97  # combined with the numbers of unit and session


@dataclass(frozen=True)
class WiringTwinOptions:
    """Which unit is simulated, with which faults.

    Attributes:
        unit: Number of the built unit: its cords, board and noise.
        seed: Seed of the hand and of noise.
        speed: Simulated seconds per second.
        faults: Faults as users write them, such as `cut=A`.
    """

    unit: int = 1
    seed: int = 1
    speed: float = 1.0
    faults: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> WiringTwinOptions:
        """Return the options of a port such as `twin:unit=2,cut=A`.

        Raises:
            CaptureError: An option is not valid (`source-invalid`).
        """
        values: dict[str, float] = {}
        faults = []
        for word in filter(None, text.partition(":")[2].split(",")):
            name, _, number = word.partition("=")
            if name in WIRING_KINDS:
                faults.append(word)
                continue
            try:
                if name not in ("unit", "seed", "speed"):
                    raise ValueError
                values[name] = float(number) if name == "speed" else int(number)
                limit = _MAX_SPEED if name == "speed" else 10**6
                if not 0 <= values[name] <= limit or (name == "speed" and not values[name]):
                    raise ValueError
            except ValueError:
                raise CaptureError(
                    f"{word!r} is not a valid setting",
                    code="source-invalid",
                    where=text,
                    action="Write any of twin:unit=1,seed=1,speed=5, and faults such as cut=A",
                    setting=word,
                ) from None
        speed = values.get("speed", 1.0)
        return cls(int(values.get("unit", 1)), int(values.get("seed", 1)), speed, tuple(faults))


class WiringTwin:
    """A device with c cords on its board, moved by a hand.

    Args:
        device: The device.
        options: The unit, and its faults.
        build: Its build; by default that in its folder.

    Attributes:
        channels: Names of the channels (c).
        reference: Nominal reference resistors (c,), ohm: those of the build.
        converter: Converter, 0 or 1, as in `Info`.
        full_scale: Counts at the supply's nominal voltage.
        averages: Conversions per sample after the board was switched on.

    Raises:
        CaptureError: The device is not built, or a fault is not valid.
    """

    def __init__(
        self, device: Device, options: WiringTwinOptions, build: Build | None = None
    ) -> None:
        build = build or Build(device.source / "build")
        sim = load_simulated_device(device, np.zeros((0, 3)), build)
        rng = np.random.default_rng([options.unit, _FIRST_SEED])
        self.channels = sim.names
        session = np.random.default_rng([options.unit, options.seed, _FIRST_SEED])
        self._device, self._speed = device, options.speed
        resistors = {c.sensor: c.reference_resistor for c in build.manifest.cords}
        self.reference = np.array([resistors[n] for n in sim.names])
        self.converter = converter_code(device.converter)
        full_scale, self.averages = CONVERTERS[device.converter]
        self.full_scale = full_scale if self.converter else _ARDUINO_FULL_SCALE
        self._ramps = {r.name: r for r in sim.ramps}
        self._changes, lengths = self._draw_cords(device, build, rng)
        reading = CordReading.from_device(device)
        spread = device.cord.trace.spread if device.cord.trace else rng.uniform(*_SPREADS)
        lengths *= np.maximum(1 + spread * rng.normal(size=len(lengths)), 0.1)
        traits = CordTraits(
            Response.line(1.0),
            noise=device.cord.noise * rng.uniform(*_NOISE_RANGE),
            spread=0.0,  # both are drawn above, so that the seed does not change the unit
            rest_spread=0.0,
            ohm_per_mm=reading.ohm_per_mm,
        )
        self._cords = DeviceCords(sim.names, lengths, self._signals, traits, session)
        wiring = WiringTraits(
            self.converter,
            self.full_scale,
            self.reference,
            device.cord.contact,
            1 + _SUPPLY_SPREAD * rng.normal(),
            1 + _CLOCK_SPREAD * rng.normal(),
        )
        faults: tuple[CordFault, ...] = parse_faults(sim.names, options.faults, WIRING_KINDS)
        self._wiring = Wiring(wiring, faults, session)
        self._rng, self._pose, self._target, self._level = session, "", 0.0, 0.0
        self._time = 0.0

    def _draw_cords(
        self, device: Device, build: Build, rng: np.random.Generator
    ) -> tuple[Float, Float]:
        """Return the signals (s, c) of built cords in the states, and lengths (c,), mm."""
        reading, tolerances = CordReading.from_device(device), Tolerances()
        locator, displacements = build.locator, build.fields.displacements
        signals, lengths = [], []
        for record in build.layout.by_channel():
            cord, own = sample_built_cord(record.built, reading, rng, tolerances)
            moved = cord.path + locator.displacement(locator.find(cord.path), displacements)
            signals.append(own.signals(cord, moved))
            lengths.append(own.resistance(cord) / reading.ohm_per_mm)
        return np.stack(signals, axis=1), np.array(lengths)

    def perform(self, kind: str, subject: str) -> None:
        """Let the hand do what a step of the check requires.

        Args:
            kind: `rest`, `wiggle` or `pose`.
            subject: Name of the cord whose wire is moved, or of the pose.
        """
        self._wiring.moved = self.channels.index(subject) if kind == "wiggle" else None
        if kind == "pose":
            self._pose, self._target = subject, float(self._rng.uniform(*_REACH))
        else:
            self._target = 0.0

    def sample(self, start: float, step: float) -> Float:
        """Return the resistances of the cords (c,) ohm, `step` s after `start`, s."""
        return self._cords.sample(start, step)

    def _signals(self, seconds: float) -> Float:
        step, self._time = max(seconds - self._time, 0.0), seconds
        self._level += (1 - np.exp(-step / _HAND_TIME_S)) * (self._target - self._level)
        name, level = self._pose or next(iter(self._ramps)), self._level
        if self._target:
            level *= 1 + _TREMOR * np.sin(2 * np.pi * _TREMOR_HZ * seconds)
        if self._wiring.moved is not None:
            level += _WIRE_SWAY * np.sin(2 * np.pi * _WIRE_HZ * seconds) ** 2
        ramp = self._ramps[name]
        level = min(level, float(ramp.levels[-1]) * 1.05)
        return np.asarray(ramp.weights(np.array(level)) @ self._changes[ramp.states])

    def board(self) -> ReadoutTwin:
        """Switch the read-out board on: a port in real time, or faster."""
        return ReadoutTwin(
            self,
            self.reference,
            speed=self._speed,
            offset=0.2,
            converter=self._device.converter,
            wiring=self._wiring,
        )

    def record(
        self, kind: str, subject: str, seconds: float, rate: int, averages: int, lead: float
    ) -> tuple[Float, Float]:
        """Perform a step at once, without waiting.

        Args:
            kind: `rest`, `wiggle` or `pose`.
            subject: Name of the cord or pose.
            seconds: Duration of the recorded part, s.
            rate: Samples per second, Hz.
            averages: Conversions per sample.
            lead: Time before the recorded part, s.

        Returns:
            Times (n,) s, and mean counts (n, c), NaN where a channel was not read.
        """
        self.perform(kind, subject)
        times, counts = [], []
        step, start = 1 / rate, self._time
        for k in range(round((lead + seconds) * rate)):
            time = start + k * step
            ohm = self.sample(time, step)
            sums: Int = self._wiring.convert(ohm, time + step, averages, len(self.channels))
            if k >= round(lead * rate):
                times.append(round(1e6 * (time + step)) / 1e6)
                counts.append(np.where(sums == NOT_READ, np.nan, sums / averages))
        return np.array(times), np.array(counts)
