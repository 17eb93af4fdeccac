"""Sources of samples by name: a serial port, a socket, a recorded file, or a simulated board."""

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
from ...core.response import SPECIMEN_LENGTH_MM
from ...sensing.response import Response
from ..electronics.cords import CordTraits, SpecimenTwin
from ..electronics.readout_board import ReadoutTwin

MAX_SPEED = 100.0  # simulated seconds per second


@dataclass(frozen=True)
class OpenedSource:
    """A source that is not started yet.

    Attributes:
        source: The source.
        hands: Places a simulated specimen on a jig (radius in mm or None, face); None for real
            boards.
    """

    source: Source
    hands: Callable[[float | None, str], None] | None = None


def open_source(
    text: str,
    settings: ReadoutSettings,
    geometry: Geometry | None = None,
    length: float = SPECIMEN_LENGTH_MM,
) -> OpenedSource:
    """Open a source of samples.

    Args:
        text: A port such as `/dev/ttyUSB0`, `COM3`, `socket://host:port` or `udp://HOST`, a
            recorded `.csv` file, or a simulated specimen: `twin` or `twin:speed=20,k=2,seed=1`.
        settings: Settings of the read-out board.
        geometry: Geometry of the simulated specimen.
        length: Length of the simulated specimen, mm.

    Raises:
        CaptureError: The text is not a valid source (`source-invalid`, `out-of-range`).
    """
    if text == "twin" or text.startswith("twin:"):
        return _open_twin(text, settings, geometry or Geometry(), length)
    if text.endswith(".csv"):
        return OpenedSource(Replay(Path(text)))
    return OpenedSource(Reader(partial(open_port, text), text, settings))


def _open_twin(
    text: str, settings: ReadoutSettings, geometry: Geometry, length: float
) -> OpenedSource:
    values = {"speed": 1.0, "k": 2.0, "seed": 1.0}
    for pair in filter(None, text.partition(":")[2].split(",")):
        name, equals, number = pair.partition("=")
        try:
            if not equals or name not in values:
                raise ValueError
            values[name] = float(number)
        except ValueError:
            raise CaptureError(
                f"{pair!r} is not a valid setting",
                code="source-invalid",
                where=text,
                action="Write any of the settings in twin:speed=20,k=2,seed=1",
                setting=pair,
            ) from None
    if not 0 < values["speed"] <= MAX_SPEED or values["seed"] < 0:
        raise CaptureError(
            f"the speed must be above 0 and at most {MAX_SPEED:g}, and the seed at least 0",
            code="out-of-range",
            where=text,
            record="twin",
        )
    rng = np.random.default_rng(int(values["seed"]))
    traits = CordTraits(Response.line(values["k"]))
    specimen = SpecimenTwin(traits, rng, length, geometry.thickness, geometry.offset)
    board = ReadoutTwin(specimen, speed=values["speed"])
    return OpenedSource(Reader(lambda: board, text, settings), board.place)
