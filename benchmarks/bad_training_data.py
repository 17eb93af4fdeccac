"""Damaged training data, each tried on the command line: what is said, and with which exit code.

    defsense twin my-device --minutes 4 --sessions 2
    python -m benchmarks.bad_training_data my-device/twin-1-1/session-* --device my-device

Two processed sessions of one built device, of a run each, are cut to so many seconds, and each
fault is made in a copy: the files that a user would have. `defsense train` (or what the fault is
about) is run on it. Told are the exit code and the words that the same command does not say of the
whole sessions. A fault is caught where training refuses (exit code 2, one line, no model) or, of
those that are marked `told`, where it says what is doubtful and trains all the same; `no one` is
told of what is no fault. `--only WORD` tries those whose names have the word.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import shutil
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from defsense_fab.capture.files.formats import read_any, write_any
from defsense_fab.cli.main import main as defsense
from defsense_fab.core.arrays import Float
from defsense_fab.core.tracks import Tracks
from defsense_fab.pipeline.sessions.result_files import ALIGNED, QUALITY, SAMPLES, SIGNALS
from defsense_fab.pipeline.train.data.tables import read_table

REFUSED, TOLD, SILENT = "refused", "told", "no one"
#: What is said of whole sessions, too.
_USUAL = ("note: *:", "note: trained on", "note: memory", "note: 100% of the simulated")
_PAIRS = ("in the device's frame as given", "R0: that of the file's own", "R0: the median at rest")
_QUICK = ("--decoder", "affine", "--no-memory")


@dataclass(frozen=True)
class Place:
    """Whole sessions `a` and `b`, the built `device`, its `channels`, a `model` of `a`, and an
    empty folder `new` for damaged copies."""

    a: Path
    b: Path
    device: Path
    channels: tuple[str, ...]
    model: Path
    new: Path

    def copy(self, of: Path | None = None) -> Path:
        """Of a session."""
        return Path(shutil.copytree(of or self.a, self.new / (of or self.a).name))


Words = list[str | Path]


@dataclass(frozen=True)
class Fault:
    """What is damaged by `make`, which returns the command's words; what is `due`."""

    name: str
    due: str
    make: Callable[[Place], Words]


FAULTS: list[Fault] = []


def fault(name: str, due: str = REFUSED) -> Callable[[Callable[[Place], Words]], None]:
    def add(make: Callable[[Place], Words]) -> None:
        FAULTS.append(Fault(name, due, make))

    return add


# --- changes of files


def columns(path: Path, change: Callable[[dict[str, Float]], None]) -> None:
    """Of a table, by their names."""
    table = read_table(path)
    values = {name: table[name] for name in table.names}
    change(values)
    rows = np.column_stack(list(values.values()))
    lines = [",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in rows]
    head = ",".join(values)
    if table.run:
        head, lines = f"run,{head}", [f"{table.run[0]},{line}" for line in lines]
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def both(session: Path, change: Callable[[dict[str, Float]], None]) -> None:
    """The signals of the samples and those at the pictures."""
    for name in (SAMPLES, SIGNALS):
        columns(session / name, change)


def tracks(session: Path, change: Callable[[Tracks], Tracks]) -> None:
    write_any(session / ALIGNED, change(read_any(session / ALIGNED)))


def tell(path: Path, **changes: object) -> None:
    data = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(data | changes), encoding="utf-8")


def cut(path: Path, part: float = 0.6) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])


def shorter(session: Path, seconds: float) -> None:
    """Only its beginning."""
    for name in (SAMPLES, SIGNALS):
        table = read_table(session / name)
        keep = [True, *(table["time"] < seconds).tolist()]
        lines = (session / name).read_text(encoding="utf-8").splitlines()
        kept = [line for line, k in zip(lines, keep, strict=True) if k]
        (session / name).write_text("\n".join(kept) + "\n", encoding="utf-8")
    tracks(session, lambda t: t.part(t.time < seconds))
    tell(session / QUALITY, frames=len(read_any(session / ALIGNED).time))


def train(place: Place, *words: str | Path, device: bool = True) -> Words:
    given: Words = ["--device", place.device] if device else []
    return ["train", *words, *given, *_QUICK]


def pair(place: Place, signals: Path, suffix: str = ".csv", session: Path | None = None) -> Words:
    """The options of two files of a session."""
    session = session or place.a
    take = place.new / f"take{suffix}"
    write_any(take, read_any(session / ALIGNED))
    return ["--signals", signals, "--tracks", take, "--markers", session / "markers.json"]


