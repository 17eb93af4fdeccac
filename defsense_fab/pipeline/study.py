"""How many cords a device should have: error against their number, as table and picture."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..core.device import Device
from ..core.errors import LayoutError
from ..core.files import digest, storage_errors, write_json
from ..core.progress import Progress, silent
from ..optimize.seeds import Layout
from ..optimize.study import by_count, knee
from .build import build
from .layout_file import read_sensor, write_sensor
from .stage_optimize import SEED, load_task, predict
from .stages import keys, plain, read_json

FILE, PICTURE = "study.json", "study.png"


@dataclass(frozen=True)
class Row:
    """RMSE in mm of the best layout of up to so many cords: on the states that it was designed on,
    with the read-out's noise and without, on those held out (nan without any); the affine floor."""

    sensors: int
    rmse: float
    rmse_noise_free: float
    held_out: float
    floor: float
    layout: list[dict[str, Any]]


@dataclass(frozen=True)
class Study:
    """Rows by number of cords, the number recommended, why it ends early if it does, the files."""

    rows: tuple[Row, ...]
    knee: int
    ended: str
    file: Path
    picture: Path


def study(device: Device, least: int, most: int, progress: Progress = silent) -> Study:
    """Find the best layouts of `least` to `most` cords for the device's poses.

    Each number is written to `study/` beside `device.toml` when it is done, and a study that was
    interrupted goes on from there. Cords drawn in `device.toml` are left out of account.
    """
    result = build(device, "simulate", progress)
    task = load_task(device, result.folder)
    folder = device.source / "study"
    key = digest(
        keys(device)["simulate"],
        plain((device.cord, device.fabrication, device.outputs, device.decoder)),
    )
    with storage_errors(folder):
        folder.mkdir(exist_ok=True)
        rows = _read(folder / FILE, key)
    counts = [n for n in range(least, most + 1) if n not in rows]
    ended = ""
    while counts:
        run = [n for i, n in enumerate(counts) if n == counts[0] + i]  # a gap begins anew
        counts = counts[len(run) :]
        before = rows.get(run[0] - 1)
        begin: Layout = tuple(map(read_sensor, before.layout)) if before else ()
        search = by_count(
            task.design, run, np.random.default_rng(SEED), partial(progress, "study"), begin
        )
        try:
            for count, layout in search:
                prediction, _ = predict(task.everything, layout, task.names, task.held)
                unseen = np.array(list(prediction.held_out.values()))
                rows[count] = Row(
                    count,
                    prediction.rmse,
                    prediction.rmse_noise_free,
                    float(np.sqrt((unseen**2).mean())) if len(unseen) else float("nan"),
                    task.design.floor(count),
                    [write_sensor(s) for s in layout],
                )
                with storage_errors(folder):
                    _write(folder / FILE, key, rows)
        except LayoutError as error:
            if not rows:
                raise
            ended = str(error)
            break
    shown = tuple(rows[n] for n in sorted(rows) if least <= n <= most)
    best = knee([r.sensors for r in shown], np.array([r.rmse for r in shown]))
    with storage_errors(folder):
        _draw(shown, best, device.name, folder / PICTURE)
    return Study(shown, best, ended, folder / FILE, folder / PICTURE)


def _read(path: Path, key: str) -> dict[int, Row]:
    try:
        data = read_json(path)
    except (FileNotFoundError, ValueError):
        return {}
    if not isinstance(data, dict) or data.get("key") != key or data.get("schema") != 1:
        return {}
    nan = float("nan")
    rows = [
        Row(**{**r, "held_out": nan if r["held_out"] is None else r["held_out"]})
        for r in data["rows"]
    ]
    return {r.sensors: r for r in rows}


def _write(path: Path, key: str, rows: dict[int, Row]) -> None:
    out = [asdict(rows[n]) for n in sorted(rows)]
    for r in out:
        r["held_out"] = None if np.isnan(r["held_out"]) else r["held_out"]
    write_json(path, {"schema": 1, "key": key, "rows": out})


def _draw(rows: tuple[Row, ...], best: int, name: str, path: Path) -> None:
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

    figure = Figure(figsize=(7, 4.5), dpi=120, layout="constrained")
    axis = figure.subplots()
    counts = [r.sensors for r in rows]
    for label, values, style in (
        ("held-out states", [r.held_out for r in rows], "s--"),
        ("predicted, with noise", [r.rmse for r in rows], "o-"),
        ("without noise", [r.rmse_noise_free for r in rows], "o:"),
        ("affine floor, without noise", [r.floor for r in rows], "-"),
    ):
        shown = np.where(np.array(values) > 1e-4, values, np.nan)
        if np.isfinite(shown).any():
            axis.semilogy(counts, shown, style, label=label)
    # The floor falls to nothing; the picture is about the errors.
    axis.set_ylim(bottom=min(r.rmse_noise_free for r in rows) / 3)
    axis.axvline(best, color="0.7", zorder=0, label=f"recommended: {best}")
    axis.set(xlabel="cords", ylabel="RMSE of the markers, mm", title=name, xticks=counts)
    axis.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.grid(True, which="both", alpha=0.25)
    axis.legend()
    figure.savefig(path)
