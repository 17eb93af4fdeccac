"""How many cords a device should have: error against their number, as table and picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...core.device.device import Device
from ...core.errors import LayoutError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...core.storage.files import digest, storage_errors
from ...optimize.prediction.as_built import assumed_cords
from ...optimize.prediction.compare_layouts import ComparedLayout
from ...optimize.prediction.design_task import SEED, candidate_decoders, load_task
from ...optimize.prediction.predict import predict
from ...optimize.studies.cord_count import find_knee, layouts_by_count
from ..build.build import build
from ..build.stages import plain, stage_keys
from .cord_count_file import Row, chain, read_rows, write_rows

FILE, PICTURE = "study.json", "study.png"
#: Where the decoder is to be found, cords are designed for what it may need of them.
_RICH = "quadratic"


@dataclass(frozen=True)
class Study:
    """Rows by number of cords, the number recommended, the decoder that they are for, how there are
    unseen states (see decoding/expected_errors.py), why the study ends early if it does, the files."""

    rows: tuple[Row, ...]
    knee: int
    decoder: str
    how: str
    ended: str
    file: Path
    picture: Path


def study_folder(device: Device) -> Path:
    """Where a device's study is, whether it is there or not."""
    return device.source / "study"


def study_key(device: Device, folder: Path) -> str:
    """What a study's rows depend on, for the build of a `folder`."""
    d = device
    chosen = plain((d.cord, d.converter, d.fabrication, d.outputs, d.decoder, d.planes))
    return digest(stage_keys(device, folder)["simulate"], chosen)


def studied_layouts(device: Device, folder: Path) -> list[ComparedLayout]:
    """The best layouts by number of cords that a study of the device, as it is built in `folder`,
    has left; none where there was none. Their errors are as designed."""
    rows = read_rows(study_folder(device) / FILE, study_key(device, folder))
    best = {r.sensors: r for r in sorted(rows, key=lambda r: -r.unseen)}
    return [
        ComparedLayout(f"study, {n} cords" if n > 1 else "study, 1 cord", r.layout, r.unseen)
        for n, r in sorted(best.items())
    ]


def study(device: Device, least: int, most: int, progress: Progress = silent) -> Study:
    """Find the best layouts of `least` to `most` cords for the device's poses; with `auto` each
    number has the decoder that does best on unseen states.

    Each number is written to `study/` beside `device.toml` when it is done, and a study that was
    interrupted goes on from there. Cords drawn in `device.toml` are left out of account.
    """
    result = build(device, "simulate", progress)
    task = load_task(device, result.results)
    kinds = candidate_decoders(device, task)
    task = task.with_decoder(_RICH if _RICH in kinds else kinds[0])
    folder = study_folder(device)
    key = study_key(device, result.folder)
    with storage_errors(folder):
        folder.mkdir(exist_ok=True)
        rows = read_rows(folder / FILE, key)
    found = chain(rows, least)
    begun = found[0].begun if found else least
    counts = range(found[-1].sensors + 1 if found else least, most + 1)
    search = layouts_by_count(
        task.design,
        counts,
        SEED,
        partial(progress, "study"),
        begin=found[-1].layout if found else (),
        planes=device.planes,
    )
    ended = ""
    try:
        with one_blas_thread():
            for count, layout in search:
                cords = assumed_cords(task, layout)
                scored = [predict(task.with_decoder(k), cords).prediction for k in kinds]
                prediction = min(scored, key=lambda p: p.unseen)
                found.append(
                    Row(
                        count,
                        prediction.unseen,
                        prediction.rmse,
                        prediction.rmse_noise_free,
                        prediction.floor,
                        prediction.decoder,
                        begun,
                        layout,
                    )
                )
                rows = [r for r in rows if (r.begun, r.sensors) != (begun, count)] + found[-1:]
                with storage_errors(folder):
                    write_rows(folder / FILE, key, rows)
    except LayoutError as error:
        if not found:
            raise
        ended = str(error)
    shown = tuple(r for r in found if least <= r.sensors <= most)
    recommended = find_knee([r.sensors for r in shown], np.array([r.unseen for r in shown]))
    with storage_errors(folder):
        _draw(shown, recommended, device.name, folder / PICTURE)
    return Study(
        shown, recommended, device.decoder, task.unseen.how, ended, folder / FILE, folder / PICTURE
    )


def _draw(rows: tuple[Row, ...], best: int, name: str, path: Path) -> None:
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator

    figure = Figure(figsize=(7, 4.5), dpi=120, layout="constrained")
    axis = figure.subplots()
    counts = [r.sensors for r in rows]
    for label, values, style in (
        ("on unseen states", [r.unseen for r in rows], "s-"),
        ("fitted, with noise", [r.rmse for r in rows], "o--"),
        ("fitted, without noise", [r.rmse_noise_free for r in rows], "o:"),
        ("floor of affine maps, all states", [r.floor for r in rows], "-"),
    ):
        shown = np.where(np.array(values) > 1e-4, values, np.nan)
        if np.isfinite(shown).any():
            axis.semilogy(counts, shown, style, label=label)
    # The floor falls to nothing; the picture is about the errors.
    axis.set_ylim(bottom=min(r.rmse_noise_free for r in rows) / 3)
    axis.axvline(best, color="0.7", zorder=0, label=f"recommended: {best}")
    axis.set(xlabel="cords", ylabel="RMSE of the markers, mm", title=name, xticks=counts)
    axis.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    for which in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        which(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.grid(True, which="both", alpha=0.25)
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig(path)
