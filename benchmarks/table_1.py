"""The paper's Table 1 through the whole chain, before a twin's rendered cameras.

    python -m benchmarks.table_1 fixtures/devices/bar --out table-1 --seeds 5
    python -m benchmarks.table_1 fixtures/devices/bar --out table-1 --cameras webcam,cameras=3

Three devices are built, with manual, visual and full layouts (`optimize/search/baselines.py`). Of
each and for each seed, which is another built unit that is moved by another hand, a session is
filmed by rendered cameras while its read-out board is read, processed as a recorded one, and
trained on: 70 % of the pictures for training, the last `--frames` for the test. Told are RMSE ±
standard deviation of the frames, peak and average peak (mm) of the paper's affine decoder and of
the one that the folds choose, against where the cameras saw the markers, as in the paper, and of
the chosen one against where the twin's markers really were.

What is in `--out` already is taken as it is: a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from defsense_fab.capture.files.formats import read_any
from defsense_fab.cli.main import main as defsense
from defsense_fab.core.device import Sensor
from defsense_fab.core.device_file import load_device
from defsense_fab.decoding.trained_model import TrainedModel
from defsense_fab.optimize.search import baselines
from defsense_fab.pipeline.artifacts.layout import LAYOUT
from defsense_fab.pipeline.build.build import build
from defsense_fab.pipeline.design.design_task import load_task
from defsense_fab.pipeline.train.data.data_files import DataFiles
from defsense_fab.pipeline.train.evaluation.tables import PAPER
from defsense_fab.pipeline.train.models.model_file import load_model
from defsense_fab.pipeline.train.models.prepare import prepare as prepare_data
from defsense_fab.training.fitting.train_model import errors_of

LAYOUTS = ("manual", "visual", "full")
_TEST = 0.3
_COUNT = 3  # cords, as in the paper


def prepare(source: Path, out: Path) -> dict[str, Path]:
    """Built devices by the name of their layout."""
    full = _copied(source, out / "full")
    build(load_device(full), "fabricate")
    drawn: dict[str, Any] = {}
    if not all((out / name / source.name / "build" / LAYOUT).exists() for name in LAYOUTS):
        task = load_task(load_device(full), full / "build").design
        drawn["manual"] = baselines.manual(task, _COUNT)
        drawn["visual"] = baselines.visual(task, _COUNT, np.random.default_rng(0))
    for name, sensors in drawn.items():
        folder = _copied(source, out / name)
        text = (folder / "device.toml").read_text(encoding="utf-8")
        text = text[: text.index("[[sensors]]")] + "\n".join(map(_drawn, sensors))
        (folder / "device.toml").write_text(text, encoding="utf-8")
        build(load_device(folder), "fabricate")
    return {name: out / name / source.name for name in LAYOUTS}


def _copied(source: Path, into: Path) -> Path:
    folder = into / source.name
    if not folder.exists():
        shutil.copytree(source, folder, ignore=shutil.ignore_patterns("build", ".build*"))
    return folder


def _drawn(sensor: Sensor) -> str:
    """As in `device.toml`, to be kept as it is."""
    plane, points = sensor.plane, sensor.curve.points
    normal, along = (np.round(plane.axes[:, k], 6).tolist() for k in (2, 0))
    return (
        f'[[sensors]]\nname = "{sensor.name}"\nplane = {{ origin ='
        f" {np.round(plane.origin, 4).tolist()}, normal = {normal}, x_axis = {along} }}\n"
        f"control_points = {np.round(points, 3).tolist()}\nfree = []\n"
    )


def session_rows(
    device: Path, seed: int, tags: Path, options: argparse.Namespace
) -> dict[str, Any]:
    """The decoders' errors of one session, filmed now or before."""
    session, model = device / f"session-{seed}", device / f"model-{seed}.json"
    minutes = options.frames / _TEST / options.rate / 60
    if not (session / "truth.npz").exists():
        shutil.rmtree(session, ignore_errors=True)
        run("twin", str(device), "--cameras", options.cameras, "--rate", str(options.rate),
            "--minutes", f"{minutes:.4f}", "--seed", str(seed), "--unit", str(seed),
            "--markers", str(tags), "--out", str(session))  # fmt: skip
    rare = unseen(session)
    told = json.loads(
        run("train", str(session), "--device", str(device), "--out", str(model), "--json",
            "--without-markers", ",".join(map(str, rare)))
    )  # fmt: skip
    chosen = next(c for c in told["candidates"] if c["decoder"] == told["decoder"])
    return {
        "affine": told["candidates"][0]["test"],
        "best": chosen["test"],
        "decoder": told["decoder"],
        "truth": truth_errors(load_model(model), session, device),
        "tested": told["pictures"]["tested"],
        "markers": len(load_model(model).ids),
    }


