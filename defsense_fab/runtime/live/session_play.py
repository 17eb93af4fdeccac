"""Play a recorded session as a source, together with the marker positions that cameras saw."""

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

_FULL_SCALE = 1 << 24  # counts of a converter that is finer than any in use
_MAX_TRACK_GAP_S = 0.1  # between two pictures, for markers to be interpolated
_MICROS_RANGE = 1 << 32  # of the board's clock


def is_session(path: Path) -> bool:
    """Tell whether a folder is that of a session, or of one of its runs."""
    return any(manifest_path(folder) is not None for folder in (path, path.parent))


class SessionPlay(PacedSamples):
    """A `Source` that plays a run of a processed session at its own pace.

    Args:
        path: Folder of the session, whose first run is played, or of a run.
        device: The device, if it is known.
        board_channels: Names of the channels in the order of the read-out board.
        ids: Numbers of the model's markers (m,).
        reference: Resistors of the dividers (c,), ohm, in the order of `board_channels`.

    Raises:
        LiveError: The session has other channels, or the run was not processed.
        TrainingError: The session cannot be read.
    """

    def __init__(
        self,
        path: Path,
        device: Device | None,
        board_channels: Sequence[str],
        ids: Int,
        reference: Float,
    ) -> None:
        is_whole = manifest_path(path) is not None
        folder = path if is_whole else path.parent
        dataset = session_dataset([folder], device)
        if set(dataset.channels) != set(board_channels):
            raise LiveError(
                f"has the channels {', '.join(dataset.channels)}, and the model"
                f" {', '.join(board_channels)}",
                code="channels-differ",
                where=path,
                action="Give a session of the device that the model was trained on",
            )
        runs = {Path(r.name).name: r for r in dataset.recordings}
        if not is_whole and path.name not in runs:
            raise LiveError(
                f"was not processed; processed runs: {', '.join(runs)}",
                code="run-not-processed",
                where=path,
                action="Process the session, or choose one of these runs",
                run=path.name,
                runs=tuple(runs),
            )
        super().__init__(str(path))
        self._run: Recording = next(iter(runs.values())) if is_whole else runs[path.name]
        self._ids, self._dataset_ids = np.asarray(ids), list(dataset.ids)
        columns = [dataset.channels.index(name) for name in board_channels]
        counts = Dividers(reference, _FULL_SCALE).counts(self._run.ohm[:, columns])
        self._counts = np.where(np.isfinite(counts), np.rint(counts), NOT_READ).astype(np.int64)
        self._device_us = np.rint(1e6 * (self._run.sample_time - self._run.sample_time[0]))

    def tracks(self, time: float) -> Float:
        """Return where cameras saw the model's markers (m, 3), mm; NaN where they did not.

        Args:
            time: Time of a sample, s.
        """
        r = self._run
        flat = r.points.reshape(len(r.time), -1)
        times = np.array([time + r.sample_time[0]])
        positions = interpolate_at(times, r.time, flat, _MAX_TRACK_GAP_S).reshape(-1, 3)
        invisible = np.full(3, np.nan)
        known = self._dataset_ids
        return np.array([positions[known.index(i)] if i in known else invisible for i in self._ids])

    def start(self) -> Info:
        """Start playing; return the description of a read-out board with these readings."""
        interval = float(np.median(np.diff(self._run.sample_time)))
        c = self._counts.shape[1]

        def sample(k: int) -> tuple[int, Sample]:
            micros, sums = int(self._device_us[k]), tuple(int(s) for s in self._counts[k])
            return micros, Sample(k, micros % _MICROS_RANGE, False, False, 1, sums)

        self._play((1000 * self._device_us).astype(np.int64), sample)
        return Info(1, (0, 0), 0, c, 1, round(1 / interval), 0, c, _FULL_SCALE)
