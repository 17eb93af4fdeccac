"""Measure how models decode cords that fail while the device is in use.

    python -m benchmarks.live_faults my-device my-device/model.json other.json
    python -m benchmarks.live_faults my-device model.json --cords hysteretic --seeds 2 --places 4

The twin of a built unit is moved by a hand that the models were not trained with. Its samples go
through the live decoder as fast as it decodes (simulated time). Each cord is cut, shorted and stuck
for ten seconds, at several places of the recording, after which the device is as before. A line for
each model and kind of fault shows:

- RMSE (mm) from the true markers: in the same ten seconds with sound cords, with the fault but
  without fallback, and with it; the last again from one second after the start;
- how often the fault was reported in the ten seconds, after how long (median, longest; s), and the
  share of the frames that were lost (the last good positions are repeated).

False alarms are those during the whole recording with sound cords.
"""

from __future__ import annotations

import argparse
import copy
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.core.device.device_file import load_device
from defsense_fab.decoding.channel_faults import LOOSE, SHORTED, STUCK, TORN
from defsense_fab.runtime.frames.live_decoder import LiveDecoder, Reading
from defsense_fab.runtime.frames.live_faults import SWAPPED
from defsense_fab.runtime.frames.live_frame import LiveFrame, Quality
from defsense_fab.twin.options import CordFamilyName, TwinOptions
from defsense_fab.twin.recordings.twin_recordings import TwinRuns, simulate_runs
from defsense_fab.workflow.run.live_device import LiveDevice, live_device

_ALARMS = {TORN, SHORTED, STUCK, LOOSE, SWAPPED}
_FAULT_S, _FIRST_S, _SETTLED_S = 10.0, 75.0, 1.0  # durations of a fault, before the first, left out
_FAULT_OHM = {TORN: 1e9, SHORTED: 1e-3}


@dataclass
class Row:
    """Results of one kind of fault: sums of squares (mm^2) and counts over its cases."""

    squares: dict[str, list[float]] = field(default_factory=dict)
    waits: list[float | None] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)

    def add(self, name: str, square: float) -> None:
        """Add the mean square of a case."""
        self.squares.setdefault(name, []).append(square)

    def __str__(self) -> str:
        rmse = ", ".join(f"{name} {np.sqrt(np.mean(s)):.2f}" for name, s in self.squares.items())
        known = [w for w in self.waits if w is not None]
        wait = f"{np.median(known):.2f} (longest {max(known):.2f}) s" if known else "-"
        return (
            f"{rmse} mm; reported {len(known)} of {len(self.waits)} after {wait};"
            f" lost {np.mean(self.lost):.1%}"
        )


def decode(decoder: LiveDecoder, time: Float, ohms: Float) -> list[LiveFrame]:
    """Return the frames of resistances (n, c) ohm, in the model's order."""
    pairs = zip(time.tolist(), ohms, strict=True)
    frames = (decoder(Reading(t, row, t)) for t, row in pairs)
    return [frame for frame in frames if frame is not None]


def mean_square(runs: TwinRuns, shown: Float, frames: Iterable[LiveFrame]) -> float:
    """Return the mean square distance (mm^2) of frames from the true markers."""
    frames = list(frames)
    time = np.array([f.time for f in frames])
    moved = runs.fields.space(runs.runs[0].walk(time)) @ shown.reshape(len(shown), -1)
    true = runs.markers.centers + moved.reshape(len(time), -1, 3)
    return float((np.linalg.norm(np.array([f.markers for f in frames]) - true, axis=2) ** 2).mean())


def alarm_times(frames: list[LiveFrame]) -> list[tuple[float, str]]:
    """Return the times, s, and texts of alarms when they start."""
    out, former = [], set[str]()
    for frame in frames:
        now = {note.text for note in frame.notes if note.code in _ALARMS}
        out += [(frame.time, text) for text in sorted(now - former)]
        former = now
    return out


def measure(
    device: LiveDevice, runs: TwinRuns, places: int, rows: dict[str, Row]
) -> list[tuple[float, str]]:
    """Add the faults of a recording to the rows, and return its false alarms."""
    truth, converter, board = runs.runs[0].truth, runs.converter, runs.traits.board
    order = [device.board_channels.index(name) for name in device.model.channels]
    shown = runs.fields.displacements(runs.markers.centers)

    def read(ohms: Float, first: int) -> Float:
        sums = converter.convert(ohms, board.own_noise, np.random.default_rng([3, first]))
        return converter.to_resistances(sums)[:, order]

    time, count = truth.sample_time, len(order)
    starts = np.linspace(_FIRST_S, time[-1] - _FAULT_S - 1, places * count)
    decoder = LiveDecoder(
        device.model, None, device.trained_rest, first_rest_signals=device.first_rest_signals
    )
    frames, at = [], 0
    for case, start in enumerate(starts.tolist()):
        first, last = np.searchsorted(time, [start, start + _FAULT_S])
        frames += decode(decoder, time[at:first], read(truth.ohm[at:first], at))
        before = copy.deepcopy(decoder, {id(device.model): device.model})
        sound = read(truth.ohm[first:last], first)
        frames += (sound_frames := decode(decoder, time[first:last], sound))
        at, channel = last, case % count
        for kind in (TORN, SHORTED, STUCK):
            row = rows.setdefault(kind, Row())
            row.add("sound", mean_square(runs, shown, sound_frames))
            ohms = truth.ohm[first:last].copy()
            ohms[:, order[channel]] = _FAULT_OHM.get(kind, 0.0)
            failed = sound.copy()
            failed[:, channel] = (
                sound[0, channel] if kind == STUCK else read(ohms, first)[:, channel]
            )
            for name, fallback in (("without fallback", False), ("with it", True)):
                faulty = copy.deepcopy(before, {id(device.model): device.model})
                faulty._fallback = fallback
                bad_frames = decode(faulty, time[first:last], failed)
                row.add(name, mean_square(runs, shown, bad_frames))
            settled = [f for f in bad_frames if f.time >= start + _SETTLED_S]
            row.add("after 1 s", mean_square(runs, shown, settled))
            alarms = alarm_times(bad_frames)
            row.waits.append(alarms[0][0] - start if alarms else None)
            row.lost.append(float(np.mean([f.quality is Quality.LOST for f in bad_frames])))
    return alarm_times(frames)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("device", type=Path)
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--unit", type=int, default=1)
    parser.add_argument("--cords", default=TwinOptions.cords, choices=get_args(CordFamilyName))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=6.0)
    parser.add_argument("--places", type=int, default=2, help="of the faults of each cord")
    options = parser.parse_args()
    twins = [
        TwinOptions(minutes=options.minutes, seed=1000 + k, unit=options.unit, cords=options.cords)
        for k in range(1, options.seeds + 1)
    ]
    recordings = [simulate_runs(load_device(options.device), twin) for twin in twins]
    for path in options.models:
        device = live_device(path, options.device)
        rows: dict[str, Row] = {}
        alarms = [a for runs in recordings for a in measure(device, runs, options.places, rows)]
        print(f"{path.name}: {device.model.kind}, {options.cords} cords")
        for kind, row in rows.items():
            print(f"  {kind}: {row}")
        hours = options.seeds * options.minutes / 60
        print(f"  false alarms: {len(alarms)} in {hours:.2f} h", flush=True)
        for time, text in alarms:
            print(f"    {time:.0f} s: {text}")


if __name__ == "__main__":
    main()
