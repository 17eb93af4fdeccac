"""Send frames as a stream of the Lab Streaming Layer (LabRecorder, OpenViBE, MATLAB and others)."""

from __future__ import annotations

import os
import time
from collections import deque
from pathlib import Path

import numpy as np

from ...core.errors import OutputError
from ..frames.live_frame import LiveFrame
from .output import finite_or_zero, has_all_controls
from .settings import LslSettings

try:
    import pylsl
except RuntimeError as problem:  # the package is installed, the library that it calls is not
    raise OutputError(
        "the library liblsl is not installed",
        code="library-missing",
        where="lsl",
        action="Install it (conda install -c conda-forge liblsl, or"
        " https://github.com/sccn/liblsl/releases) and set PYLSL_LIB to its path",
    ) from problem

_CONFIG_FILE = "lsl_api.cfg"
_CLOCK_WINDOW_S = 20.0  # over which clocks are compared
_MAX_CLOCK_JUMP_S = 5.0  # of a sample; after a larger one the comparison restarts

Channel = tuple[str, str, str]  # label, unit and type


def silence_warnings() -> None:
    """Let the library print only errors, unless the user has a configuration of it.

    Its warnings quote data from the network, with all control characters.
    """
    folders = (Path(), Path.home() / "lsl_api", Path("/etc/lsl_api"))
    if "LSLAPICFG" not in os.environ and not any((f / _CONFIG_FILE).exists() for f in folders):
        pylsl.util.set_config_content("[log]\nlevel = -2\n")


silence_warnings()  # the library reads its configuration once, at its first call


class SampleClock:
    """Convert times from the board's clock to this machine's.

    Samples arrive late by a varying delay, never early. So the smallest difference of the last 20 s
    is that of the clocks.
    """

    def __init__(self) -> None:
        self._differences: deque[tuple[float, float]] = deque()
        self._last = -np.inf

    def __call__(self, sampled: float, arrived: float) -> float:
        """Return when a sample was taken, s, on the clock of `arrived`; it never decreases.

        Args:
            sampled: Time of the sample on the board's clock, s.
            arrived: Time of its arrival, s.
        """
        difference, queue = arrived - sampled, self._differences
        has_jumped = queue and abs(difference - queue[0][1]) > _MAX_CLOCK_JUMP_S
        if queue and (sampled < queue[-1][0] or has_jumped):
            queue.clear()  # the board was reset, or stood still
        # The queue increases in both times: its first entry is the smallest of the window.
        while queue and queue[-1][1] >= difference:
            queue.pop()
        queue.append((sampled, difference))
        while queue[0][0] < sampled - _CLOCK_WINDOW_S:
            queue.popleft()
        self._last = max(self._last, sampled + queue[0][1])
        return self._last


class LslOutput:
    """An `Output` as a stream.

    The channels of a stream cannot change, and receivers would lose a stream that restarts. So a
    stream with controls starts only when these are known.

    Args:
        settings: Name and channels of the stream.
    """

    name, trouble = "lsl", None

    def __init__(self, settings: LslSettings) -> None:
        self._settings, self._clock = settings, SampleClock()
        self._outlet: pylsl.StreamOutlet | None = None
        self._channels: list[Channel] = []
        self._stream = settings.stream

    @property
    def about(self) -> str:
        """Description of the stream."""
        if self._outlet is None:
            return "lsl: the stream starts when the resistances at rest are known"
        return f"lsl: stream {self._stream!r} of {len(self._channels)} channels"

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Label, unit and type of the channels; empty before the stream starts."""
        return tuple(self._channels)

    def send(self, frame: LiveFrame) -> None:
        """Send a frame.

        Raises:
            OutputError: The device has none of the selected channels.
        """
        needs_controls = not {"controls", "confidence"}.isdisjoint(self._settings.send)
        if self._outlet is None and needs_controls and not has_all_controls(frame):
            return
        channels, values = channel_values(frame, self._settings.send)
        if not channels:
            raise OutputError(
                f"{frame.device} has no {' and no '.join(self._settings.send)}",
                code="nothing-to-send",
                where="lsl",
                action='Give the folder of the built device, or set send = ["markers", "quality"]',
                send=self._settings.send,
            )
        if self._outlet is None or channels != self._channels:
            self._open(frame, channels)
        assert self._outlet is not None
        shift = pylsl.local_clock() - time.monotonic()
        stamp = self._clock(finite_or_zero(frame.time), frame.arrived + shift)
        self._outlet.push_sample(values, stamp)

    def close(self) -> None:
        """End the stream."""
        self._outlet = None  # the library ends it with the last reference

    def _open(self, frame: LiveFrame, channels: list[Channel]) -> None:
        self._outlet = None
        self._stream, self._channels = self._settings.stream or frame.device, channels
        info = pylsl.StreamInfo(
            self._stream,
            "Deformation",
            len(channels),
            pylsl.IRREGULAR_RATE,  # only the newest frame is sent: some are left out
            pylsl.cf_float32,
            f"defsense-{frame.device}",
        )
        description = info.desc()
        description.append_child_value("manufacturer", "defsense-fab")
        description.append_child_value("device", frame.device)
        list_of_channels = description.append_child("channels")
        for label, unit, kind in channels:
            channel = list_of_channels.append_child("channel")
            for key, value in (("label", label), ("unit", unit), ("type", kind)):
                channel.append_child_value(key, value)
        self._outlet = pylsl.StreamOutlet(info)


def channel_values(frame: LiveFrame, send: tuple[str, ...]) -> tuple[list[Channel], list[float]]:
    """Return the channels of a stream and their values in a frame, NaN where unknown.

    Args:
        frame: The frame.
        send: Kinds of channels, as in `LslSettings.send`.
    """
    channels, values = list[Channel](), list[float]()
    if "controls" in send:
        channels += [(name, "normalized", "control") for name in frame.controls]
        values += map(float, frame.controls.values())
    if "confidence" in send:
        channels += [
            (f"{name}.confidence", "normalized", "confidence") for name in frame.confidence
        ]
        values += map(float, frame.confidence.values())
    if "signals" in send:
        channels += [(name, "dimensionless", "signal") for name in frame.channels]
        values += frame.signals.tolist()
    if "markers" in send and frame.targets is not None:
        r = frame.targets.axes
        channels += [
            (name, frame.targets.units[k // r] or "unknown", "target")
            for k, name in enumerate(frame.targets.columns())
        ]
        values += frame.markers.ravel().tolist()
    elif "markers" in send:
        channels += [
            (f"{number}.{axis}", "millimeters", f"Position{axis.upper()}")
            for number in frame.ids
            for axis in "xyz"
        ]
        values += frame.markers.ravel().tolist()
    if "quality" in send:
        channels.append(("quality", "level", "quality"))
        values.append(float(frame.quality.level))
    return channels, values
