"""A recording as a source: its samples come again, at the pace at which they came."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from ...sensing.serial_frames import Info, Sample
from .paced_samples import PacedSamples
from .recording import Recording, read_recording

_PAUSE = 1_000_000_000  # ns between one run of a recording and the next


def _one_run(r: Recording) -> tuple[Int, Int]:
    """When samples came, ns from the first, and the device's clock, us: of a file that several runs
    were recorded into, the next goes on where the last ended, as both clocks begin anew."""
    starts = {at for at, event in r.events if event.get("event") == "start"}
    host, micros = np.diff(r.host_ns, prepend=r.host_ns[:1]), np.diff(r.device_us, prepend=0)
    anew = (host < 0) | np.isin(np.arange(len(host)), [at for at in starts if at > 0])
    micros[0] = r.device_us[0]
    return np.cumsum(np.where(anew, _PAUSE, host)), np.cumsum(
        np.where(anew, _PAUSE // 1000, micros)
    )


class Replay(PacedSamples):
    """A `Source` that plays `path`, `speed` times as fast as it was recorded."""

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        super().__init__(str(path))
        self._path, self._speed = path, speed

    def start(self) -> Info:
        """Raises CaptureError for a file that is no recording, an empty one, or one that does not
        tell what the read-out board was."""
        r = read_recording(self._path)
        names = set(Info.__dataclass_fields__)
        about = next((e for _, e in r.events if names <= set(e)), None)
        if not len(r.counter):
            raise CaptureError(f"{self.name}: has no samples to play", code="recording-empty")
        if about is None:
            raise CaptureError(
                f"{self.name}: no event tells what the read-out board was: the line of its"
                " 'start' was lost; copy that of another recording of this read-out board below"
                " the columns, or record again",
                code="board-unknown",
            )
        host, device_us = _one_run(r)

        def sample(k: int) -> tuple[int, Sample]:
            micros, sums = int(device_us[k]), tuple(int(s) for s in r.sums[k])
            flags = bool(r.led[k]), bool(r.late[k]), int(r.averages[k])
            return micros, Sample(int(r.counter[k]), micros % (1 << 32), *flags, sums)

        self._play((host / self._speed).astype(np.int64), sample)
        return Info(**{n: about[n] for n in names})
