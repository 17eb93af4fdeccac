"""Read the recordings of a folder, and divide them as all decoders and peers get them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float, Int
from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.data.dataset_assembly import exclude_channels
from defsense_fab.training.fitting.errors_by_unit import target_scale
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.recordings.table_dataset import table_dataset
from defsense_fab.training.regression.frames import Frames, assign_folds, split_frames

TENTHS = 10

#: What papers state on recordings of their sensors, by the DOI in the recording's README. Their
#: splits and subjects differ from those here.
PUBLISHED = {
    "10.1002/aisy.202400124": "2.34 deg within and 4.21 deg between subjects: mean angle error over"
    " five knee activities of 20 participants (abstract)",
}


@dataclass(frozen=True)
class Source:
    """A folder with a recording.

    Attributes:
        name: Name of the folder.
        signals: Tables of the signals, one for each run.
        targets: Tables of the targets.
        readme: Text of its README.md.
    """

    name: str
    signals: tuple[Path, ...]
    targets: tuple[Path, ...]
    readme: str

    @property
    def published(self) -> str:
        """What the sensor's paper states, if known."""
        return next((text for doi, text in PUBLISHED.items() if doi in self.readme), "")

    def read(self) -> Dataset:
        """Read the recording, without channels that never change."""
        dataset = table_dataset(self.signals, self.targets)
        values = np.concatenate([r.ohm for r in dataset.recordings])
        with np.errstate(all="ignore"):
            is_constant = ~(np.nanmax(values, axis=0) > np.nanmin(values, axis=0))
        names = [n for n, c in zip(dataset.channels, is_constant, strict=True) if c]
        return exclude_channels(dataset, names) if names else dataset


def find_sources(folder: Path | None, only: Sequence[str] = ()) -> list[Source]:
    """Find the recordings in the sub-folders of a folder.

    Args:
        folder: The folder; None if there is none.
        only: Names of the recordings to return; all if empty.

    Returns:
        The recordings by name; empty if the folder has none.
    """
    if folder is None or not folder.is_dir():
        return []
    sources = []
    for path in sorted(p for p in folder.iterdir() if p.is_dir()):
        pairs = [
            (s, t)
            for s in sorted(path.glob("*signals.csv"), key=_run_number)
            if (t := s.with_name(s.name.replace("signals", "targets"))).is_file()
        ]
        if pairs and (not only or path.name in only):
            readme = path / "README.md"
            text = readme.read_text(encoding="utf-8") if readme.is_file() else ""
            signals, targets = zip(*pairs, strict=True)
            sources.append(Source(path.name, signals, targets, text))
    return sources


def _run_number(path: Path) -> int:
    """Return the number in names such as run10-signals.csv; 0 without one."""
    match = re.match(r"run(\d+)-", path.name)
    return int(match.group(1)) if match else 0


@dataclass(frozen=True)
class Task:
    """A recording divided into frames to train on, with folds, and frames to test on.

    Attributes:
        dataset: The recording.
        train: Frames to train on.
        test: Frames to test on.
        fold: Fold of each frame to train on, shape (t,).
        scale: What errors of each target are divided by to compare decoders, shape (m,).
        options: Options with which `train` divides the recording in the same way.
    """

    dataset: Dataset
    train: Frames
    test: Frames
    fold: Int
    scale: Float
    options: TrainOptions

    @staticmethod
    def divide(dataset: Dataset, leave_out: tuple[str, ...] = ()) -> Task:
        """Divide a recording: the last 30 % in time is tested, or the named runs.

        Args:
            dataset: The recording.
            leave_out: Names of runs to test on.
        """
        options = TrainOptions(leave_out=leave_out)
        train, test = split_frames(
            Frames.from_dataset(dataset), options.test_share, options.leave_out
        )
        fold = assign_folds(len(train), options.folds)
        return Task(dataset, train, test, fold, target_scale(train), options)

    def rmse(self, predicted: Float, frames: Frames) -> float:
        """Return the root mean square error over all targets, scaled if they have several units."""
        error = np.linalg.norm(predicted - frames.points, axis=2) / self.scale
        return float(np.sqrt(np.nanmean(error**2)))

    def rmse_by_unit(self, predicted: Float) -> dict[str, float]:
        """Return the root mean square error on the test frames for each unit."""
        error = np.linalg.norm(predicted - self.test.points, axis=2)
        units = np.array(self.dataset.units)
        return {
            u: float(np.sqrt(np.nanmean(error[:, units == u] ** 2)))
            for u in dict.fromkeys(self.dataset.units)
        }

    @property
    def test_tenths(self) -> list[Int]:
        """Indices of the test frames in each tenth of the test."""
        return np.array_split(np.arange(len(self.test)), TENTHS)


def thirds_of_runs(dataset: Dataset) -> list[tuple[str, ...]]:
    """Return the names of the runs of each third, every third run in one; none of fewer than 3."""
    names = [r.name for r in dataset.recordings]
    return [tuple(names[k::3]) for k in range(3)] if len(names) >= 3 else []
