"""Where samples come from, by a word: a port, a socket, a recording, or a twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...calibration.readings import Geometry
from ...capture.readout.ports import open_port
from ...capture.readout.reader import Reader, ReadoutSettings
from ...capture.readout.recording import Replay
from ...capture.readout.source import Source
from ...core.errors import CaptureError
from ...sensing.response import Response
from ..electronics.cords import CordTraits, SpecimenTwin
from ..electronics.readout_board import ReadoutTwin


@dataclass(frozen=True)
class OpenedSource:
    """A source that is not started yet, and a twin's `hands`."""

    source: Source
    hands: Callable[[float | None, str], None] | None = None


def open_source(
    text: str, settings: ReadoutSettings, geometry: Geometry | None = None, length: float = 150.0
) -> OpenedSource:
    """/dev/ttyUSB0, COM3, socket://host:port, a recording's .csv, or twin, twin:speed=20,k=2,seed=1
    (a specimen of this geometry and length, mm). Raises CaptureError for words that are none."""
    if text == "twin" or text.startswith("twin:"):
        return _twin(text, settings, geometry or Geometry(), length)
    if text.endswith(".csv"):
        return OpenedSource(Replay(Path(text)))
    return OpenedSource(Reader(partial(open_port, text), text, settings))


def _twin(text: str, settings: ReadoutSettings, geometry: Geometry, length: float) -> OpenedSource:
    values = {"speed": 1.0, "k": 2.0, "seed": 1.0}
    for pair in filter(None, text.partition(":")[2].split(",")):
        name, equals, number = pair.partition("=")
        try:
            if not equals or name not in values:
                raise ValueError
            values[name] = float(number)
        except ValueError:
            raise CaptureError(f"{text}: write twin:speed=20,k=2,seed=1, each or none") from None
    if not 0 < values["speed"] <= 100 or values["seed"] < 0:
        raise CaptureError(f"{text}: speed is above 0 and at most 100, seed not below 0")
    rng = np.random.default_rng(int(values["seed"]))
    traits = CordTraits(Response.line(values["k"]))
    specimen = SpecimenTwin(traits, rng, length, geometry.thickness, geometry.offset)
    board = ReadoutTwin(specimen, speed=values["speed"])
    return OpenedSource(Reader(lambda: board, text, settings), board.place)
