"""A dataset that can be trained on: loaded, put in step where that was asked for, and checked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from ...core.device import Device
from ...core.progress import Progress, silent
from ...training.dataset import Dataset
from ...training.dataset_checks import checked
from ...training.in_step import find_shift, shifted
from .datasets import load_datasets

_WORTH_A_WORD = 0.02  # s


def prepare(
    sources: Sequence[Path], device: Device | None, *, signals: Path | None = None,
    tracks: Path | None = None, markers: Path | None = None,
    offset: float | Literal["auto"] = 0.0, shift: float | Literal["auto"] = 0.0,
    progress: Progress = silent,
) -> tuple[Dataset, list[str]]:  # fmt: skip
    """The dataset of `load_datasets`, with the times of its samples later by `shift` s, and notes.
    Raises TrainingError for what forbids training."""
    progress("data", 0.0, "reading")
    dataset = load_datasets(
        sources, device, signals=signals, tracks=tracks, markers=markers, offset=offset
    )
    notes = []
    if shift == "auto":
        progress("data", 0.4, "putting signals and markers in step")
        found = {r.name: find_shift(r) for r in dataset.recordings}
        by = {name: s.seconds for name, s in found.items() if s and abs(s.seconds) > _WORTH_A_WORD}
        notes = [f"{name}: signals are shifted by {s:+.2f} s" for name, s in by.items()]
        dataset = shifted(dataset, by)
    elif shift:
        dataset = shifted(dataset, shift)
    progress("data", 0.6, "checking")
    notes += [str(problem) for problem in checked(dataset)]
    progress("data", 1.0, "done")
    return dataset, notes
