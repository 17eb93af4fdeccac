"""Cameras as people have them: kinds of a twin's cameras, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ..scenes.scene import WHITE, Ball, Patch
from .camera_optics import ImageProcessing, Optics

# A finger that passes over the device now and then, as hands that bend it do.

_EVERY, _LASTS = 6.0, 1.2  # s
_RADIUS, _ABOVE = 8.0, 14.0  # mm
_LEVEL = 105.0


def simulate_passing_finger(
    rng: np.random.Generator, bounds: Float, towards: Float
) -> Callable[[float], tuple[Ball, ...]]:
    """What is in the way at a time, s: of a body within `bounds` (2, 3) mm, on the side of its
    cameras, which are in the direction `towards` (3,). Once in six seconds a finger goes in a
    straight line from one place above the body to another."""
    seed = int(rng.integers(1 << 31))
    low, high = bounds
    reach = (high - low) / 2
    lifted = towards * (float(np.abs(towards) @ reach) + _ABOVE)
    flat = np.eye(3) - np.outer(towards, towards)

    def at(seconds: float) -> tuple[Ball, ...]:
        turn = max(int(seconds // _EVERY), 0)  # the first picture's first rows are read before 0 s
        own = np.random.default_rng([seed, turn])
        begins = own.uniform(0.5, _EVERY - _LASTS)
        ends = (low + high) / 2 + own.uniform(-1, 1, (2, 3)) * reach @ flat + lifted
        part = (seconds - turn * _EVERY - begins) / _LASTS
        if not 0 <= part <= 1:
            return ()
        return (Ball((1 - part) * ends[0] + part * ends[1], _RADIUS, _LEVEL),)

    return at


# Tags as printers and paper make them: ink that spreads, paper that curls.

_FINE = 50  # parts of a cell in which ink spreads


def print_patch(patch: Patch, ink: float, curl: float) -> Patch:
    """A patch whose black is `ink` mm wider on each side, to the next fiftieth of a cell, and whose
    paper curls by `curl`, 1/mm. Its size and corners are those of the picture with the spread ink.
    Raises CaptureError for ink that goes beyond the white margin."""
    wider = round(ink / patch.cell * _FINE)
    if not 0 <= wider < patch.margin * _FINE:
        raise CaptureError(
            f"ink that spreads by {ink:g} mm leaves no white margin",
            code="ink-too-wide",
            where=f"patch {patch.number}",
            ink=ink,
        )
    if wider == 0:
        return replace(patch, curl=curl)
    fine = np.kron(patch.pattern, np.ones((_FINE, _FINE), np.uint8))
    fine = np.pad(fine, wider, constant_values=WHITE)
    kernel = np.ones((2 * wider + 1, 2 * wider + 1), np.uint8)
    pattern = cv2.erode(fine, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=WHITE)
    size = patch.size * pattern.shape[1] / (patch.pattern.shape[1] * _FINE)
    return replace(
        patch, pattern=np.asarray(pattern, np.uint8), size=size,
        margin=patch.margin * _FINE - wider, curl=curl,
    )  # fmt: skip


@dataclass(frozen=True)
class CameraKind:
    """Its `optics`; a frame's stamp is `delay` s late, and up to `jitter` s more; cameras that are
    `free_running` do not expose at the same instants. Of what it looks at: `ink` mm that print
    spreads and `curl` 1/mm of the paper, `gloss` in grey levels, and whether a hand is now and
    then `passing` before it."""

    optics: Optics
    delay: float = 0.002
    jitter: float = 0.0
    free_running: bool = False
    ink: float = 0.0
    curl: float = 0.0
    gloss: float = 0.0
    passing: bool = False


#: What most people have.
DEFAULT_CAMERA_KIND = "webcam"
#: Of an industrial camera: a global shutter, triggered, the sensor's own values, good prints. Of
#: the others: free-running, a rolling shutter, light that flickers at 100 Hz, a picture that is
#: meant to please, prints from the office.
CAMERA_KINDS = {
    "webcam": CameraKind(
        Optics(
            blur=0.4, focus=1.0, exposure=0.008, read=2.0, shot=0.06, vignetting=0.25, slant=0.2,
            rolling=0.025, flicker=0.05, wander=0.08,
            processing=ImageProcessing(gamma=0.6, sharpened=1.2, radius=1.0, quality=75),
        ),
        delay=0.03, jitter=0.003, free_running=True, ink=0.05, curl=1e-3, gloss=20.0, passing=True,
    ),
    "phone": CameraKind(
        Optics(
            blur=0.4, focus=0.6, exposure=0.005, read=1.2, shot=0.04, vignetting=0.2, slant=0.2,
            rolling=0.012, flicker=0.03, wander=0.05,
            processing=ImageProcessing(gamma=0.5, sharpened=0.6, radius=2.0, quality=90),
        ),
        delay=0.03, jitter=0.001, free_running=True, ink=0.05, curl=1e-3, gloss=20.0, passing=True,
    ),
    "industrial": CameraKind(Optics()),
}  # fmt: skip
