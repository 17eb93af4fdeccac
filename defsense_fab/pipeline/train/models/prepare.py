"""A dataset that can be trained on: loaded, put in step where that was asked for, and checked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from ....core.device import Device
from ....core.errors import DefsenseError, TrainingError
from ....core.progress import Progress, silent
from ....training.data.dataset import Dataset
from ....training.data.dataset_checks import checked
from ....training.data.in_step import find_shift, shifted
from ....training.ridge.frames import Frames
from ....training.simulation.coverage import coverage
from ....training.simulation.expected_signals import expected_signals
from ....training.simulation.prior import Prior
from ..data.datasets import load_datasets
from .simulated_prior import simulated_prior

AUTO, YES, NO = "auto", "yes", "no"

_WORTH_A_WORD = 0.02  # s


def prepare(
    sources: Sequence[Path], device: Device | None, *, signals: Path | None = None,
    tracks: Path | None = None, markers: Path | None = None,
    offset: float | Literal["auto"] = 0.0, shift: float | Literal["auto"] = 0.0,
    wanted: str = "auto", progress: Progress = silent,
) -> tuple[Dataset, Prior | None, list[str]]:  # fmt: skip
    """The dataset of `load_datasets`, with the times of its samples later by `shift` s; what the
    simulation says of its device, if that is `wanted`; and notes: what is doubtful, and what was
    not shown. Raises TrainingError for what forbids training."""
    progress("data", 0.0, "reading")
    dataset = load_datasets(
        sources, device, signals=signals, tracks=tracks, markers=markers, offset=offset
    )
    notes: list[str] = []
    if shift == "auto":
        progress("data", 0.4, "putting signals and markers in step")
        found = {r.name: find_shift(r) for r in dataset.recordings}
        by = {name: s.seconds for name, s in found.items() if s and abs(s.seconds) > _WORTH_A_WORD}
        notes = [f"{name}: signals are shifted by {s:+.2f} s" for name, s in by.items()]
        dataset = shifted(dataset, by)
    elif shift:
        dataset = shifted(dataset, shift)
    progress("data", 0.6, "checking")
    prior, why = found_prior(dataset, device, wanted)
    notes += why
    predicted = {}
    if prior is not None:
        predicted = {
            r.name: expected_signals(prior, r, dataset.rest_points) for r in dataset.recordings
        }
    notes += [str(problem) for problem in checked(dataset, predicted=predicted)]
    if prior is not None:
        notes += coverage(Frames.all_of(dataset), prior).advice
    progress("data", 1.0, "done")
    return dataset, prior if wanted != NO else None, notes


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
