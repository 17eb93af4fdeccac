"""The number of cords of a device: error over number, as table and picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.device.device import Device
from ...core.errors import LayoutError, StorageError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...core.storage import typed_json
from ...core.storage.files import digest, storage_errors
from ...decoding.expected_errors import MEANING
from ...optimization.prediction.as_built import assumed_cords
from ...optimization.prediction.design_task import SEED, DesignTask, candidate_decoders, load_task
from ...optimization.prediction.predict import predict
from ...optimization.search.starting_layouts import Layout
from ...optimization.studies.cord_count import find_knee, layouts_by_count
from ...store.layout import CordPath
from ..build.build import build
from ..build.stages import plain, stage_keys
from ..design.compare_layouts import ComparedLayout
from .options import StudyOptions

FILE, PICTURE = "study.json", "study.png"
#: Cords are designed for this decoder if the decoder is not chosen yet.
DESIGN_DECODER = "quadratic"
_NO_OPTIONS = StudyOptions()


@dataclass(frozen=True)
class StudiedCord(CordPath):
    """A cord with the unrounded axes (3, 3) of its plane.

    A search that resumes from rounded axes could find other layouts.
    """

    axes: Float


@dataclass(frozen=True)
class Row:
    """The best layout of a number of cords; it grows from the one with one cord less.

    Attributes:
        sensors: Number of cords.
        unseen: RMSE in unseen states with the noise of the read-out, mm.
        rmse: RMSE in the states of the design with noise, mm.
        rmse_noise_free: RMSE in the states of the design without noise, mm.
        floor: Smallest RMSE of an affine map over all states, mm.
        decoder: The decoder of the layout.
        cords: The layout.
    """

    sensors: int
    unseen: float
    rmse: float
    rmse_noise_free: float
    floor: float
    decoder: str
    cords: tuple[StudiedCord, ...]

    @property
    def layout(self) -> Layout:
        """The layout, as the search continues it."""
        return tuple(replace(c.sensor(), plane=Plane(c.plane.origin, c.axes)) for c in self.cords)


def studied_cords(layout: Layout) -> tuple[StudiedCord, ...]:
    """Return the cords of a layout as they are stored."""
    return tuple(StudiedCord(**vars(CordPath.of(s)), axes=s.plane.axes) for s in layout)


@dataclass(frozen=True)
class StudyRecord:
    """The content of `study.json`: the rows and the hash of their inputs."""

    SCHEMA: ClassVar[int] = 3

    key: str
    rows: tuple[Row, ...]


def read_rows(path: Path, key: str) -> list[Row]:
    """Return the rows for inputs with the hash `key`; none if the file is for others or damaged."""
    try:
        record = typed_json.load(path, StudyRecord, "it is started again")
    except StorageError:
        return []
    return list(record.rows) if record.key == key else []


def write_rows(path: Path, key: str, rows: Sequence[Row]) -> None:
    """Write the rows.

    Raises:
        StorageError: The file cannot be written.
    """
    typed_json.save(path, StudyRecord(key, tuple(rows)))


@dataclass(frozen=True)
class CordCountStudy:
    """The results of a study of the number of cords.

    Attributes:
        rows: Layouts by number of cords.
        knee: Recommended number.
        decoder: The decoder of the device.
        how: How unseen states are tested (see `decoding/expected_errors.py`).
        ended: Why the study ended early; else empty.
        file: File of the rows.
        picture: File of the picture.
    """

    rows: tuple[Row, ...]
    knee: int
    decoder: str
    how: str
    ended: str
    file: Path
    picture: Path

    @property
    def test_description(self) -> str:
        """How unseen states are tested, as a sentence."""
        return MEANING[self.how]


def study_folder(device: Device) -> Path:
    """Return the folder of a device's study."""
    return device.source / "study"


def study_key(device: Device, folder: Path) -> str:
    """Return the hash of all inputs of a study, for a build in a folder."""
    d = device
    chosen = plain((d.cord, d.converter, d.fabrication, d.outputs, d.decoder, d.planes))
    return digest(stage_keys(device, folder)["simulate"], chosen)


