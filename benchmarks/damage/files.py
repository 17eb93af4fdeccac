"""Files, datasets and models that are cut off, edited, or others."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from benchmarks.damage.copies import (
    REFUSED,
    TOLD,
    Place,
    Words,
    columns,
    cut,
    fault,
    pair,
    run,
    tell,
    train,
)
from defsense_fab.capture.files.formats import read_tracks, write_tracks
from defsense_fab.capture.sessions.result_files import ALIGNED, QUALITY, SAMPLES, SIGNALS
from defsense_fab.core.arrays import Float

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
    t = read_tracks(p.new / "take.csv")
    write_tracks(p.new / "take.csv", replace(t, points=t.points / 1000, sigma=t.sigma / 1000))
    return train(p, *words)


@fault("tracks of other markers")
def _(p: Place) -> Words:
    words = pair(p, p.a / SAMPLES)
    t = read_tracks(p.new / "take.csv")
    write_tracks(p.new / "take.csv", replace(t, ids=t.ids + 500))
    return train(p, *words)


@fault("markers' numbers exchanged")
def _(p: Place) -> Words:
    words = pair(p, p.a / SAMPLES)
    t = read_tracks(p.new / "take.csv")
    write_tracks(p.new / "take.csv", replace(t, points=t.points[:, ::-1]))
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
