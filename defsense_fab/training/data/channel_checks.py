"""Channels that tell nothing, or not what they told in other recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...core.arrays import Bool, Float
from .dataset import Dataset, Recording
from .problems import Problem

_LONG = 1.0  # s
_MUCH = 0.5  # of the samples
_ENDS = 0.02  # of the samples, at the end of what a converter can tell
_STUCK = 3.0  # s, in which others move
_MOVING = 0.3  # of its own range, by which another channel moves meanwhile
_NOTHING = 1e-5  # (R - R0)/R0, less than which no channel moves by
_DRIFT = 0.15  # of R0, by which a cord that is the same changes at most
_UNLIKE = 6.0  # times the others' usual change
_GAIN = 1.35  # times, by which a cord that is the same is more or less sensitive
_ALIKE = 0.6  # correlation of a channel with what is expected of it
_BETTER = 0.15  # by which correlations are higher, in the mean, in another order
_RIDGE = 1e-3
_FEWEST = 100  # frames
_PREDICTION = "the prediction"
_OFTEN = 0.5


def channel_problems(
    dataset: Dataset, predicted: Mapping[str, Float] | None = None
) -> list[Problem]:
    """Of each recording, and between them. `predicted`: (R - R0)/R0 (t, c) at the pictures of
    recordings by name, where they can be foretold."""
    out = [p for r in dataset.recordings for p in _open(dataset, r)]
    constant = [
        name
        for k, name in enumerate(dataset.channels)
        if all(
            np.isfinite(r.signals[:, k]).any() and _range(r.signals[:, k]) < _NOTHING
            for r in dataset.recordings
        )
    ]
    if constant:
        out.append(
            Problem(
                "constant-channel", True, f"{', '.join(constant)} does not change in any recording",
                "see whether its cord is connected, and record again",
                data={"channels": tuple(constant)},
            )
        )  # fmt: skip
    out += [p for r in dataset.recordings for p in _still(dataset, r, constant)]
    return [*out, *_other_cords(dataset), *_other_signals(dataset, predicted or {})]


def _open(dataset: Dataset, r: Recording) -> list[Problem]:
    """Open, shorted, or at an end of the converter's range."""
    out = []
    step = float(np.median(np.diff(r.sample_time))) if len(r.sample_time) > 1 else 0.0
    for k, name in enumerate(dataset.channels):
        R, R0 = r.ohm[:, k], r.rest[k]
        bad = ~np.isfinite(R) | (R <= 0)
        if bad.all() or not np.isfinite(R0):
            out.append(
                Problem(
                    "missing-channel", True, f"{r.name}: {name} has no resistance",
                    "leave the recording out, or record it again", of=(r.name,),
                    data={"channels": (name,)},
                )
            )  # fmt: skip
            continue
        kind = "shorted" if 2 * (R <= 0).sum() > bad.sum() else "open, or out of range,"
        state = "shorted" if kind == "shorted" else "open"
        longest, share = step * _longest(bad), float(bad.mean())
        if not (longest > _LONG or share > _MUCH):
            bad, kind, state = _at_an_end(R), "at the end of its range", "clipped"
            longest, share = step * _longest(bad), float(bad.mean())
            # What never changes is at both ends of its range, and told as such.
            changes = _range(r.signals[:, k]) >= _NOTHING
            clipped = changes and share > _ENDS and longest > _LONG / 2
            if not (clipped and _others_move(r, k, *longest_at(bad))):
                continue
        out.append(
            Problem(
                "saturated-channel", share > _MUCH,
                f"{r.name}: {name} is {kind} for {share:.0%} of the samples, {longest:.1f} s at"
                " once",
                "check its wires and reference resistor; frames at these times tell nothing of it",
                share, (r.name,), {"channel": name, "state": state, "longest_s": longest},
            )
        )  # fmt: skip
    return out


def _at_an_end(R: Float) -> Bool:
    """Samples that are all the same, at the largest or smallest there is."""
    known = R[np.isfinite(R)]
    ends = [np.asarray(end == R) for end in (known.max(), known.min())]
    return max(ends, key=lambda flags: int(flags.sum()))


