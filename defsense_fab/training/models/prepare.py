"""A dataset that can be trained on: put in step where that was asked for, and require_trainable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import DefsenseError, TrainingError
from ...core.progress import Progress, silent
from ..data.dataset import Dataset
from ..data.dataset_assembly import exclude_markers, exclude_uncertain_positions
from ..data.dataset_checks import require_trainable
from ..data.problems import raise_fatal
from ..data.time_alignment import align_samples
from ..data.unit_checks import check_cord_resistance, check_units
from ..recordings.data_files import told_files
from ..recordings.datasets import of_device
from ..recordings.pair_dataset import Offset
from ..regression.frames import Frames
from ..regression.simulation_prior import Prior, measure_coverage, predict_signals
from .simulated_prior import simulated_prior

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