def studied_layouts(device: Device, folder: Path) -> list[ComparedLayout]:
    """Return the best layouts by number of cords of an earlier study of the device.

    Args:
        device: The device.
        folder: Folder of its build.

    Returns:
        The layouts with the errors of the design; none without a study.
    """
    rows = read_rows(study_folder(device) / FILE, study_key(device, folder))
    return [
        ComparedLayout(
            f"study, {r.sensors} cords" if r.sensors > 1 else "study, 1 cord", r.layout, r.unseen
        )
        for r in rows
    ]


def study_cord_count(
    device: Device, progress: Progress = silent, *, options: StudyOptions = _NO_OPTIONS
) -> CordCountStudy:
    """Find the best layouts for a range of numbers of cords.

    If the decoder of the device is `auto`, each number has the decoder with the smallest error in
    unseen states. Each finished number is written to `study/` next to `device.toml`, from where an
    interrupted study resumes. Cords that are drawn in `device.toml` are ignored.

    Args:
        device: The device.
        progress: Called with the progress.
        options: The numbers of cords; `workers` and `scheduler` do not apply.

    Raises:
        LayoutError: No layout with the smallest number can be found.
    """
    counts = options.cord_counts
    result = build(device, "simulate", progress)
    task = load_task(device, result.results)
    kinds = candidate_decoders(device, task)
    task = task.with_decoder(DESIGN_DECODER if DESIGN_DECODER in kinds else kinds[0])
    folder = study_folder(device)
    key = study_key(device, result.folder)
    with storage_errors(folder):
        folder.mkdir(exist_ok=True)
        rows = read_rows(folder / FILE, key)
    if not rows or not rows[0].sensors <= counts[0] <= rows[-1].sensors + 1:
        rows = []  # a search continues from the layout with one cord less
    search = layouts_by_count(
        task.design,
        range(rows[-1].sensors + 1 if rows else counts[0], counts[-1] + 1),
        SEED,
        partial(progress, "study"),
        previous=rows[-1].layout if rows else (),
        planes=device.planes,
    )
    ended = ""
    try:
        with one_blas_thread():
            for count, layout in search:
                rows.append(_evaluate(task, kinds, layout, count))
                with storage_errors(folder):
                    write_rows(folder / FILE, key, rows)
    except LayoutError as error:
        if not rows:
            raise
        ended = str(error)
    shown = tuple(r for r in rows if r.sensors in counts)
    recommended = find_knee([r.sensors for r in shown], np.array([r.unseen for r in shown]))
    with storage_errors(folder):
        _draw(shown, recommended, device.name, folder / PICTURE)
    return CordCountStudy(
        shown,
        recommended,
        device.decoder,
        task.unseen.how,
        ended,
        folder / FILE,
        folder / PICTURE,
    )


def _evaluate(task: DesignTask, kinds: Sequence[str], layout: Layout, count: int) -> Row:
    """Return the row of a layout with the best of these decoders."""
    cords = assumed_cords(task, layout)
    predictions = [predict(task.with_decoder(k), cords).prediction for k in kinds]
    best = min(predictions, key=lambda p: p.unseen)
    return Row(
        count,
        best.unseen,
        best.rmse,
        best.rmse_noise_free,
        best.floor,
        best.decoder,
        studied_cords(layout),
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
    # The floor falls to zero; the picture shows the errors.
    axis.set_ylim(bottom=min(r.rmse_noise_free for r in rows) / 3)
    axis.axvline(best, color="0.7", zorder=0, label=f"recommended: {best}")
    axis.set(xlabel="cords", ylabel="RMSE of the markers, mm", title=name, xticks=counts)
    axis.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    for which in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        which(FuncFormatter(lambda v, _: f"{v:g}"))
    axis.grid(True, which="both", alpha=0.25)
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig(path)
