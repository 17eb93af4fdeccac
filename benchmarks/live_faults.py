"""Cords that fail in a live device: when that is told, and what it costs.

    python -m benchmarks.live_faults my-device/model.json --unit 1 --seeds 3 --minutes 20

The twin of a built device is moved by hands that the model was not trained with; its samples go
through the live decoder as fast as it decodes (simulated time). Cords are cut, shorted, stuck and
swapped one by one, ten seconds each, after the device was moved and has rested. Told are: seconds
until the alarm (median, most; `-` where there was none), RMSE (mm) against where the twin's markers
really were before the fault, during it without fallback, and with it; and false alarms per hour
of normal use.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Bool, Float
from defsense_fab.runtime.frames.live_decoder import LiveDecoder, Reading
from defsense_fab.runtime.frames.live_frame import LiveFrame
from defsense_fab.runtime.live.live_device import LiveDevice, live_device
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.replayed_cords import CUT, SHORT, STUCK, SWAP
from defsense_fab.twin.recordings.twin_recordings import TwinRun, TwinRuns, simulate_runs

_SECONDS = 10.0  # of a fault
_BEGIN, _EVERY = 75.0, 25.0  # s, of the first fault and between two


@dataclass(frozen=True)
class Played:
    """The frames of a run, and what is told in them besides drift and the training's range."""

    frames: list[LiveFrame]

    def alarms(self) -> list[tuple[float, str]]:
        """Times, s, and words of each alarm, when it begins."""
        codes = {"torn", "shorted", "stuck", "loose", "swapped"}
        out, before = [], set[str]()
        for frame in self.frames:
            now = {note.text for note in frame.notes if note.code in codes}
            out += [(frame.time, word) for word in sorted(now - before)]
            before = now
        return out


def play(
    device: LiveDevice, made: TwinRuns, ohm: Float, *, fallback: bool = True,
    stuck: tuple[int, Bool] | None = None,
) -> Played:  # fmt: skip
    """Resistances (n, c) in the order of the wires, after the converter, decoded."""
    run, converter = made.runs[0], made.converter
    sums = converter.convert(ohm, made.traits.board.own_noise, np.random.default_rng(3))
    dividers = Dividers(converter.reference, converter.full_scale)
    read = dividers.resistance(sums / converter.averages)
    if stuck is not None:  # it is the converter that says the same again and again
        channel, on = stuck
        read[on, channel] = read[np.flatnonzero(on)[0], channel]
    order = [device.wired.index(name) for name in device.model.channels]
    decoder = LiveDecoder(
        device.model, None, device.trained_rest, first_rest_signals=device.lying, fallback=fallback
    )
    frames = []
    for t, now in zip(run.truth.sample_time, read[:, order], strict=True):
        frame = decoder(Reading(float(t), now, float(t)))
        if frame is not None:
            frames.append(frame)
    return Played(frames)


def errors(made: TwinRuns, run: TwinRun, frames: list[LiveFrame]) -> Float:
    """(t, m) mm."""
    shown = made.fields.displacements(made.markers.centers)
    at = np.array([f.time for f in frames])
    moved = made.fields.space(run.walk(at)) @ shown.reshape(len(shown), -1)
    true = made.markers.centers + moved.reshape(len(at), -1, 3)
    return np.linalg.norm(np.array([f.markers for f in frames]) - true, axis=2)


def damaged(ohm: Float, time: Float, kind: str, channels: tuple[int, ...], begin: float) -> Float:
    """Resistances (n, c) with a fault of ten seconds."""
    out, on = ohm.copy(), (time >= begin) & (time < begin + _SECONDS)
    if kind == SWAP:
        a, b = channels
        out[on, a], out[on, b] = ohm[on, b], ohm[on, a]
    elif kind != STUCK:
        out[on, channels[0]] = 1e9 if kind == CUT else 1e-3
    return out


def faults_of(device: LiveDevice, options: argparse.Namespace) -> None:
    assert device.device is not None
    c = len(device.wired)
    cases: list[tuple[str, tuple[int, ...]]] = [
        (kind, (k,)) for kind in (CUT, SHORT, STUCK) for k in range(c)
    ]
    cases += [(SWAP, pair) for pair in combinations(range(c), 2)]
    rows: dict[str, list[tuple[float | None, float, float, float]]] = {}
    false = hours = 0.0
    for seed in range(1, options.seeds + 1):
        made = simulate_runs(
            device.device, seconds=60 * options.minutes, seed=1000 + seed, unit=options.unit
        )
        run = made.runs[0]
        time, ohm = run.truth.sample_time, run.truth.ohm
        normal = play(device, made, ohm)
        false += len(normal.alarms())
        hours += float(time[-1]) / 3600
        for word in normal.alarms():
            print(f"    false alarm, seed {seed}: {word[0]:.0f} s: {word[1]}")
        for k, (kind, channels) in enumerate(cases):
            begin = _BEGIN + _EVERY * k
            if begin + _SECONDS + 1 > time[-1]:
                print(f"    {kind} of {channels}: the run is too short")
                continue
            harm = damaged(ohm, time, kind, channels, begin)
            part = slice(0, int(np.searchsorted(time, begin + _SECONDS + 1)))
            cut = _first(made, part)
            on = (time[part] >= begin) & (time[part] < begin + _SECONDS)
            stuck = (channels[0], on) if kind == STUCK else None
            rows.setdefault(kind, []).append(_case(device, cut, harm[part], begin, stuck))
    for kind, found in rows.items():
        waits = [w for w, *_ in found if w is not None]
        said = f"{np.median(waits):.2f}, at most {max(waits):.2f} s" if waits else "-"
        before, without, with_it = (
            float(np.sqrt(np.mean([r[j] ** 2 for r in found]))) for j in (1, 2, 3)
        )
        print(
            f"  {kind}: told {len(waits)} of {len(found)} times, after {said}; RMSE before"
            f" {before:.2f}, without fallback {without:.2f}, with it {with_it:.2f} mm", flush=True,
        )  # fmt: skip
    print(f"  false alarms: {false:.0f} in {hours:.2f} h", flush=True)


def _first(made: TwinRuns, part: slice) -> TwinRuns:
    from dataclasses import replace

    run = made.runs[0]
    truth = replace(run.truth, sample_time=run.truth.sample_time[part], ohm=run.truth.ohm[part])
    return replace(made, runs=(replace(run, truth=truth),))


def _case(
    device: LiveDevice, made: TwinRuns, ohm: Float, begin: float, stuck: tuple[int, Bool] | None
) -> tuple[float | None, float, float, float]:
    with_it = play(device, made, ohm, stuck=stuck)
    without = play(device, made, ohm, fallback=False, stuck=stuck)
    waits = [t - begin for t, _ in with_it.alarms(device) if begin <= t < begin + _SECONDS]
    run, found = made.runs[0], []
    for played, low, high in (
        (with_it, begin - _SECONDS, begin), (without, begin, begin + _SECONDS),
        (with_it, begin, begin + _SECONDS),
    ):  # fmt: skip
        some = [f for f in played.frames if low <= f.time < high and np.isfinite(f.markers).all()]
        off = errors(made, run, some)
        found.append(float(np.sqrt((off**2).mean())))
    return (min(waits) if waits else None, *found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--unit", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=10.0)
    options = parser.parse_args()
    for path in options.models:
        device = live_device(path)
        print(f"{device.model.device}: {device.model.kind}")
        faults_of(device, options)


if __name__ == "__main__":
    main()
