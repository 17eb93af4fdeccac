"""Sources of a live run's samples: a port, the simulated device, a recording, or a session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import cast, get_args

import numpy as np

from ...capture.readout.ports import open_port
from ...capture.readout.reader import Reader, ReadoutSettings
from ...capture.readout.recording import Replay
from ...capture.readout.source import PacedSamples, Source
from ...core.arrays import Float, Int
from ...core.device.device import Device
from ...core.errors import LiveError
from ...core.progress import Progress
from ...core.storage.session_manifest import manifest_path
from ...decoding.signal_history import interpolate_at
from ...sensing.serial_frames import NOT_READ, Info, Sample
from ...sensing.voltage_divider import Dividers
from ...training.data.dataset import Recording
from ...training.recordings.datasets import match_to_device
from ...training.recordings.session_dataset import session_dataset
from ...twin.electronics.fault_words import parse_faults
from ...twin.options import CordFamilyName, TwinOptions
from ...twin.recordings.walking_board import WalkingBoard, simulate_walking_board
from .live_device import LiveDevice

#: Port of the simulated device.
TWIN = "twin"
_REPLAY = "replay"
_TWIN_DEFAULTS = {"unit": 1, "seed": 101, "minutes": 5}
_MAX_TWIN_MINUTES = 60
_FULL_SCALE = 1 << 24  # counts of a converter that is finer than any in use
_MAX_TRACK_GAP_S = 0.1  # between two pictures, for markers to be interpolated
_MICROS_RANGE = 1 << 32  # of the board's clock


@dataclass(frozen=True)
class Port:
    """Where samples come from, by the text that the user gives.

    Attributes:
        text: A serial port, socket://host:port, udp://HOST or tcp://HOST, the .csv file of a
            recording, a recording or a session (replay:PATH), or the twin (twin, or
            twin:unit=1,seed=7,minutes=5,cut=A@20-30).
    """

    text: str

    @property
    def is_twin(self) -> bool:
        """Whether the device is simulated."""
        return self.text.partition(":")[0] == TWIN

    @property
    def is_replay(self) -> bool:
        """Whether a recording is played."""
        return self.text.partition(":")[0] == _REPLAY or self.text.endswith(".csv")

    @property
    def path(self) -> Path:
        """Path of the recording that is played."""
        kind, _, path = self.text.partition(":")
        return Path(path if kind == _REPLAY else self.text)


def open_source(
    live: LiveDevice, port: Port, rate: int, reference: Float, twin: WalkingBoard | None
) -> Source:
    """Return the source of a port.

    Args:
        live: The device.
        port: The port.
        rate: Sampling rate, Hz.
        reference: Resistors of the dividers (c,), ohm, in the model's order.
        twin: The simulated device of a twin's port.

    Raises:
        LiveError: The recording does not exist or does not fit the device.
        TrainingError: The session cannot be read.
    """
    if port.is_replay:
        path = port.path
        if path.is_dir() and is_session(path):
            order = [live.model.channels.index(name) for name in live.board_channels]
            return SessionPlay(
                path, live.device, live.board_channels, live.model.ids, reference[order]
            )
        if not path.is_file():
            raise LiveError(
                "the recording does not exist",
                code="file-not-found",
                where=path,
                action="Give a board.csv, or the folder of a session",
            )
        return Replay(path)
    opener = partial(open_port, port.text) if twin is None else twin.open
    settings = ReadoutSettings(channels=len(live.model.channels), rate=rate)
    return Reader(opener, port.text, settings, keep_items=False)


def open_twin(live: LiveDevice, port: Port, progress: Progress) -> WalkingBoard | None:
    """Simulate the device of a twin's port.

    Args:
        live: The device.
        port: The port.
        progress: Progress callback.

    Returns:
        None for other ports.

    Raises:
        LiveError: The device is not built, or an option of the twin is not valid.
        CaptureError: A fault is not valid.
    """
    if not port.is_twin:
        return None
    words = port.text.partition(":")[2]
    if live.device is None or live.states is None:
        raise LiveError(
            "a twin needs a built device",
            code="not-built",
            where=port.text,
            action="Give the folder of the built device",
        )
    values, faults = dict(_TWIN_DEFAULTS), []
    cords: CordFamilyName | None = TwinOptions.cords
    for word in filter(None, words.split(",")):
        name, equals, number = word.partition("=")
        if equals and name in values and number.isdecimal():
            values[name] = int(number)
        elif name == "cords" and number in get_args(CordFamilyName):
            cords = cast(CordFamilyName, number)
        elif "@" in word:
            faults.append(word)
        else:
            raise LiveError(
                f"{word!r} is not an option of the twin",
                code="unknown-twin-option",
                where=port.text,
                action="Use any of twin:unit=1,seed=7,minutes=5,cut=NAME@20-30,"
                f"cords={' or cords='.join(get_args(CordFamilyName))}",
                option=word,
            )
    if not 1 <= values["minutes"] <= _MAX_TWIN_MINUTES:
        raise LiveError(
            f"minutes must be from 1 to {_MAX_TWIN_MINUTES}, not {values['minutes']}",
            code="out-of-range",
            where=port.text,
            field="minutes",
        )
    return simulate_walking_board(
        live.device,
        unit=values["unit"],
        cords=cords,
        seed=values["seed"],
        seconds=60.0 * values["minutes"],
        faults=parse_faults(live.board_channels, faults),
        progress=progress,
    )


def is_session(path: Path) -> bool:
    """Return whether a folder is that of a session, or of one of its runs."""
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
        dataset = match_to_device(session_dataset(folder), device)
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