def _others_move(r: Recording, k: int, begin: int, end: int) -> bool:
    """Whether another channel than `k` moves between two samples."""
    others = [column for j, column in enumerate(r.signals.T) if j != k]
    return any(_range(s[begin:end]) > _MOVING * _range(s) > _MOVING * _NOTHING for s in others)


def _still(dataset: Dataset, r: Recording, constant: Sequence[str]) -> list[Problem]:
    """Channels that stay what they are while others move; without those that never change."""
    if len(r.sample_time) < 2:
        return []
    out = []
    step = float(np.median(np.diff(r.sample_time)))
    for k, name in enumerate(dataset.channels):
        if name in constant:
            continue
        R = r.ohm[:, k]
        same = np.append(False, (R[1:] == R[:-1]) & np.isfinite(R[1:]))
        begin, end = longest_at(same)
        begin = max(begin - 1, 0)
        if step * (end - begin) > _STUCK and _others_move(r, k, begin, end):
            share = (end - begin) / len(R)
            out.append(
                Problem(
                    "stuck-channel", share > _MUCH,
                    f"{r.name}: {name} stays the same for {step * (end - begin):.1f} s, from"
                    f" {r.sample_time[begin]:.1f} s on, while others move",
                    "check its wires; leave the recording out if it is for long"
                    if share <= _MUCH else "check its wires, and leave the recording out",
                    step * (end - begin), (r.name,),
                    {"channel": name, "start_s": float(r.sample_time[begin])},
                )
            )  # fmt: skip
    return out


def _other_cords(dataset: Dataset) -> list[Problem]:
    """Sessions in which one channel's R0 is another than in the others, of the same unit."""
    out = []
    for unit, sessions in _units(dataset).items():
        names = list(sessions)
        if len(names) < 2:
            continue
        R0 = np.array([np.median([r.rest for r in sessions[n]], axis=0) for n in names])
        with np.errstate(all="ignore"):
            change = np.log(R0) - np.median(np.log(R0), axis=0)
        for k, name in enumerate(names):
            # Of two there is no saying which was before: the later one is told.
            if len(names) == 2 and k == 0:
                continue
            own = change[k] - change[0] if len(names) == 2 else change[k]
            usual = np.median(own[np.isfinite(own)]) if np.isfinite(own).any() else 0.0
            spread = 1.48 * float(np.nanmedian(np.abs(own - usual)))
            for c, channel in enumerate(dataset.channels):
                off = float(own[c] - usual)
                if abs(off) > max(np.log1p(_DRIFT), _UNLIKE * spread):
                    out.append(
                        Problem(
                            "replaced-cord", False,
                            f"{name}: R0 of {channel} is {np.exp(off):.2f} times that of the other"
                            f" sessions of {unit}: was the cord replaced, or its wires?",
                            "train on the sessions since then, or record with another --unit since"
                            " then",
                            float(np.exp(off)), tuple(r.name for r in sessions[name]),
                            {"session": name, "channel": channel},
                        )
                    )  # fmt: skip
    return out


def _other_signals(dataset: Dataset, predicted: Mapping[str, Float]) -> list[Problem]:
    """Recordings whose signals are not as their markers let expect, by the other sessions of the
    unit or by what is predicted: in another order, or larger."""
    out = []
    for sessions in _units(dataset).values():
        names = list(sessions)
        for k, name in enumerate(names):
            others = [r for n in names if n != name for r in sessions[n]]
            measured, expected, by = [], [], _PREDICTION
            for r in sessions[name]:
                s = r.signals_at(r.time)
                if r.name in predicted:
                    e: Float | None = predicted[r.name]
                elif others and (k > 0 or len(names) > 2):
                    e, by = _expected(others, r), "the other sessions"
                else:
                    e = None
                if e is not None:
                    measured.append(s)
                    expected.append(e)
            if measured:
                told = tuple(r.name for r in sessions[name])
                m, e = np.concatenate(measured), np.concatenate(expected)
                out += _compare(dataset.channels, name, told, m, e, by)
    return out