def swapped(values: dict[str, Float], one: str, two: str) -> None:
    for end in ("", "_ohm"):
        if one + end in values:
            a, b = values[one + end], values[two + end]
            values[one + end], values[two + end] = b.copy(), a.copy()


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


def one_sample(channel: str, value: float) -> Callable[[dict[str, Float]], None]:
    """All of a channel is this, ohm; its signals are left as they are."""

    def change(values: dict[str, Float]) -> None:
        if channel + "_ohm" in values:
            values[channel + "_ohm"][:] = value

    return change


# --- the faults


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
    tell(s / QUALITY, frames=len(read_any(s / ALIGNED).time))
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


def edited(path: Path, line: int, column: int, cell: str) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    cells = lines[line].split(",")
    cells[column] = cell
    lines[line] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


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


for _file in (SAMPLES, SIGNALS, ALIGNED, QUALITY, "session.json", "markers.json"):

    @fault(f"{_file} cut off")
    def _(p: Place, file: str = _file) -> Words:
        s = p.copy()
        cut(s / file, 0.601)
        return train(p, s)

    @fault(f"{_file} cut off at a line's end", TOLD if _file == SAMPLES else REFUSED)
    def _(p: Place, file: str = _file) -> Words:
        s = p.copy()
        lines = (s / file).read_text(encoding="utf-8").splitlines()
        kept = lines[: int(0.6 * len(lines))]
        (s / file).write_text("\n".join(kept) + "\n", encoding="utf-8")
        return train(p, s)

    @fault(f"{_file} empty")
    def _(p: Place, file: str = _file) -> Words:
        s = p.copy()
        (s / file).write_text("", encoding="utf-8")
        return train(p, s)

    @fault(f"{_file} is no text")
    def _(p: Place, file: str = _file) -> Words:
        s = p.copy()
        (s / file).write_bytes(bytes(range(256)) * 50)
        return train(p, s)


for _suffix in (".c3d", ".trc", ".parquet", ".npz", ".csv"):

    @fault(f"tracks {_suffix} cut off", TOLD if _suffix == ".csv" else REFUSED)
    def _(p: Place, suffix: str = _suffix) -> Words:
        words = pair(p, p.a / SAMPLES, suffix)
        cut(p.new / f"take{suffix}", 0.601)
        return train(p, *words)


@fault("tracks in metres")
def _(p: Place) -> Words:
    words = pair(p, p.a / SAMPLES)
    t = read_any(p.new / "take.csv")
    write_any(p.new / "take.csv", replace(t, points=t.points / 1000, sigma=t.sigma / 1000))
    return train(p, *words)


@fault("tracks of other markers")
def _(p: Place) -> Words:
    words = pair(p, p.a / SAMPLES)
    t = read_any(p.new / "take.csv")
    write_any(p.new / "take.csv", replace(t, ids=t.ids + 500))
    return train(p, *words)


@fault("markers' numbers exchanged")
def _(p: Place) -> Words:
    words = pair(p, p.a / SAMPLES)
    t = read_any(p.new / "take.csv")
    write_any(p.new / "take.csv", replace(t, points=t.points[:, ::-1]))
    return train(p, *words)


@fault("times in ms")
def _(p: Place) -> Words:
    s = p.copy()
    columns(s / SAMPLES, lambda v: v.update(time=1000 * v["time"]))
    return train(p, *pair(p, s / SAMPLES))


@fault("resistances named as signals")
def _(p: Place) -> Words:
    s = p.copy()

    def change(v: dict[str, Float]) -> None:
        for c in p.channels:
            v[c] = v.pop(c + "_ohm")

    columns(s / SAMPLES, change)
    return train(p, *pair(p, s / SAMPLES))


@fault("a table without signals")
def _(p: Place) -> Words:
    s = p.copy()
    (s / SAMPLES).write_text("time\n0.1\n", encoding="utf-8")
    return train(p, *pair(p, s / SAMPLES))


@fault("dataset cut off")
def _(p: Place) -> Words:
    d = dataset(p)
    cut(d / "samples.parquet")
    return train(p, d)


@fault("dataset of which a file is gone")
def _(p: Place) -> Words:
    d = dataset(p)
    (d / "frames.parquet").unlink()
    return train(p, d)


def dataset(p: Place) -> Path:
    run(["dataset", p.a, "--device", p.device, "--out", p.new / "data"])
    return p.new / "data"


@fault("session not processed")
def _(p: Place) -> Words:
    s = p.copy()
    (s / QUALITY).unlink()
    return train(p, s)


