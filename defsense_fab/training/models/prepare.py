"""A dataset that can be trained on: put in step where that was asked for, and require_trainable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np

from ...core.arrays import Float
from ...core.device.build_folder import finished_build
from ...core.device.device import Device
from ...core.errors import DefsenseError, TrainingError
from ...core.progress import Progress, silent
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...sensing.built_cord import CordReading
from ...store.body import load_surface
from ...store.fields import INDEX, load_fields
from ...store.layout import LAYOUT, load_layout
from ...store.mesh import load_mesh
from ..data.dataset import Dataset
from ..data.dataset_assembly import exclude_markers, exclude_uncertain_positions
from ..data.dataset_checks import check_dataset, require_trainable
from ..data.problems import Problem, raise_fatal
from ..data.time_alignment import align_samples
from ..data.unit_checks import check_cord_resistance, check_units
from ..recordings import dataset_parquet, lerobot_export
from ..recordings.datasets import DataFiles, of_device, told_files
from ..recordings.pair_dataset import Offset
from ..regression.frames import Frames
from ..regression.simulation_prior import Prior, measure_coverage, predict_signals

# Data as datasets in files of their own: for training elsewhere, or later.


@dataclass(frozen=True)
class Exported:
    """What was written, what is wrong with it, those problems first that forbid training; and what
    else is worth a word."""

    dataset: Dataset
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]


def export_dataset(
    files: DataFiles, device: Device | None = None, *, parquet: Path | None = None,
    lerobot: Path | None = None, rate: int | None = None, progress: Progress = silent,
) -> Exported:  # fmt: skip
    """The data of `files`, checked against the `device` if it is given, into folders `parquet` and
    `lerobot`, that one at `rate` frames a second. Nothing is left out: problems are told, and
    training decides. Raises TrainingError, StorageError, and what the readers raise."""
    if parquet is not None:
        dataset_parquet.check_folder(parquet)
    if lerobot is not None:
        lerobot_export.check_free(lerobot)
    progress("data", 0.0, "reading")
    dataset, notes = files.in_step(files.load(device))
    progress("data", 0.5, "checking")
    prior, why = found_prior(dataset, device, AUTO)
    problems = check_dataset(dataset, predicted=foretold(prior, dataset))
    progress("data", 0.8, "writing")
    if parquet is not None:
        dataset_parquet.write_dataset(parquet, dataset)
    if lerobot is not None:
        lerobot_export.write_lerobot(lerobot, dataset, rate)
    progress("data", 1.0, "done")
    return Exported(dataset, problems, (*told_files(dataset), *notes, *why))


# The states of a device's build as a prior for its training, with the cord's response of today.

_OFF_BODY = 5.0  # mm: markers on printed tags lie above the skin, but not by more


def simulated_prior(device: Device, channels: tuple[str, ...], rest_points: Float) -> Prior:
    """Of the device's built layout for its `channels` and markers that are at rest at (m, 3) mm.
    Raises TrainingError for channels and markers that are not the device's."""
    folder = finished_build(device, LAYOUT, INDEX)
    fields = load_fields(folder)
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    cords = {
        record.name: record.built for record in load_layout(folder, TrainingError).by_channel()
    }
    if set(cords) != set(channels):
        raise TrainingError(
            f"{folder}: the device's cords are {', '.join(cords)}, the recordings' channels"
            f" {', '.join(channels)}: they are of another device or layout"
        )
    reading = CordReading.from_device(device)

    def moved(points: Float) -> Float:
        u = locator.displacement(locator.find(points), fields.displacements)
        return np.concatenate([np.zeros((1, *points.shape)), u])

    surface = load_surface(folder)
    square = igl.point_mesh_squared_distance(rest_points, surface.vertices, surface.faces)[0]
    off = np.where(locator.find(rest_points).depth < 0, np.sqrt(np.asarray(square)), 0.0)
    if (off > _OFF_BODY).any():
        k = int(off.argmax())
        raise TrainingError(
            f"marker {k + 1} at {np.round(rest_points[k], 1).tolist()} mm lies {off[k]:.0f} mm off"
            f" the body of {device.name}: the tracks are not in the device's rest frame, or of"
            " another device"
        )
    signals = [reading.signals(cords[n], cords[n].path + moved(cords[n].path)) for n in channels]
    return Prior(("rest", *fields.names), np.stack(signals, axis=1), moved(rest_points))