def _compare(
    channels: Sequence[str], name: str, of: tuple[str, ...], measured: Float, expected: Float,
    by: str,
) -> list[Problem]:  # fmt: skip
    good = np.isfinite(measured).all(axis=1) & np.isfinite(expected).all(axis=1)
    m, e = measured[good], expected[good]
    if len(m) < _FEWEST or (m.std(axis=0) == 0).any() or (e.std(axis=0) == 0).any():
        return []
    c = len(channels)
    alike = np.corrcoef(m.T, e.T)[:c, c:]
    order = linear_sum_assignment(-alike)[1]
    now, best = float(np.diag(alike).mean()), float(alike[np.arange(c), order].mean())
    wrong = np.flatnonzero(order != np.arange(c))
    if len(wrong) and best - now > _BETTER and alike[wrong, order[wrong]].min() > _ALIKE:
        told = ", ".join(f"{channels[k]} looks like {channels[order[k]]}" for k in wrong.tolist())
        return [
            Problem(
                "permuted-channels", True, f"{name}: by {by}, {told}: are its channels in another"
                " order?",
                "see how the cords are plugged in, or name the columns anew", best - now, of,
                {
                    "session": name, "source": by,
                    "order": {channels[k]: channels[order[k]] for k in wrong.tolist()},
                },
            )
        ]  # fmt: skip
    gain = np.array([np.polyfit(e[:, k], m[:, k], 1)[0] for k in range(c)])
    sure = np.diag(alike) > _ALIKE
    # What is predicted has the response of some cord; what was measured, of this device's.
    ratio = gain / (float(np.median(gain)) if by == _PREDICTION else 1.0)
    return [
        Problem(
            "changed-gain", False,
            f"{name}: {channels[k]} changes {ratio[k]:.2f} times as much as {by} let expect:"
            " was its cord replaced?",
            "train on the sessions since then, or record with another --unit since then",
            float(ratio[k]), of, {"session": name, "channel": channels[k]},
        )
        for k in range(c)
        if sure[k] and ratio[k] > 0 and abs(np.log(ratio[k])) > np.log(_GAIN)
    ]  # fmt: skip


def _expected(others: Sequence[Recording], of: Recording) -> Float | None:
    """The signals (t, c) at the pictures of a recording, by its markers and what others have
    signals at such markers; None where too little was seen in both."""
    often = of.seen.mean(axis=0) > _OFTEN
    for r in others:
        often &= r.seen.mean(axis=0) > _OFTEN
    if not often.any():
        return None

    def inputs(r: Recording) -> Float:
        return r.points[:, often].reshape(len(r.time), -1)

    x = np.concatenate([inputs(r) for r in others])
    y = np.concatenate([r.signals_at(r.time) for r in others])
    good = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if good.sum() < _FEWEST:
        return None
    x, y = x[good], y[good]
    middle, mean = x.mean(axis=0), y.mean(axis=0)
    size = float(x.std()) or 1.0
    z = (x - middle) / size
    normal = z.T @ z + _RIDGE * len(z) * np.eye(z.shape[1])
    return np.asarray(
        (inputs(of) - middle) / size @ np.linalg.solve(normal, z.T @ (y - mean)) + mean
    )


def _units(dataset: Dataset) -> dict[str, dict[str, list[Recording]]]:
    """Recordings by unit and session."""
    out: dict[str, dict[str, list[Recording]]] = {}
    for r in dataset.recordings:
        out.setdefault(r.unit, {}).setdefault(r.session, []).append(r)
    return out


def _range(values: Float) -> float:
    """Between the percentiles 1 and 99, of what is known."""
    known = values[np.isfinite(values)]
    return float(np.subtract(*np.percentile(known, [99, 1]))) if len(known) else 0.0


def longest_at(flags: Bool) -> tuple[int, int]:
    """Where the longest row of true ones begins and ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    if not len(edges):
        return 0, 0
    begin, end = edges[::2], edges[1::2]
    k = int(np.argmax(end - begin))
    return int(begin[k]), int(end[k])


def _longest(flags: Bool) -> int:
    begin, end = longest_at(flags)
    return end - begin