@fault("the same session twice")
def _(p: Place) -> Words:
    return train(p, p.a, p.a)


@fault("a copy of the same session")
def _(p: Place) -> Words:
    return train(p, p.a, Path(shutil.copytree(p.a, p.new / "copy")))


@fault("model cut off")
def _(p: Place) -> Words:
    model = Path(shutil.copy(p.model, p.new / "m.json"))
    cut(model)
    return ["evaluate", model, p.b]


@fault("model of which a number was edited")
def _(p: Place) -> Words:
    model = p.new / "m.json"
    text = p.model.read_text(encoding="utf-8")
    at = text.index('"weights"') + 15
    k = next(i for i in range(at, len(text)) if text[i] in "12345678")
    model.write_text(text[:k] + str(int(text[k]) + 1) + text[k + 1 :], encoding="utf-8")
    return ["evaluate", model, p.b]


@fault("model with NaN")
def _(p: Place) -> Words:
    model = p.new / "m.json"
    data = json.loads(p.model.read_text(encoding="utf-8"))
    data["gain"][0] = float("nan")
    model.write_text(json.dumps(data), encoding="utf-8")
    return ["evaluate", model, p.b]


@fault("model cut off, to be re-calibrated")
def _(p: Place) -> Words:
    model = Path(shutil.copy(p.model, p.new / "m.json"))
    cut(model)
    return ["recalibrate", model, p.b]


@fault("model that is a session")
def _(p: Place) -> Words:
    return ["evaluate", p.a / "session.json", p.b]


@fault("model of another device")
def _(p: Place) -> Words:
    s = p.copy(p.b)
    tell(s / "session.json", device="bun")
    return ["evaluate", p.model, s]


# --- running them


def run(words: Words) -> tuple[int | None, list[str]]:
    """The exit code, None for a traceback, and what was said."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code: int | None = defsense([str(w) for w in words])
        except SystemExit as left:
            code = int(left.code or 0)
        except Exception:
            code = None
            err.write(traceback.format_exc())
    lines = [*out.getvalue().splitlines(), *err.getvalue().splitlines()]
    if code is None:
        return None, [next(x for x in reversed(lines) if x.strip())]
    kept = ("error: ", "note: ", "warning: ")
    return code, [line for line in lines if line.startswith(kept)]


def tried(one: Fault, place: Place) -> tuple[bool, int | None, list[str]]:
    """Whether it was caught, the exit code, and what was said."""
    place.new.mkdir()
    try:
        words = one.make(place)
        out = place.new / ("page" if words[0] == "evaluate" else "model.json")
        before = set(place.new.iterdir())
        code, said = run([*words, "--out", out])
        written = sorted(p.name for p in set(place.new.iterdir()) - before)
    finally:
        shutil.rmtree(place.new)
    told = [line.replace(f"{place.new}/", "") for line in said]
    told = [x for x in told if not x.startswith(_USUAL) and not any(w in x for w in _PAIRS)]
    if one.due == REFUSED:
        good = code == 2 and len(told) == 1 and not written
    else:
        good = code == 0 and bool(told) == (one.due == TOLD) and written == [out.name]
    if written and code != 0:
        told.append(f"left behind: {', '.join(written)}")
    return good, code, told


@contextlib.contextmanager
def places(options: argparse.Namespace) -> Iterator[Place]:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made).resolve()
        whole = [Path(shutil.copytree(s, folder / f"session-{k}")) for k, s in
                 enumerate((options.first, options.second), 1)]  # fmt: skip
        for session in whole:
            shorter(session, options.seconds)
        told = json.loads((whole[0] / "session.json").read_text(encoding="utf-8"))
        model = folder / "model.json"
        words: Words = ["train", whole[0], "--device", options.device, *_QUICK, "--out", model]
        code, said = run(words)
        if code != 0:
            sys.exit(f"the whole session cannot be trained on: {said}")
        channels = tuple(told["channels"])
        yield Place(whole[0], whole[1], options.device, channels, model, folder / "new")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("--device", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    os.environ["COLUMNS"] = "500"
    bad = count = 0
    with places(options) as place:
        for one in FAULTS:
            if options.only not in one.name:
                continue
            good, code, told = tried(one, place)
            count, bad = count + 1, bad + (not good)
            exit_code = "traceback" if code is None else code
            print(f"{'' if good else 'NOT CAUGHT: '}{one.name} [{one.due}]: exit {exit_code}")
            print("".join(f"    {line}\n" for line in told), end="", flush=True)
    print(f"{count - bad} of {count} faults are answered as is due")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
