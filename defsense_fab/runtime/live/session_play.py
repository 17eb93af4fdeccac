"""A recorded session as a source: what its cords said comes again, beside where its cameras saw
the markers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...capture.readout.source import PacedSamples
from ...core.arrays import Float, Int
from ...core.device.device import Device
from ...core.errors import LiveError
from ...core.storage.session_manifest import manifest_path
from ...decoding.signal_history import interpolate_at
from ...sensing.serial_frames import NOT_READ, Info, Sample
from ...sensing.voltage_divider import Dividers
from ...training.data.dataset import Recording
from ...training.recordings.session_dataset import session_dataset

_FULL_SCALE = 1 << 24  # counts of a converter that is finer than any that is built in
_BETWEEN = 0.1  # s between two pictures, at most, for a marker to be told in between


def is_session(path: Path) -> bool:
    """A session's folder, or that of one of its runs."""
    return any(manifest_path(folder) is not None for folder in (path, path.parent))


class SessionPlay(PacedSamples):
    """A `Source` that plays a run of a processed session at its own pace, with the dividers
    `reference` (c,) ohm in the order `wired`. Raises LiveError and TrainingError for what is not
    to be played."""

    def __init__(
        self, path: Path, device: Device | None, wired: Sequence[str], ids: Int, reference: Float
    ) -> None:
        whole = manifest_path(path) is not None
        folder = path if whole else path.parent
        dataset = session_dataset([folder], device)
        if set(dataset.channels) != set(wired):
            raise LiveError(
                f"{path}: has the channels {', '.join(dataset.channels)}, and the model"
                f" {', '.join(wired)}; give a session of the device that it was trained on"
            )
        runs = {Path(r.name).name: r for r in dataset.recordings}
        if not whole and path.name not in runs:
            raise LiveError(f"{path}: was not processed; there are {', '.join(runs)}")
        super().__init__(str(path))
        self._run: Recording = next(iter(runs.values())) if whole else runs[path.name]
        self._ids, self._known = np.asarray(ids), list(dataset.ids)
        counts = Dividers(reference, _FULL_SCALE).counts(
            self._run.ohm[:, [dataset.channels.index(name) for name in wired]]
        )
        self._counts = np.where(np.isfinite(counts), np.rint(counts), NOT_READ).astype(np.int64)
        self._device_us = np.rint(1e6 * (self._run.sample_time - self._run.sample_time[0]))

    def tracks(self, when: float) -> Float:
        """Where cameras saw the model's markers (m, 3) mm at a time, s, of the samples; NaN where
        they did not."""
        r = self._run
        flat = r.points.reshape(len(r.time), -1)
        at = interpolate_at(np.array([when + r.sample_time[0]]), r.time, flat, _BETWEEN)
        seen = at.reshape(-1, 3)
        nowhere = np.full(3, np.nan)
        return np.array([
            seen[self._known.index(i)] if i in self._known else nowhere for i in self._ids
        ])  # fmt: skip

    def start(self) -> Info:
        """The read-out board that the resistances would have been read by."""
        span = float(np.median(np.diff(self._run.sample_time)))
        c = self._counts.shape[1]

        def sample(k: int) -> tuple[int, Sample]:
            micros, sums = int(self._device_us[k]), tuple(int(s) for s in self._counts[k])
            return micros, Sample(k, micros % (1 << 32), False, False, 1, sums)

        self._play((1000 * self._device_us).astype(np.int64), sample)
        return Info(1, (0, 0), 0, c, 1, round(1 / span), 0, c, _FULL_SCALE)
