"""Simulate training sessions of a built device, and write them like recorded ones."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...capture.sessions.results import QUALITY
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import read_markers
from ...core.progress import Progress, silent
from ...core.storage.files import load_json
from ...twin.devices.twin_traits import TwinTraits as TwinTraits
from ...twin.recordings.twin_recordings import TwinRuns, simulate_runs
from ..sessions.twin_sessions import ASSUMPTIONS, check_free, session_folder, write_sessions
from .options import TwinOptions

_ACTION = "Simulate the session again"


@dataclass(frozen=True)
class WrittenTwin:
    """Simulated sessions and their folders.

    Attributes:
        folders: Folders of the sessions.
        runs: The sessions, with their truth.
        frames: Number of pictures in all sessions.
    """

    folders: tuple[Path, ...]
    runs: TwinRuns
    frames: int

    @property
    def assumptions(self) -> Path:
        """The page with every assumed number and its source."""
        return self.folders[0] / ASSUMPTIONS

    def to_json(self) -> dict[str, Any]:
        """Return the sessions and their accuracy in plain values."""
        dataset, fields = self.runs.dataset, self.runs.fields
        return {
            "sessions": [str(f) for f in self.folders],
            "frames": self.frames,
            "channels": list(dataset.channels),
            "markers": len(dataset.ids),
            "states": len(fields.space.states),
            "interpolation_mm": fields.error,
            "interpolation_signal": fields.signal_error,
            "warnings": list(fields.warnings),
            **{key: dataset.provenance[key] for key in ("unit", "seed", "cords", "off")},
        }


def twin_traits(device: Device, options: TwinOptions) -> TwinTraits:
    """Return all assumptions of a device's twin.

    Raises:
        CaptureError: There is no trait of a name in `options.off` (`unknown-trait`).
        DeviceError: The cameras are invalid.
    """
    return TwinTraits.for_device(device, options).disable_traits(options.off)


def simulate_recordings(
    device: Device,
    options: TwinOptions | None = None,
    *,
    out: Path | None = None,
    progress: Progress = silent,
) -> WrittenTwin:
    """Simulate training sessions of a built device, and write them.

    The first call solves the displacement fields of the device, which takes minutes.

    Args:
        device: The device.
        options: Options of the sessions.
        out: Folder of the session; of several sessions, the parent of `session-1`, `session-2`, ...
            None for `twin-UNIT-SEED` in the device's folder.
        progress: Called with the progress.

    Raises:
        CaptureError: The device is not built or cannot be simulated, or a folder exists.
        StorageError: Files cannot be written.
    """
    options = options or TwinOptions()
    twin_traits(device, options)  # invalid options are reported before the simulation starts
    out = out or session_folder(device, options.unit, options.seed)
    check_free(out, options.sessions)
    tags = options.markers or (device.source / "markers" if options.cameras else None)
    markers = read_markers(tags) if tags else None
    runs = simulate_runs(device, options, markers=markers, progress=progress)
    folders = tuple(write_sessions(out, device, runs, progress))
    frames = [load_json(folder / QUALITY, CaptureError, _ACTION)["frames"] for folder in folders]
    return WrittenTwin(folders, runs, sum(map(int, frames)))