def unseen(session: Path) -> list[int]:
    """Markers that the cameras see in less than a tenth of the pictures."""
    tracks = read_any(session / "aligned.csv")
    return [
        int(n) for n, seen in zip(tracks.ids, tracks.seen.mean(axis=0), strict=True) if seen < 0.1
    ]


def truth_errors(model: TrainedModel, session: Path, device: Path) -> dict[str, float]:
    """Of the last pictures, against the twin's truth."""
    with np.load(session / "truth.npz") as truth:
        order = [list(truth["ids"]).index(n) for n in model.ids]
        time, points = truth["time"], truth["points"][:, order].astype(float)
    last = slice(round((1 - _TEST) * len(time)), None)
    data, _, _ = prepare_data(DataFiles((session,)), load_device(device), wanted="no")
    r = data.recordings[0]
    found = model.decode(r.sample_time, r.signals, time[last])
    e = errors_of(found.points, points[last])
    return {"rmse": e.rmse, "peak": e.peak, "average_peak": e.average_peak}


def run(*words: str) -> str:
    """What a command prints. Raises SystemExit where it fails."""
    out = io.StringIO()
    with redirect_stdout(out):
        code = defsense(list(words))
    if code:
        raise SystemExit(f"defsense {' '.join(words)}: exit code {code}")
    return out.getvalue()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("device", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--frames", type=int, default=2040)
    parser.add_argument("--rate", type=float, default=15.0)
    parser.add_argument("--cameras", default="webcam")
    parser.add_argument("--side", default="0,-1,1", help="that the tags are on")
    options = parser.parse_args()
    devices = prepare(options.device, options.out)
    tags = options.out / "markers"
    if not tags.exists():
        run("capture", "markers", str(devices["full"]), f"--side={options.side}", "--skin",
            "--count", "20", "--size", "8", "--out", str(tags))  # fmt: skip
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in LAYOUTS}
    for seed in range(1, options.seeds + 1):
        for name in LAYOUTS:
            found = session_rows(devices[name], seed, tags, options)
            rows[name].append(found)
            a, b, t = found["affine"], found["best"], found["truth"]
            sys.stderr.write(
                f"seed {seed} {name}: {found['tested']} pictures, {found['markers']} markers;"
                f" affine {a['rmse']:.2f} ± {a['sd']:.2f} / {a['peak']:.1f} /"
                f" {a['average_peak']:.2f};"
                f" {found['decoder']} {b['rmse']:.2f} ± {b['sd']:.2f} / {b['peak']:.1f} /"
                f" {b['average_peak']:.2f}; against the truth {t['rmse']:.2f} / {t['peak']:.1f} /"
                f" {t['average_peak']:.2f}\n"
            )
    print("RMSE ± SD / peak / average peak, mm; mean over seeds (least to most RMSE)")
    for name in LAYOUTS:
        p = PAPER[name]
        print(
            f"{name:7} the paper {p.rmse:.2f} ± {p.deviation:.2f} / {p.peak:.1f} /"
            f" {p.average_peak:.2f}"
        )
        for kind in ("affine", "best"):
            x = {k: np.array([r[kind][k] for r in rows[name]]) for k in rows[name][0][kind]}
            print(
                f"        {kind:9} {x['rmse'].mean():.2f} ± {x['sd'].mean():.2f} /"
                f" {x['peak'].mean():.1f} / {x['average_peak'].mean():.2f}"
                f" ({x['rmse'].min():.2f}-{x['rmse'].max():.2f})"
            )
    for kind in ("affine", "best"):
        mean = {n: np.mean([r[kind]["rmse"] for r in rows[n]]) for n in LAYOUTS}
        print(f"{kind}: manual / full {mean['manual'] / mean['full']:.2f}, the paper's 3.81")


if __name__ == "__main__":
    main()
