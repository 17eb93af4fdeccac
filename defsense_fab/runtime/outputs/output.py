"""The interface of all outputs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from ..frames.live_frame import LiveFrame, Quality


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


def signals_of(frame: LiveFrame) -> dict[str, float]:
    """What mappings can name: the controls, and "quality", 1 the best to 0 the worst, unless a
    control has that name."""
    best = max(q.level for q in Quality)
    return {"quality": frame.quality.level / best} | {
        name: finite(value) for name, value in frame.controls.items()
    }


def controls_known(frame: LiveFrame) -> bool:
    """Whether the frame's controls are all that the device has, even if these are none. Until the
    resistances at rest are known there are none yet, and frames are lost."""
    return bool(frame.controls) or frame.quality is not Quality.LOST


def unknown_controls(kind: str, asked: Iterable[str], frame: LiveFrame) -> str | None:
    """A sentence of controls that a mapping names and that are not there, None where all are."""
    there = signals_of(frame)
    missing = sorted({name for name in asked if name not in there})
    if not missing:
        return None
    words = ", ".join(map(repr, missing))
    return f"{kind}: there is no control {words}; mappings can name: {', '.join(there)}"


def finite(value: float) -> float:
    """0 for what is no number: devices and other programs' inputs have no word for that."""
    return float(value) if math.isfinite(value) else 0.0
