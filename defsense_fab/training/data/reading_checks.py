"""Check the readings of sensors that are no devices: channels with little information, few values.

None of these checks knows cords: readings may have any unit and sign, and need no rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .channel_checks import (
    MAX_INVALID_S,
    MAX_STUCK_S,
    MIN_CLIPPED_SHARE,
    MIN_RANGE,
    do_others_move,
    is_at_end,
    longest_run,
    range_of,
    run_length,
)
from .dataset import Dataset, Recording
from .problems import Problem

#: Fewer frames cannot be trained on.
MIN_FRAMES = 50
#: Shorter recordings show little of how a device moves, s.
MIN_DURATION_S = 60.0
_MAX_GAP_SHARE = 0.2  # of a channel's samples without a value, without a warning
_MIN_INCREASES = 50  # one after another, which no sensor with noise shows
_MIN_KNOWN_SHARE = 0.5  # of a channel's values; a channel with fewer is named


def check_readings(dataset: Dataset) -> list[Problem]:
    """Find channels of any sensor that hold little information; none of them forbids training.

    Args:
        dataset: The dataset, whose readings may have any value.

    Returns:
        A problem for each such channel: it has gaps, does not change in a run, only increases,
        stays at one value while others move, or is at the end of its range. And one for targets
        that do not change.
    """
    doubts: dict[str, list[_Doubt]] = {}
    for k, name in enumerate(dataset.channels):
        found = [d for r in dataset.recordings if (d := _find_doubt(r, k, name))]
        if found:
            worst = max(found, key=lambda d: d.share)
            doubts.setdefault(worst.code, []).append(replace(worst, runs=len(found)))
    return [
        *(_describe_doubts(code, group) for code, group in doubts.items()),
        *_check_constant_targets(dataset),
    ]


def _check_constant_targets(dataset: Dataset) -> list[Problem]:
    """Find targets that have one value throughout."""
    if dataset.targets is None:
        return []
    points = np.concatenate([r.points for r in dataset.recordings])
    with np.errstate(all="ignore"):
        width = np.array(
            [
                np.ptp(p[np.isfinite(p).all(axis=1)], axis=0).max(initial=0.0)
                if np.isfinite(p).all(axis=1).any()
                else np.inf
                for p in np.moveaxis(points, 1, 0)
            ]
        )
    names = tuple(np.array(dataset.targets.names)[width == 0].tolist())
    if not names:
        return []
    return [
        Problem(
            "constant-target",
            False,
            f"{', '.join(names)}: the target does not change, so that nothing is learned from it",
            "Delete the column, or record movements that change it",
            data={"targets": names},
        )
    ]


@dataclass(frozen=True)
class _Doubt:
    """A channel that holds little information in a run.

    Attributes:
        code: Code of the problem.
        run: Name of the run.
        channel: Name of the channel.
        text: What is wrong, for one channel.
        share: Share of the samples concerned.
        runs: Number of runs in which it is so.
    """

    code: str
    run: str
    channel: str
    text: str
    share: float
    runs: int = 1


#: What is wrong with several channels, by the code of the problem.
_SEVERAL = {
    "missing-channel": "have no value in many samples",
    "constant-channel": "do not change",
    "increasing-channel": "only increase, as a clock or a counter does",
    "saturated-channel": "are at the end of their range for long",
    "stuck-channel": "stay the same while others move",
}


def _describe_doubts(code: str, group: Sequence[_Doubt]) -> Problem:
    """Return the problem of all channels with one code."""
    worst = max(group, key=lambda d: d.share)
    names = tuple(d.channel for d in group)
    if len(group) == 1:
        more = f" (and in {worst.runs - 1} more runs)" if worst.runs > 1 else ""
        message, subject = f"{worst.run}: {worst.channel} {worst.text}{more}", "it"
    else:
        each = ", ".join(f"{d.channel} ({d.share:.0%})" for d in group)
        message, subject = f"{worst.run}: {each} {_SEVERAL[code]}", "them"
    return Problem(
        code,
        False,
        message,
        f"Check the connections, or leave {subject} out (--without-channels {','.join(names)})",
        worst.share,
        (worst.run,),
        {"channels": names},
    )


def _find_doubt(r: Recording, k: int, name: str) -> _Doubt | None:
    """Return why a channel holds little information in a run, if it does."""
    values, signals = r.ohm[:, k], r.signals[:, k]
    is_gap = ~np.isfinite(values)
    if (share := float(is_gap.mean())) > _MAX_GAP_SHARE:
        return _Doubt(
            "missing-channel", r.name, name, f"has no value in {share:.0%} of the samples", share
        )
    if range_of(signals) < MIN_RANGE * max(1.0, float(np.nanmax(np.abs(signals)))):
        return _Doubt("constant-channel", r.name, name, "does not change", 1.0)
    steps = np.diff(values[~is_gap])
    if len(steps) >= _MIN_INCREASES and (steps > 0).all():
        text = "only increases, as a clock or a counter does"
        return _Doubt("increasing-channel", r.name, name, text, 1.0)
    step = float(np.median(np.diff(r.sample_time))) if len(r.sample_time) > 1 else 0.0
    is_end = is_at_end(values)
    share, longest = float(is_end.mean()), step * run_length(is_end)
    is_long = longest > MAX_INVALID_S / 2 and share > MIN_CLIPPED_SHARE
    if is_long and do_others_move(r, k, *longest_run(is_end)):
        text = f"is at the end of its range for {share:.0%} of the samples, {longest:.1f} s at once"
        return _Doubt("saturated-channel", r.name, name, text, share)
    start, end = longest_run(np.append(False, values[1:] == values[:-1]))
    if step * (end - start) > MAX_STUCK_S and do_others_move(r, k, max(start - 1, 0), end):
        text = f"stays the same for {step * (end - start):.1f} s while others move"
        return _Doubt("stuck-channel", r.name, name, text, (end - start) / len(values))
    return None


def check_values(dataset: Dataset, counts: Mapping[str, int], advised: int) -> list[Problem]:
    """Check the number and duration of times with targets and all signals.

    Args:
        dataset: The dataset, of a sensor that is no device.
        counts: Number of these times by the name of the recording.
        advised: Number below which there is a warning.

    Returns:
        At most one problem.
    """
    total = sum(counts.values())
    duration = sum(
        counts[r.name] * float(np.median(np.diff(r.time)))
        for r in dataset.recordings
        if len(r.time) > 1
    )
    if total >= advised and duration >= MIN_DURATION_S:
        return []
    if total >= advised:
        text = f"times with targets and all signals last {duration:.3g} s in total"
        action = f"Record {MIN_DURATION_S:.0f} s or more, with all movements of the sensor"
        return [Problem("few-frames", False, text, action, duration)]
    shares = np.mean(
        np.concatenate([np.isfinite(r.signals_at(r.time)) for r in dataset.recordings]), axis=0
    )
    worst = int(np.argmin(shares))
    gaps = shares[worst] < _MIN_KNOWN_SHARE
    names = [n for n, share in zip(dataset.channels, shares, strict=True) if share <= shares[worst]]
    message = (
        f"{total} of {dataset.frame_count} times have a target and all signals"
        f"{f' ({names[0]} has {shares[worst]:.0%} of its values)' if gaps else ''}"
    )
    action = (
        f"Leave out {names[0]} (without_channels), or record for longer"
        if gaps and len(dataset.channels) > 1
        else "Record for longer"
    )
    if total < MIN_FRAMES:
        return [
            Problem(
                "too-few-frames",
                True,
                f"{message}, and training needs {MIN_FRAMES}",
                action,
                total,
                data={"needed": MIN_FRAMES},
            )
        ]
    text = f"{message}; {advised} or more are advised for {len(dataset.channels)} channels"
    return [Problem("few-frames", False, text, action, total)]
