"""Detect datasets in other units than mm, s and ohm.

Only values that no device and no camera can have are fatal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from .dataset import Dataset
from .problems import Problem

_MIN_SPREAD_MM = 1.0  # a single tag is wider
_MAX_SPREAD_MM = 1e4  # no device is so wide
_MIN_FRAME_STEP_S = 0.9e-3  # no camera follows markers faster
_MAX_FRAME_STEP_S = 1.0  # frames of a slow camera with times in ms are so far apart
_MAX_SLOW_DURATION_S = 30 * 86400.0  # no slow recording lasts so long
_MIN_REST_OHM = 20.0  # no rubber cord of a usable length has less
_MIN_REST_RATIO = 0.05  # of the shortest cord's resistance; no device is below
_MAX_CHANGE_RATIO = 20.0  # no resistance is so many times larger or smaller than at rest

_MAX_RUN_RATIO = 20.0  # between the sizes of readings or targets in two runs, without a warning
_MIN_OTHER_SHARE = 0.75  # of the channels or targets that differ so much
_MAX_RATE_RATIO = 20.0  # between the rates of signals and targets, without a warning

_KILOOHM = {"quantity": "resistances", "unit": "kohm"}
_GIVE_OHM = "Give resistances in ohm, as the device's board does when it runs live"


def check_units(dataset: Dataset) -> list[Problem]:
    """Check the units of positions, times and resistances.

    Args:
        dataset: The dataset.

    Returns:
        Problems with the code "wrong-unit"; their data are the `quantity` and the suspected `unit`.
    """
    if dataset.targets is not None or dataset.readings is not None:
        return [*_check_run_scales(dataset), *_check_rates(dataset)]
    return [*_check_positions(dataset), *_check_times(dataset), *_check_resistances(dataset)]


def check_resistance_unit(ohm: Float, rest: Float) -> list[Problem]:
    """Check whether resistances and R0 have the same unit.

    All channels with samples must agree, since a single one may be broken. Channels whose R0 is 1
    are given in units of R0 and are not checked.

    Args:
        ohm: Resistances, shape (n, c), ohm.
        rest: Resistances at rest R0, shape (c,), ohm.

    Returns:
        At most one problem.
    """
    is_known = np.isfinite(ohm) & (ohm > 0)
    is_checked = is_known.any(axis=0) & np.isfinite(rest) & (rest > 0) & (rest != 1.0)
    if not is_checked.any():
        return []
    median = np.nanmedian(np.where(is_known, ohm, np.nan)[:, is_checked], axis=0)
    ratio = median / rest[is_checked]
    if (ratio < 1 / _MAX_CHANGE_RATIO).all():
        comparison = f"{1 / np.median(ratio):,.0f} times smaller"
    elif (ratio > _MAX_CHANGE_RATIO).all():
        comparison = f"{np.median(ratio):,.0f} times larger"
    else:
        return []
    message = f"resistances are {comparison} than R0; one of them may be in kiloohm"
    value = float(np.median(ratio))
    return [Problem("wrong-unit", True, message, "Give both in ohm", value, data=_KILOOHM)]


def check_cord_resistance(dataset: Dataset, shortest_ohm: float) -> list[Problem]:
    """Check whether the resistances at rest are those of a device's cords.

    Args:
        dataset: The dataset.
        shortest_ohm: Resistance of the device's shortest possible cord, ohm.

    Returns:
        At most one problem.
    """
    largest = _largest_rest(dataset)
    if not 0 < largest < _MIN_REST_RATIO * shortest_ohm:
        return []
    message = (
        f"R0 is at most {largest:.3g} ohm, but the shortest cord of this device has"
        f" {shortest_ohm:.3g} ohm; resistances may be in kiloohm"
    )
    data = {**_KILOOHM, "shortest_ohm": shortest_ohm}
    return [Problem("wrong-unit", True, message, _GIVE_OHM, largest, data=data)]


def _check_run_scales(dataset: Dataset) -> Iterator[Problem]:
    """Find runs whose readings or targets are far larger or smaller than those of the first run."""
    first = dataset.recordings[0]
    for r in dataset.recordings[1:]:
        for quantity, example, names, ours, others in (
            ("readings", "left_ohm, left_kohm", dataset.channels, r.ohm, first.ohm),
            (
                "targets",
                "angle_deg, angle_rad",
                _target_names(dataset),
                _flat(r.points),
                _flat(first.points),
            ),
        ):
            sizes = _sizes(ours), _sizes(others)
            with np.errstate(all="ignore"):
                ratio = sizes[0] / sizes[1]
            is_known = np.isfinite(ratio) & (ratio > 0)
            ratios = ratio[is_known]
            is_other = (ratios < 1 / _MAX_RUN_RATIO) | (ratios > _MAX_RUN_RATIO)
            # All channels change their unit together, and a single one may be broken.
            needed = _MIN_OTHER_SHARE if quantity == "readings" else 0.0
            if not is_other.any() or is_other.mean() < needed:
                continue
            k = int(np.flatnonzero(is_known)[np.argmax(is_other)])
            usual = float(np.median(ratios[is_other]))
            text = f"{usual:,.0f} times larger" if usual > 1 else f"{1 / usual:,.0f} times smaller"
            yield Problem(
                "wrong-unit",
                False,
                f"{r.name}: {quantity} are {text} than in {first.name} ({names[k]}); they may be in"
                " another unit",
                f"State the units in the headers of all runs, such as {example}",
                usual,
                (r.name,),
                {"quantity": quantity, "unit": "", "ratio": usual},
            )


def _check_rates(dataset: Dataset) -> Iterator[Problem]:
    """Find targets whose rate is far from that of the signals."""
    for r in dataset.recordings:
        if len(r.time) < 2 or len(r.sample_time) < 2:
            continue
        target_s, sample_s = (float(np.median(np.diff(t))) for t in (r.time, r.sample_time))
        ratio = sample_s / target_s
        if 1 / _MAX_RATE_RATIO <= ratio <= _MAX_RATE_RATIO:
            continue
        effect = (
            "targets between two samples are compared with interpolated signals"
            if ratio > 1
            else "signals between two targets count for the memory only"
        )
        yield Problem(
            "rates-differ",
            False,
            f"{r.name}: signals have a rate of {_rate(sample_s)} and targets of"
            f" {_rate(target_s)}; {effect}",
            "Check whether both times are in s",
            ratio,
            (r.name,),
            {"samples_hz": 1 / sample_s, "targets_hz": 1 / target_s},
        )


def _rate(step_s: float) -> str:
    rate = 1 / step_s
    return f"{rate:,.0f} Hz" if rate >= 10 else f"{rate:.3g} Hz"


def _target_names(dataset: Dataset) -> tuple[str, ...]:
    if dataset.targets is None:
        return tuple(f"marker {i}" for i in np.repeat(dataset.ids, 3).tolist())
    return dataset.targets.columns()


def _flat(points: Float) -> Float:
    return points.reshape(len(points), -1)


def _sizes(values: Float) -> Float:
    """Return the median of the absolute values of each column (k,), NaN without any."""
    columns = (np.abs(column[np.isfinite(column)]) for column in values.T)
    return np.array([float(np.median(c)) if len(c) else np.nan for c in columns])


def _check_positions(dataset: Dataset) -> list[Problem]:
    """Check the spread of the markers.

    All positions count for the lower limit, but only those at rest for the upper one: a camera may
    take something far away for a marker.
    """
    rest = dataset.rest_points
    positions = np.concatenate([rest, *(r.points.reshape(-1, 3) for r in dataset.recordings)])
    if (spread := _spread(positions)) < _MIN_SPREAD_MM:
        message = f"all marker positions are within {spread:.3g} mm; they may be in meters"
        unit = "m"
    elif (spread := _spread(rest)) > _MAX_SPREAD_MM:
        message = f"markers at rest are {spread:,.0f} mm apart; they may be in micrometers"
        unit = "um"
    else:
        return []
    data = {"quantity": "positions", "unit": unit}
    return [Problem("wrong-unit", True, message, "Give positions in mm", spread, data=data)]


def _check_times(dataset: Dataset) -> Iterator[Problem]:
    for r in dataset.recordings:
        if len(r.time) < 2:
            continue
        step, duration = float(np.median(np.diff(r.time))), float(r.time[-1] - r.time[0])
        if step < _MIN_FRAME_STEP_S:
            message = (
                f"{r.name}: there are {1 / step:,.0f} frames per second; times may be in hours"
            )
            unit = "h"
        elif step >= _MAX_FRAME_STEP_S:
            message = f"{r.name}: frames are {step:.3g} s apart; times may be in ms"
            unit = "ms"
        else:
            continue
        is_fatal = step < _MIN_FRAME_STEP_S or duration > _MAX_SLOW_DURATION_S
        data = {"quantity": "times", "unit": unit}
        yield Problem("wrong-unit", is_fatal, message, "Give times in s", step, (r.name,), data)


def _check_resistances(dataset: Dataset) -> Iterator[Problem]:
    for r in dataset.recordings:
        for p in check_resistance_unit(r.ohm, r.rest):
            yield replace(p, message=f"{r.name}: {p.message}", recordings=(r.name,))
    largest = _largest_rest(dataset)
    if 0 < largest < _MIN_REST_OHM:
        message = (
            f"R0 is at most {largest:.3g} ohm, which is little for rubber cord; resistances may be"
            " in kiloohm"
        )
        yield Problem("wrong-unit", False, message, _GIVE_OHM, largest, data=_KILOOHM)


def _largest_rest(dataset: Dataset) -> float:
    """Return the largest R0 in ohm, or 0 if none is known.

    An R0 of exactly 1 does not count: those resistances are given in units of R0.
    """
    rest = np.concatenate([r.rest for r in dataset.recordings])
    rest = rest[rest != 1.0]
    return float(rest.max(initial=0.0, where=np.isfinite(rest)))


def _spread(points: Float) -> float:
    """Return the extent of the known points along the longest axis; NaN if none is known."""
    known = points[np.isfinite(points).all(axis=1)]
    return float(np.ptp(known, axis=0).max()) if len(known) else np.nan
