"""Measure what the memory of simulated cords and traces leaves in their signals after training.

    python -m benchmarks.memory_residuals                  # print the rows of all families
    python -m benchmarks.memory_residuals --pieces 20 --minutes 10 --families network --write

A draw is a device of one to four cords. As many poses stretch its cords, by random amounts, while a
hand walks through the poses as in the twin's sessions. A decoder is trained on the cords' readings
to decode their ideal signals, and is tested on the last 30 %. The error of the ideal signals, less
the noise of the readings, is divided by the largest signal of each cord.
It contains hysteresis, relaxation, softening, and the drift and the temperature of the session.

Of printed traces it is not divided, because it does not grow with the signal: the slope of its
logarithm over that of the largest signal is printed. It can be as large as the signal, which then
bounds the error of the decoded one. So it is given as white noise of the readings from which the
best linear decoder has the same errors. The memory of traces depends on |s|: half of their poses
have an opposite, and change the sign of signals.

`--write` replaces the rows of these families in `data/memory_residuals.csv`: quantiles over the
pieces of cord, of the decoder that `train` chooses and of the paper's affine one.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import get_args

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.decoding.quantities import Targets
from defsense_fab.sensing.memory_residual import AFFINE, TRACES, TRAINED
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from defsense_fab.twin.electronics.rubber_cords import (
    CORD_FAMILIES,
    RubberPieces,
    RubberState,
    RubberTraits,
)
from defsense_fab.twin.options import DEFAULT_TRACES, CordFamilyName
from defsense_fab.twin.scenes.hand_walk import plan_walk

TABLE = Path(__file__).parents[1] / "defsense_fab" / "data" / "memory_residuals.csv"
RATE_HZ = 15.0
LARGEST_RANGE = (0.04, 0.2)  # of the signals of devices in fixtures and examples
LARGEST_RANGE_OF_TRACES = (0.05, 0.6)  # the same of printed bar, joystick and cube
OPPOSITE_SHARE = 0.5  # of the poses of traces; in these devices none to all
MAX_NOISE = 3.0  # relative to the spread of a signal; of larger noise nothing is known
ITERATIONS = 200
NOMINAL_OHM = 1500.0
#: What has only one of the families, as the column `cord` names it; cords have any of the others.
CORD_OF_FAMILY = {DEFAULT_TRACES: TRACES}
TRACE_NOISE = 0.003  # data/traces.csv
REST_S = 5.0
QUANTILES = (0.05, 0.5, 0.95)
MAX_CORDS = 4
#: Seeds of devices with one cord and with several; a seed sets the number of cords.
SEEDS = {
    "one": list(range(0, 400, MAX_CORDS)),
    "several": [seed for seed in range(400) if seed % MAX_CORDS],
}
KINDS = {
    TRAINED: TrainOptions(),
    AFFINE: TrainOptions(decoder="affine", memory=False),
}


def equivalent_noise(square: Float, signals: Float) -> Float:
    """Return the noise (c,) of readings that leaves given errors of decoded signals.

    Args:
        square: Mean squared errors (c,).
        signals: Ideal signals (n, c), which are assumed to be normally distributed.
    """
    covariance = np.cov(signals.T).reshape(len(square), -1)
    limit = MAX_NOISE**2 * np.diag(covariance)
    variance = square
    for _ in range(ITERATIONS):
        left = np.linalg.inv(np.linalg.inv(covariance) + np.diag(1 / variance))
        variance = np.minimum(variance * square / np.diag(left), limit)
    return np.asarray(np.sqrt(variance))


def residuals(family: CordFamilyName, seed: int, minutes: float) -> tuple[Float, dict[str, Float]]:
    """Return the largest signals (c,) and residuals (c,) of a drawn device, by kind of decoder.

    Residuals of cords are shares of their largest signals.
    """
    rng = np.random.default_rng([seed, 54])
    cords = 1 + seed % MAX_CORDS
    is_trace = family in CORD_OF_FAMILY
    noise = TRACE_NOISE if is_trace else RubberTraits.noise
    traits = RubberTraits(CORD_FAMILIES[family](), contact=0.0, noise=noise)
    time = np.arange(0.0, 60 * minutes, 1 / RATE_HZ)
    # Direction (c,) of each pose; opposite poses are not mixed.
    directions = np.eye(cords)
    if is_trace:
        opposite = rng.random(cords) < OPPOSITE_SHARE
        directions = np.concatenate([directions, -directions[opposite]])
    names = [f"pose{k}" for k in range(len(directions))]
    together = directions @ directions.T >= 0
    levels = plan_walk(names, together, float(time[-1]), rng)(time) @ directions
    # Each cord follows one direction most, and the others less.
    mix = np.eye(cords) + rng.uniform(-0.5, 0.5, (cords, cords))
    limits = LARGEST_RANGE_OF_TRACES if is_trace else LARGEST_RANGE
    largest = np.exp(rng.uniform(*np.log(limits), cords))
    ideal = levels @ mix
    ideal *= largest / np.abs(ideal).max(axis=0)
    pieces = RubberPieces.draw(traits, np.full(cords, NOMINAL_OHM), rng)
    ohm, _ = pieces.simulate(time, ideal, RubberState.new(traits, cords), rng)
    recording = Recording(
        name="walk",
        session="walk",
        unit="unit",
        sample_time=time,
        ohm=ohm,
        rest=np.median(ohm[time < REST_S], axis=0),
        time=time,
        points=ideal[:, :, None],
        sigma=np.full((len(time), cords, 1), np.nan),
        sync_error=0.0,
    )
    channels = tuple(f"c{k}" for k in range(cords))
    targets = Targets(channels, ("",) * cords, 1)
    reference = np.zeros((cords, 1))
    ids = np.arange(cords)
    dataset = Dataset("walk", "", channels, ids, reference, (recording,), targets=targets)
    out = {}
    for kind, options in KINDS.items():
        result = train(dataset, options)
        test = slice(int(result.test_frames.frame_index[0]), None)
        decoded = result.model.decode(time, recording.signals, time[test]).points[:, :, 0]
        square = np.nanmean((decoded - ideal[test]) ** 2, axis=0) - traits.noise**2
        if is_trace:
            out[kind] = equivalent_noise(square, ideal[test])
        else:
            out[kind] = np.sqrt(np.maximum(square, 0.0)) / largest
    return largest, out


def measure_rows(
    family: CordFamilyName, count: str, seeds: list[int], options: argparse.Namespace
) -> list[list[str]]:
    """Print and return the rows of the table for one or several cords of a family."""
    sizes: dict[str, list[float]] = {kind: [] for kind in KINDS}
    largest: list[float] = []
    for seed in seeds:
        signals, of_kinds = residuals(family, seed, options.minutes)
        largest += signals.tolist()
        for kind, values in of_kinds.items():
            sizes[kind] += values.tolist()
        if len(largest) >= options.pieces:
            break
    rows = []
    is_trace = family in CORD_OF_FAMILY
    for kind, values in sizes.items():
        quantiles = [f"{x:.{4 if is_trace else 3}f}" for x in np.quantile(values, QUANTILES)]
        if is_trace:
            slope = np.polyfit(np.log(largest), np.log(values), 1)[0]
            print(f"{len(values)} pieces, slope over the largest signal {slope:.2f}")
        source = (
            f"benchmarks/memory_residuals.py: {options.pieces} pieces, {options.minutes:g} minutes"
            f" of random movement of the twin's cords `{family}`"
        )
        name = f"{family}-{count}-{kind}"
        rows.append(
            [
                name,
                family,
                CORD_OF_FAMILY.get(family, "any"),
                count,
                kind,
                "simulated",
                "R0" if is_trace else "largest signal",
                *quantiles,
                source,
            ]
        )
        print(*rows[-1][:-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pieces", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--families", nargs="+", default=list(get_args(CordFamilyName)))
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    rows = []
    for family in options.families:
        for count, seeds in SEEDS.items():
            rows += measure_rows(family, count, seeds, options)
    if options.write:
        with TABLE.open(newline="", encoding="utf-8") as file:
            header, *present = csv.reader(file)
        names = {row[0] for row in rows}
        rows = [row for row in present if row[0] not in names] + rows
        rows.sort(key=lambda row: row[header.index("basis")] == "measured")
        with TABLE.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([header, *rows])


if __name__ == "__main__":
    main()
