"""The interface of all outputs."""

from __future__ import annotations

import math
from typing import Protocol

from ..frames.live_frame import LiveFrame


class Output(Protocol):
    """Sends frames somewhere. `send` raises where it cannot, and may be called again; `trouble` is
    a sentence of what is wrong while the output goes on by itself, None while all is well; `about`
    says in a sentence what it sends where."""

    @property
    def name(self) -> str: ...

    @property
    def about(self) -> str: ...

    @property
    def trouble(self) -> str | None: ...

    def send(self, frame: LiveFrame) -> None: ...

    def close(self) -> None: ...


def finite(value: float) -> float:
    """0 for what is no number: devices and other programs' inputs have no word for that."""
    return float(value) if math.isfinite(value) else 0.0
