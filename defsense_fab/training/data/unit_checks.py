"""Datasets in other units than mm, s and ohm: only what no device and no camera can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from .dataset import Dataset
from .problems import Problem

_NARROW, _WIDE = 1.0, 1e4  # mm: a tag alone is wider, and no device so wide
_FAST = 0.9e-3  # s between pictures: no camera follows markers faster
_SLOW = 1.0  # s between pictures, as those of a slow camera in ms have
_LONG = 30 * 86400.0  # s, which no slow recording lasts
_FEW_OHMS = 20.0  # what no rubber cord of a usable length has
_PART = 0.05  # of its shortest cord's resistance, which no device's is below
_TIMES = 20.0  # by which no cord's resistance is larger or smaller than at rest
_KILO = "are resistances in kiloohm?"
_KILO_DATA = {"quantity": "resistances", "unit": "kohm"}
_GIVE_OHM = "give ohm, as the device's board does when it runs live"


def unit_problems(dataset: Dataset) -> list[Problem]:
    """Of places, times and resistances."""
    return [*_places(dataset), *_times(dataset), *_resistances(dataset)]


def _places(dataset: Dataset) -> list[Problem]:
    """Wherever the markers are for the least spread; where they are at rest for the greatest, since
    a camera may once take something far away for a marker."""
    rest = dataset.rest_points
    everywhere = np.concatenate([rest, *(r.points.reshape(-1, 3) for r in dataset.recordings)])
    if (spread := _spread(everywhere)) < _NARROW:
        what = f"all markers, wherever they move, lie within {spread:.3g} mm: are they in metres?"
        unit = "m"
    elif (spread := _spread(rest)) > _WIDE:
        what = f"markers at rest lie {spread:,.0f} mm apart: are they in micrometres?"
        unit = "um"
    else:
        return []
    data = {"quantity": "places", "unit": unit}
    return [Problem("wrong-unit", True, what, "give places in mm", spread, data=data)]


def _times(dataset: Dataset) -> list[Problem]:
    out = []
    for r in dataset.recordings:
        if len(r.time) < 2:
            continue
        step, lasts = float(np.median(np.diff(r.time))), float(r.time[-1] - r.time[0])
        if step < _FAST:
            what = f"there are {1 / step:,.0f} pictures a second: are the times in s?"
            unit = "h"
        elif step >= _SLOW:
            what = f"pictures are {step:.3g} s apart: are the times in ms?"
            unit = "ms"
        else:
            continue
        fatal = step < _FAST or lasts > _LONG
        what, remedy = f"{r.name}: {what}", "give times in s"
        data = {"quantity": "times", "unit": unit}
        out.append(Problem("wrong-unit", fatal, what, remedy, step, (r.name,), data))
    return out


def _resistances(dataset: Dataset) -> list[Problem]:
    out = [
        replace(p, what=f"{r.name}: {p.what}", of=(r.name,))
        for r in dataset.recordings
        for p in unlike_rest(r.ohm, r.rest)
    ]
    largest = _largest_rest(dataset)
    if 0 < largest < _FEW_OHMS:
        what = f"R0 of at most {largest:.3g} ohm is little for rubber cord"
        out.append(
            Problem("wrong-unit", False, f"{what}: {_KILO}", _GIVE_OHM, largest, data=_KILO_DATA)
        )
    return out


def unlike_rest(ohm: Float, rest: Float) -> list[Problem]:
    """Of resistances (n, c) in another unit than R0 (c,): all channels that have any must say so,
    since one alone may be broken. Those whose R0 is 1 are in units of R0, and not judged."""
    known = np.isfinite(ohm) & (ohm > 0)
    judged = known.any(axis=0) & np.isfinite(rest) & (rest > 0) & (rest != 1.0)
    if not judged.any():
        return []
    middle = np.nanmedian(np.where(known, ohm, np.nan)[:, judged], axis=0)
    times = middle / rest[judged]
    if (times < 1 / _TIMES).all():
        how = f"{1 / np.median(times):,.0f} times smaller"
    elif (times > _TIMES).all():
        how = f"{np.median(times):,.0f} times larger"
    else:
        return []
    what = f"resistances are {how} than R0: is one of them in kiloohm?"
    return [
        Problem(
            "wrong-unit",
            True,
            what,
            "give both in ohm",
            float(np.median(times)),
            data=_KILO_DATA,
        )
    ]


def unlike_cords(dataset: Dataset, shortest: float) -> list[Problem]:
    """Of a device whose shortest possible cord has a resistance of `shortest` ohm."""
    largest = _largest_rest(dataset)
    if not 0 < largest < _PART * shortest:
        return []
    what = (
        f"R0 of at most {largest:.3g} ohm is not that of this device's cords, of which the shortest"
        f" has {shortest:.3g} ohm"
    )
    data = {**_KILO_DATA, "shortest_ohm": shortest}
    return [Problem("wrong-unit", True, f"{what}: {_KILO}", _GIVE_OHM, largest, data=data)]


def _largest_rest(dataset: Dataset) -> float:
    """Of all channels and recordings, ohm; 0 where none is known, as where resistances are told in
    units of R0, which then is 1."""
    rest = np.concatenate([r.rest for r in dataset.recordings])
    rest = rest[rest != 1.0]
    return float(rest.max(initial=0.0, where=np.isfinite(rest)))


def _spread(points: Float) -> float:
    """Along the longest axis, of what is known; NaN where nothing is."""
    known = points[np.isfinite(points).all(axis=1)]
    return float(np.ptp(known, axis=0).max()) if len(known) else np.nan
