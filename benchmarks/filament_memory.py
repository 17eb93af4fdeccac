"""Fit the contact network of printed traces to published readings of printed TPU sensors.

    python -m benchmarks.filament_memory

`printed_tpu_staircase.csv` has the readings of five printed bending sensors of conductive TPU,
0.6 mm thick: the change of R, in percent of R0, at the end of each plateau of a staircase of
displacements that goes up and down five times. Source: P. Gurram and M. Elgendi, Replication-aware
design selection and validation of 3D-printed conductive TPU bending sensors, `plateau_metrics.csv`
of github.com/poojasrinivas1304/Sensors-Morphology at 7025fb0a (data: CC BY 4.0), rounded to 0.01.
The brand of the filament and the strain are not stated: strain is taken to grow with the square
root of the displacement, as in a strip that buckles.

Each sensor's ln(R/R0) is fitted by a quadratic of the strain (the response, unknown) and the terms
of the network for direction, opened paths and settling. Printed are the sizes of these terms, the
share of the variance that they explain, and how much a reading differs from the sum of the means of
its cycle and of its plateau, which no model of loops explains.

Sensors differ in the logarithms of the sizes. Each is fitted to either half of its readings, which
alternate; the variance of the fits is subtracted from that of the sensors.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.twin.electronics.contact_network import FITTED_RANGE, SIZES, ContactNetwork

TABLE = Path(__file__).with_name("printed_tpu_staircase.csv")
STEP_S = 0.25  # of the simulation
PLATEAU_S, LOW_PLATEAU_S, RAMP_S = 9.94, 39.95, 1.13  # as in the table's source
START_S = 21.0  # at the lowest displacement
READ_BEFORE_END_S = 1.5  # middle of the 3 s that a reading is the median of
LOWEST_MM, HIGHEST_MM = 0.1, 3.0
FITTED = ("direction", "opened", "settled")
WIDTHS, SETTLINGS = (0.02, 0.05, 0.08, 0.15, 0.3), (1.5, 3.0, 6.0, 12.0, 24.0)


def read_readings() -> tuple[Float, Float]:
    """Return ln(R/R0) (5, 60) of the sensors, NaN where none is stated, and displacements (60,)."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    change = np.array([float(r["change_percent"] or "nan") for r in rows]).reshape(5, -1)
    return np.log1p(change / 100), np.array([float(r["displacement_mm"]) for r in rows[:60]])


def staircase(levels: Float) -> tuple[Float, Float, Float]:
    """Return times (n,) s, strains over the largest (n,), and the times (60,) s of the readings."""
    times, heights, read = [0.0, START_S], [LOWEST_MM, LOWEST_MM], []
    for level in levels:
        times.append(times[-1] + RAMP_S)
        times.append(times[-1] + (LOW_PLATEAU_S if level == LOWEST_MM else PLATEAU_S))
        heights += [level, level]
        read.append(times[-1] - READ_BEFORE_END_S)
    time = np.arange(0.0, times[-1], STEP_S)
    return time, np.sqrt(np.interp(time, times, heights) / HIGHEST_MM), np.array(read)


def terms(memory: ContactNetwork, time: Float, strain: Float, read: Float) -> Float:
    """Return what each term of the network adds to ln(R/R0) at the readings, for a size of 1."""
    signals = FITTED_RANGE * strain[:, None]
    columns = []
    for name in ("", *FITTED):
        sizes = np.array([[float(size == name) for size in SIZES]])
        response, _ = memory.respond(time, signals, memory.new_state(1), sizes)
        columns.append(np.interp(read, time, np.log1p(response[:, 0])))
    return np.stack(columns[1:], axis=1) - columns[0][:, None]


def fit(readings: Float, response: Float, added: Float) -> tuple[Float, float]:
    """Return the sizes (5, 3) of the terms in each sensor, and the share of variance explained."""
    sizes, left, total = [], 0.0, 0.0
    A = np.column_stack([response, added])
    for y in readings:
        known = np.isfinite(y)
        solution, *_ = np.linalg.lstsq(A[known], y[known], rcond=None)
        left += float(((y[known] - A[known] @ solution) ** 2).sum())
        total += float(((y[known] - y[known].mean()) ** 2).sum())
        sizes.append(solution[response.shape[1] :])
    return np.array(sizes), 1 - left / total


def separate_spread(readings: Float, response: Float, added: Float) -> Float:
    """Return the variance (3,) of the logarithms of sizes between sensors, less that of the fits.

    Each sensor is fitted to either half of its readings, which alternate.
    """
    halves = []
    for start in (0, 1):
        half = slice(start, None, 2)
        sizes, _ = fit(readings[:, half], response[half], added[half])
        halves.append(np.log(np.abs(sizes)))
    within = ((halves[0] - halves[1]) ** 2).mean(axis=0)
    between = np.mean(halves, axis=0).var(axis=0, ddof=1)
    return np.asarray(between - within / 4)  # a mean of two fits has a quarter of (a - b)^2


def repeatability(readings: Float) -> Float:
    """Return the deviation (5,) of readings from the means of their cycle and their plateau."""
    y = readings.reshape(5, 5, 12)
    y = y - np.nanmean(y, axis=2, keepdims=True)
    y = y - np.nanmean(y, axis=1, keepdims=True)
    known = np.isfinite(y).sum(axis=(1, 2))
    return np.asarray(np.sqrt(np.nansum(y**2, axis=(1, 2)) / (known - 5 - 12 + 1)))


def main() -> None:
    readings, levels = read_readings()
    time, strain, read = staircase(levels)
    u = np.interp(read, time, strain)
    response = np.column_stack([np.ones_like(u), u, u * u])
    nothing = np.empty((len(u), 0))
    print(f"response alone: {fit(readings, response, nothing)[1]:.2f} of the variance")
    trials = {}
    for width, settling in product(WIDTHS, SETTLINGS):
        memory = replace(ContactNetwork(), width=width, settling=settling)
        trials[width, settling] = fit(readings, response, terms(memory, time, strain, read))
    for key, (_, share) in sorted(trials.items(), key=lambda t: -t[1][1])[:3]:
        print(f"width {key[0]:g}, settling {key[1]:g}: {share:.3f} of the variance")
    sizes, _ = max(trials.values(), key=lambda t: t[1])
    for name, column in zip(FITTED, sizes.T, strict=True):
        print(f"{name}: median {np.median(column):.4f} of {np.round(column, 4)}")
    width, settling = max(trials, key=lambda key: trials[key][1])
    memory = replace(ContactNetwork(), width=width, settling=settling)
    added = terms(memory, time, strain, read)
    variance = separate_spread(readings, response, added)
    print(f"variance of sensors, less that of the fits: {np.round(variance, 3)} of the logarithms;"
          f" spread {np.sqrt(max(np.median(variance), 0.0)):.2f}")  # fmt: skip
    print(f"repeatability: median {np.median(repeatability(readings)):.4f}"
          f" of {np.round(repeatability(readings), 4)}")  # fmt: skip


if __name__ == "__main__":
    main()