AUTO, YES, NO = "auto", "yes", "no"
_TOLD = 1e-3  # of the places, that are worth a word


def prepare(
    dataset: Dataset, device: Device | None, *, wanted: str = "auto", without: Sequence[int] = (),
    in_step: bool = False, shift: Offset = 0.0, progress: Progress = silent,
) -> tuple[Dataset, Prior | None, list[str]]:  # fmt: skip
    """The dataset, as the `device`'s, `without` some markers, its samples shifted (`align_samples`),
    checked (`in_step` as in `require_trainable`); what the simulation says of its device, if that is
    `wanted`; and notes: what is doubtful, and what was not shown. Raises TrainingError for what
    forbids training."""
    dataset = of_device(dataset, device)
    notes = told_files(dataset)
    seen = np.any([r.visible.any(axis=0) for r in dataset.recordings], axis=0)
    never = dataset.ids[~seen].tolist()
    if never and len(never) < len(dataset.ids):
        told = ", ".join(map(str, never))
        notes.append(f"marker {told} is never seen: the model does not tell where it is")
    if left_out := sorted({*without, *never}):
        dataset = exclude_markers(dataset, left_out)
    dataset, uncertain = exclude_uncertain_positions(dataset)
    notes += told_uncertain(uncertain)
    raise_fatal(check_units(dataset))
    if device is not None:
        raise_fatal(
            check_cord_resistance(dataset, device.cord.ohm_per_mm * device.cord.min_stretch)
        )
    progress("data", 0.4, "putting signals and markers in step")
    dataset, shifts = align_samples(dataset, shift)
    notes += shifts
    progress("data", 0.6, "checking")
    prior, why = found_prior(dataset, device, wanted)
    notes += why
    notes += [
        str(p)
        for p in require_trainable(
            dataset, predicted=foretold(prior, dataset), is_synchronized=in_step
        )
    ]
    units = sorted({r.unit for r in dataset.recordings})
    if len(units) > 1:
        notes.append(
            f"{', '.join(units)} are different devices: one model for all of them has the errors of"
            " what they differ by; train one for each"
        )
    if prior is not None:
        found = measure_coverage(Frames.from_dataset(dataset), prior)
        notes.append(f"{found.share:.0%} of the simulated states were shown")
        notes += found.advice
    progress("data", 1.0, "done")
    return dataset, prior if wanted != NO else None, notes


def told_uncertain(share: float) -> list[str]:
    """A note on the places that were left out, where they are worth one."""
    if share < _TOLD:
        return []
    return [
        f"{share:.1%} of the markers' places were seen at such a slant that the cameras hardly know"
        " them, and are left out"
    ]


def foretold(prior: Prior | None, dataset: Dataset) -> dict[str, Float]:
    """What the simulation lets expect of each recording's signals (t, c), by its name."""
    if prior is None:
        return {}
    return {r.name: predict_signals(prior, r, dataset.rest_points) for r in dataset.recordings}


def found_prior(
    dataset: Dataset, device: Device | None, wanted: str
) -> tuple[Prior | None, list[str]]:
    """What the device's simulation says, if it is built, and notes. Raises TrainingError where it
    is `wanted` and cannot be had."""
    if wanted not in (AUTO, YES, NO):
        raise TrainingError(f"--prior {wanted}: choose {AUTO}, {YES} or {NO}")
    if device is None:
        if wanted == YES:
            raise TrainingError("--prior yes needs --device DIR, a built device")
        return None, []
    try:
        return simulated_prior(device, dataset.channels, dataset.rest_points), []
    except DefsenseError as error:
        if wanted == YES:
            raise
        return None, [f"the simulation is not used: {error}"]
