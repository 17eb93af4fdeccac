"""Devices, layouts and channels that are not what they should be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.damage.copies import (
    SILENT,
    TOLD,
    Place,
    Words,
    both,
    columns,
    fault,
    pair,
    tell,
    train,
)
from defsense_fab.capture.sessions.result_files import SAMPLES
from defsense_fab.core.arrays import Float


def swapped(values: dict[str, Float], one: str, two: str) -> None:
    for end in ("", "_ohm"):
        if one + end in values:
            a, b = values[one + end], values[two + end]
            values[one + end], values[two + end] = b.copy(), a.copy()


def one_sample(channel: str, value: float) -> Callable[[dict[str, Float]], None]:
    """All of a channel is this, ohm; its signals are left as they are."""

    def change(values: dict[str, Float]) -> None:
        if channel + "_ohm" in values:
            values[channel + "_ohm"][:] = value

    return change


@fault("whole sessions", SILENT)
def _(p: Place) -> Words:
    return train(p, p.a, p.b)


@fault("session of another device")
def _(p: Place) -> Words:
    s = p.copy()
    tell(s / "session.json", device="bun")
    return train(p, s)


@fault("sessions of two devices, no --device")
def _(p: Place) -> Words:
    s = p.copy(p.b)
    tell(s / "session.json", device="bun")
    return train(p, p.a, s, device=False)


@fault("session of another layout")
def _(p: Place) -> Words:
    s = p.copy()
    tell(s / "session.json", layout="0123456789abcdef")
    return train(p, s)


@fault("sessions of two layouts, no --device")
def _(p: Place) -> Words:
    s = p.copy(p.b)
    tell(s / "session.json", layout="0123456789abcdef")
    return train(p, p.a, s, device=False)


@fault("sessions of two built devices", TOLD)
def _(p: Place) -> Words:
    s = p.copy(p.b)
    tell(s / "session.json", unit="second")
    return train(p, p.a, s)


@fault("channel missing in samples.csv")
def _(p: Place) -> Words:
    s, c = p.copy(), p.channels[0]
    columns(s / SAMPLES, lambda v: (v.pop(c), v.pop(c + "_ohm"), None)[-1])
    return train(p, s)


@fault("channel missing in a table of signals")
def _(p: Place) -> Words:
    s, c = p.copy(), p.channels[0]
    columns(s / SAMPLES, lambda v: (v.pop(c), v.pop(c + "_ohm"), None)[-1])
    return train(p, *pair(p, s / SAMPLES))


@fault("channel of another name in a table of signals")
def _(p: Place) -> Words:
    s, c = p.copy(), p.channels[0]
    text = (s / SAMPLES).read_text(encoding="utf-8").replace(f",{c}", ",other", 2)
    (s / SAMPLES).write_text(text, encoding="utf-8")
    return train(p, *pair(p, s / SAMPLES))


@fault("channels permuted: two, by the simulation")
def _(p: Place) -> Words:
    s = p.copy()
    both(s, lambda v: swapped(v, p.channels[0], p.channels[-1]))
    return train(p, s)


@fault("channels permuted: all, by the simulation")
def _(p: Place) -> Words:
    s = p.copy()
    for one, two in zip(p.channels[:-1], p.channels[1:], strict=True):
        both(s, lambda v, one=one, two=two: swapped(v, one, two))  # type: ignore[misc]
    return train(p, s)


@fault("channels permuted: two neighbours, by the simulation")
def _(p: Place) -> Words:
    s = p.copy()
    both(s, lambda v: swapped(v, p.channels[0], p.channels[1]))
    return train(p, s)


@fault("channels permuted, by another session")
def _(p: Place) -> Words:
    s = p.copy(p.b)
    both(s, lambda v: swapped(v, p.channels[0], p.channels[-1]))
    return train(p, p.a, s, device=False)


@fault("channels permuted in a table of signals")
def _(p: Place) -> Words:
    s = p.copy()
    both(s, lambda v: swapped(v, p.channels[0], p.channels[-1]))
    return train(p, *pair(p, s / SAMPLES, ".c3d"))


@fault("channel at its converter's end for a third", TOLD)
def _(p: Place) -> Words:
    s, c = p.copy(), p.channels[0] + "_ohm"

    def clip(v: dict[str, Float]) -> None:
        if c in v:
            v[c] = np.minimum(v[c], np.quantile(v[c], 0.66))

    both(s, clip)
    return train(p, s)


@fault("channel at its converter's end for most")
def _(p: Place) -> Words:
    s, c = p.copy(), p.channels[0] + "_ohm"

    def clip(v: dict[str, Float]) -> None:
        if c in v:
            v[c] = np.minimum(v[c], np.quantile(v[c], 0.3))

    both(s, clip)
    return train(p, s)


def lost(p: Place, value: float, part: float) -> Words:
    s, c = p.copy(), p.channels[1]

    def change(v: dict[str, Float]) -> None:
        n = len(v["time"])
        for name in (c, c + "_ohm"):
            if name in v:
                begin = n // 5 if part < 0.8 else 0
                v[name][begin : begin + round(part * n)] = value

    both(s, change)
    return train(p, s)


@fault("channel open for a tenth", TOLD)
def _(p: Place) -> Words:
    return lost(p, np.inf, 0.1)


@fault("channel open for most")
def _(p: Place) -> Words:
    return lost(p, np.inf, 0.7)


@fault("channel shorted for a tenth", TOLD)
def _(p: Place) -> Words:
    return lost(p, 0.0, 0.1)


@fault("no number (NaN) in a channel for a tenth", TOLD)
def _(p: Place) -> Words:
    return lost(p, np.nan, 0.1)


@fault("no number (NaN) in all of a channel")
def _(p: Place) -> Words:
    return lost(p, np.nan, 1.0)


@fault("channel constant")
def _(p: Place) -> Words:
    s = p.copy()
    both(s, one_sample(p.channels[0], 1000.0))
    return train(p, s)


@fault("channel constant in one of two sessions")
def _(p: Place) -> Words:
    s = p.copy(p.b)
    both(s, one_sample(p.channels[0], 1000.0))
    return train(p, p.a, s)


@fault("channel stuck for ten seconds", TOLD)
def _(p: Place) -> Words:
    s, c = p.copy(), p.channels[0] + "_ohm"

    def stick(v: dict[str, Float]) -> None:
        if c in v:
            when = (v["time"] > 40) & (v["time"] < 50)
            v[c][when] = v[c][when][0]

    both(s, stick)
    return train(p, s)


@fault("all resistances negative")
def _(p: Place) -> Words:
    s = p.copy()

    def change(v: dict[str, Float]) -> None:
        for c in p.channels:
            if c + "_ohm" in v:
                v[c + "_ohm"] *= -1

    both(s, change)
    return train(p, s)
