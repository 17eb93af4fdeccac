"""A stream of the Lab Streaming Layer: to LabRecorder, OpenViBE, MATLAB and the like."""

from __future__ import annotations

import os
import time
from collections import deque
from pathlib import Path

import numpy as np

from ...core.errors import OutputError
from ..frames.live_frame import LiveFrame
from .output import controls_known, finite
from .settings import LslSettings

try:
    import pylsl
except RuntimeError as problem:  # the package is there, the library that it calls is not
    raise OutputError(
        "the library liblsl is not installed",
        code="library-missing",
        where="lsl",
        action="Install it (conda install -c conda-forge liblsl, or"
        " https://github.com/sccn/liblsl/releases) and set PYLSL_LIB to its path",
    ) from problem

_CONFIG = "lsl_api.cfg"


def _keep_quiet() -> None:
    """Only errors are written to the terminal: warnings quote what strangers sent, with all its
    control characters. Whoever has a configuration of the library decides that there."""
    places = (Path(), Path.home() / "lsl_api", Path("/etc/lsl_api"))
    if "LSLAPICFG" not in os.environ and not any((p / _CONFIG).exists() for p in places):
        pylsl.util.set_config_content("[log]\nlevel = -2\n")


_keep_quiet()  # the library reads its configuration once, with its first call

_WINDOW = 20.0  # s over which clocks are compared
_STRANGE = 5.0  # s by which a sample may be off the comparison before it begins anew


class SampleClock:
    """From the board's clock to this machine's: samples arrive late by a varying time, never early,
    so that the least difference of the last 20 s is the clocks'."""

    def __init__(self) -> None:
        self._differences: deque[tuple[float, float]] = deque()
        self._last = -np.inf

    def __call__(self, sampled: float, arrived: float) -> float:
        """When a sample was taken, on the clock of `arrived` (s); never before the one before."""
        d, queue = arrived - sampled, self._differences
        if queue and (sampled < queue[-1][0] or abs(d - queue[0][1]) > _STRANGE):
            queue.clear()  # the board was reset, or stood still
        # The queue rises in both: its first is the least of the window.
        while queue and queue[-1][1] >= d:
            queue.pop()
        queue.append((sampled, d))
        while queue[0][0] < sampled - _WINDOW:
            queue.popleft()
        self._last = max(self._last, sampled + queue[0][1])
        return self._last


class LslOutput:
    """An `Output` as a stream. Its channels cannot change, and receivers that know it would lose
    one that begins anew: with controls in it, it begins once they are known."""

    name, trouble = "lsl", None

    def __init__(self, settings: LslSettings) -> None:
        self._settings, self._clock = settings, SampleClock()
        self._outlet: pylsl.StreamOutlet | None = None
        self._channels: list[tuple[str, str, str]] = []
        self._stream = settings.stream

    @property
    def about(self) -> str:
        if self._outlet is None:
            return "lsl: the stream begins when the resistances at rest are known"
        return f"lsl: stream {self._stream!r} of {len(self._channels)} channels"

    def send(self, frame: LiveFrame) -> None:
        """Raises OutputError where the device has nothing of what is to be sent."""
        waits = not {"controls", "confidence"}.isdisjoint(self._settings.send)
        if self._outlet is None and waits and not controls_known(frame):
            return
        channels, values = sample(frame, self._settings.send)
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
        stamp = self._clock(finite(frame.time), frame.arrived + shift)
        self._outlet.push_sample(values, stamp)

    def close(self) -> None:
        self._outlet = None  # the library ends the stream with the last reference

    def _open(self, frame: LiveFrame, channels: list[tuple[str, str, str]]) -> None:
        self._outlet = None
        self._stream, self._channels = self._settings.stream or frame.device, channels
        info = pylsl.StreamInfo(
            self._stream,
            "Deformation",
            len(channels),
            pylsl.IRREGULAR_RATE,  # the newest frame wins: some are left out
            pylsl.cf_float32,
            f"defsense-{frame.device}",
        )
        top = info.desc()
        top.append_child_value("manufacturer", "defsense-fab")
        top.append_child_value("device", frame.device)
        described = top.append_child("channels")
        for label, unit, kind in channels:
            one = described.append_child("channel")
            for key, value in (("label", label), ("unit", unit), ("type", kind)):
                one.append_child_value(key, value)
        self._outlet = pylsl.StreamOutlet(info)


def sample(
    frame: LiveFrame, send: tuple[str, ...]
) -> tuple[list[tuple[str, str, str]], list[float]]:
    """Channels as label, unit and type, and their values; NaN where there is none."""
    channels, values = list[tuple[str, str, str]](), list[float]()
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
    if "markers" in send:
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
