"""Rest, frames, clocks, cords and numbers that are not what they should be."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.damage.channels import swapped
from benchmarks.damage.copies import (
    TOLD,
    Place,
    Words,
    both,
    columns,
    edited,
    fault,
    pair,
    shorter,
    tell,
    tracks,
    train,
)
from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.capture.sessions.result_files import ALIGNED, QUALITY, SAMPLES
from defsense_fab.core.arrays import Float
from defsense_fab.core.markers import Tracks


def scaled(session: Path, channel: str, gain: float, ohm: float) -> None:
    """Another cord: of `ohm` times the resistance, and `gain` times as sensitive."""

    def change(values: dict[str, Float]) -> None:
        s = gain * values[channel]
        if channel + "_ohm" in values:
            R0 = np.median(values[channel + "_ohm"] / (1 + values[channel]))
            values[channel + "_ohm"] = ohm * R0 * (1 + s)
        values[channel] = s

    both(session, change)
    quality = json.loads((session / QUALITY).read_text(encoding="utf-8"))
    names = json.loads((session / "session.json").read_text(encoding="utf-8"))["channels"]
    for R0 in quality["R0"].values():
        R0[names.index(channel)] *= ohm
    tell(session / QUALITY, R0=quality["R0"])


@fault("no rest pose: markers 10 mm off")
def _(p: Place) -> Words:
    s = p.copy()
    tracks(s, lambda t: replace(t, points=t.points + 6.0))
    return train(p, s)


@fault("no rest pose: never let go")
def _(p: Place) -> Words:
    s = p.copy()

    def held(t: Tracks) -> Tracks:
        rest = np.nanmedian(t.points[t.time < 3], axis=0)
        off = np.sqrt(np.nanmean(((t.points - rest) ** 2).sum(axis=2), axis=1))
        return t.part(off > 5.0)

    tracks(s, held)
    tell(s / QUALITY, frames=len(read_tracks(s / ALIGNED).time))
    return train(p, s)


@fault("no rest at the beginning of a pair without markers.json", TOLD)
def _(p: Place) -> Words:
    s = p.copy()
    ohm = p.new / "ohm.csv"

    def begun(v: dict[str, Float]) -> None:
        for name in list(v):
            if name != "time" and not name.endswith("_ohm"):
                del v[name]
        for name in v:
            v[name] = v[name][400:].copy()

    columns(s / SAMPLES, begun)
    shutil.move(s / SAMPLES, ohm)
    tracks(s, lambda t: t.part(t.time > 7))
    return train(p, *pair(p, ohm, session=s)[:4], device=False)


@fault("too few frames: 40 with markers")
def _(p: Place) -> Words:
    s = p.copy()
    tracks(s, lambda t: t.part(slice(0, 40)))
    tell(s / QUALITY, frames=40)
    return train(p, s)


@fault("a few seconds of frames", TOLD)
def _(p: Place) -> Words:
    s = p.copy()
    shorter(s, 4.0)
    return train(p, s)


@fault("twenty seconds of frames", TOLD)
def _(p: Place) -> Words:
    s = p.copy()
    shorter(s, 20.0)
    return train(p, s)


def hidden(t: Tracks, part: float) -> Tracks:
    gone = np.random.default_rng(1).random(len(t.time)) < part
    points, sigma = t.points.copy(), t.sigma.copy()
    points[gone], sigma[gone] = np.nan, np.nan
    return replace(t, points=points, sigma=sigma)


@fault("frames without markers: most", TOLD)
def _(p: Place) -> Words:
    s = p.copy()
    tracks(s, lambda t: hidden(t, 0.7))
    return train(p, s)


@fault("frames without markers: all")
def _(p: Place) -> Words:
    s = p.copy()
    tracks(s, lambda t: hidden(t, 2.0))
    return train(p, s)


def later(p: Place, seconds: float, session: Path | None = None) -> Path:
    s = p.copy(session)

    def change(v: dict[str, Float]) -> None:
        if "counter" in v:
            v["time"] += seconds

    both(s, change)
    return s


@fault("signals 0.5 s late")
def _(p: Place) -> Words:
    return train(p, later(p, 0.5))


@fault("signals 0.5 s early, in a pair with C3D")
def _(p: Place) -> Words:
    return train(p, *pair(p, later(p, -0.5) / SAMPLES, ".c3d"))


@fault("signals 0.5 s late, --shift auto", TOLD)
def _(p: Place) -> Words:
    return train(p, later(p, 0.5), "--shift", "auto")


@fault("signals 0.15 s late", TOLD)
def _(p: Place) -> Words:
    return train(p, later(p, 0.15))


@fault("signals 3 s late")
def _(p: Place) -> Words:
    return train(p, later(p, 3.0))


@fault("signals 3 s late, --shift auto")
def _(p: Place) -> Words:
    return train(p, later(p, 3.0), "--shift", "auto")


@fault("signals 3 s late, a pair with --offset auto", TOLD)
def _(p: Place) -> Words:
    return train(p, *pair(p, later(p, 3.0) / SAMPLES), "--offset", "auto")


@fault("signals 1000 s late")
def _(p: Place) -> Words:
    return train(p, later(p, 1000.0))


@fault("0.5 s late in the model's evaluation", TOLD)
def _(p: Place) -> Words:
    return ["evaluate", p.model, later(p, 0.5, p.b)]


@fault("cord replaced since: R0 1.5 times", TOLD)
def _(p: Place) -> Words:
    s = p.copy(p.b)
    scaled(s, p.channels[0], 1.0, 1.5)
    return train(p, p.a, s)


@fault("cord replaced since: 1.6 times as sensitive", TOLD)
def _(p: Place) -> Words:
    s = p.copy(p.b)
    scaled(s, p.channels[0], 1.6, 1.0)
    return train(p, p.a, s)


@fault("cord replaced since, in the model's evaluation", TOLD)
def _(p: Place) -> Words:
    s = p.copy(p.b)
    scaled(s, p.channels[0], 1.6, 1.5)
    return ["evaluate", p.model, s]


@fault("channels permuted in the model's evaluation", TOLD)
def _(p: Place) -> Words:
    s = p.copy(p.b)
    both(s, lambda v: swapped(v, p.channels[0], p.channels[-1]))
    return ["evaluate", p.model, s]


@fault("NaN in times of samples", TOLD)
def _(p: Place) -> Words:
    s = p.copy()

    def change(v: dict[str, Float]) -> None:
        if "counter" in v:
            v["time"][100:160] = np.nan

    both(s, change)
    return train(p, s)


@fault("one coordinate of a marker is NaN")
def _(p: Place) -> Words:
    s = p.copy()

    take = p.new / "take.npz"
    words = pair(p, s / SAMPLES, ".npz")
    with np.load(take) as data:
        told = dict(data)
    told["points"][50:80, 2, 1] = np.nan
    np.savez(take, **told)
    return train(p, *words)


@fault("a coordinate is no number in aligned.csv")
def _(p: Place) -> Words:
    s = p.copy()
    edited(s / ALIGNED, 90, 3, "nan")
    return train(p, s)


@fault("a coordinate is infinite in aligned.csv")
def _(p: Place) -> Words:
    s = p.copy()
    edited(s / ALIGNED, 90, 3, "inf")
    return train(p, s)


@fault("a word among the samples")
def _(p: Place) -> Words:
    s = p.copy()
    edited(s / SAMPLES, 90, 8, "Ohm")
    return train(p, s)


@fault("R0 is NaN in quality.json")
def _(p: Place) -> Words:
    s = p.copy()
    tell(s / QUALITY, R0={"run-1": [float("nan"), 1000.0, 1000.0]})
    return train(p, s)


@fault("R0 of too few channels in quality.json")
def _(p: Place) -> Words:
    s = p.copy()
    tell(s / QUALITY, R0={"run-1": [1000.0]})
    return train(p, s)


@fault("R0 is a word in quality.json")
def _(p: Place) -> Words:
    s = p.copy()
    tell(s / QUALITY, R0={"run-1": ["high"] * len(p.channels)})
    return train(p, s)
