"""Cameras as people have them: kinds of a twin's cameras, by name."""

from __future__ import annotations

from dataclasses import dataclass

from .image_processing import ImageProcessing
from .renderer import Optics


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
USUAL = "webcam"
#: Of an industrial camera: a global shutter, triggered, the sensor's own values, good prints. Of
#: the others: free-running, a rolling shutter, light that flickers at 100 Hz, a picture that is
#: meant to please, prints from the office.
KINDS = {
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
