"""Kinds of simulated cameras, with the prints and the hands that they look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ..scenes.scene import WHITE, Ball, Patch
from .camera_optics import ImageProcessing, Optics

# Of all simulated cameras: size of the image, focal length and distortions of the lens.
IMAGE_SIZE, FOCAL_PX = (1280, 720), 900.0
DISTORTIONS = np.array([0.04, -0.09, 0.0008, -0.0005, 0.01])
INK_STEPS_PER_CELL = 50  # resolution in which ink spreads
FINGER_PERIOD_S, FINGER_PASS_S = 6.0, 1.2
FINGER_RADIUS_MM, FINGER_CLEARANCE_MM = 8.0, 14.0
FINGER_LEVEL = 105.0  # grey level


@dataclass(frozen=True)
class CameraKind:
    """A kind of camera, and the conditions in which such cameras are used.

    Attributes:
        optics: Lens, shutter and sensor.
        delay: Delay of a frame's time stamp, s.
        jitter: Largest additional random delay of the time stamp, s.
        free_running: Whether the cameras expose at different instants.
        ink: Width by which printed ink spreads, mm.
        curl: Curvature of the paper, 1/mm.
        gloss: Gloss of the paper, grey levels.
        passing: Whether a finger passes before the device now and then.
    """

    optics: Optics
    delay: float = 0.002
    jitter: float = 0.0
    free_running: bool = False
    ink: float = 0.0
    curl: float = 0.0
    gloss: float = 0.0
    passing: bool = False


#: `industrial` has a global shutter, a trigger, unprocessed values and good prints. The others are
#: free-running, with a rolling shutter, light that flickers at 100 Hz, processed images and
#: office prints.
CAMERA_KINDS: dict[str, CameraKind] = {
    "webcam": CameraKind(
        Optics(
            blur=0.4,
            defocus_radius=1.0,
            exposure=0.008,
            read_noise=2.0,
            shot_noise=0.06,
            vignetting=0.25,
            side_falloff=0.2,
            readout_time=0.025,
            flicker=0.05,
            gain_wander=0.08,
            processing=ImageProcessing(gamma=0.6, sharpening=1.2, radius=1.0, quality=75),
        ),
        delay=0.03,
        jitter=0.003,
        free_running=True,
        ink=0.05,
        curl=1e-3,
        gloss=20.0,
        passing=True,
    ),
    "phone": CameraKind(
        Optics(
            blur=0.4,
            defocus_radius=0.6,
            exposure=0.005,
            read_noise=1.2,
            shot_noise=0.04,
            vignetting=0.2,
            side_falloff=0.2,
            readout_time=0.012,
            flicker=0.03,
            gain_wander=0.05,
            processing=ImageProcessing(gamma=0.5, sharpening=0.6, radius=2.0, quality=90),
        ),
        delay=0.03,
        jitter=0.001,
        free_running=True,
        ink=0.05,
        curl=1e-3,
        gloss=20.0,
        passing=True,
    ),
    "industrial": CameraKind(Optics()),
}


def print_patch(patch: Patch, ink: float, curl: float) -> Patch:
    """Return a patch as a printer and paper make it.

    Args:
        patch: The patch as designed.
        ink: Width by which black spreads on each side, mm; rounded to a fiftieth of a cell.
        curl: Curvature of the paper, 1/mm.

    Returns:
        The printed patch; its size and corners are those of the pattern with the spread ink.

    Raises:
        CaptureError: The ink spreads beyond the white margin (`ink-too-wide`).
    """
    spread = round(ink / patch.cell * INK_STEPS_PER_CELL)
    if not 0 <= spread < patch.margin * INK_STEPS_PER_CELL:
        raise CaptureError(
            f"ink that spreads by {ink:g} mm leaves no white margin",
            code="ink-too-wide",
            where=f"patch {patch.number}",
            ink=ink,
        )
    if spread == 0:
        return replace(patch, curl=curl)
    fine = np.kron(patch.pattern, np.ones((INK_STEPS_PER_CELL, INK_STEPS_PER_CELL), np.uint8))
    fine = np.pad(fine, spread, constant_values=WHITE)
    kernel = np.ones((2 * spread + 1, 2 * spread + 1), np.uint8)
    pattern = cv2.erode(fine, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=WHITE)
    return replace(
        patch,
        pattern=np.asarray(pattern, np.uint8),
        size=patch.size * pattern.shape[1] / (patch.pattern.shape[1] * INK_STEPS_PER_CELL),
        margin=patch.margin * INK_STEPS_PER_CELL - spread,
        curl=curl,
    )


def simulate_passing_finger(
    rng: np.random.Generator, bounds: Float, towards: Float
) -> Callable[[float], tuple[Ball, ...]]:
    """Simulate a finger that passes over the device once in six seconds.

    It moves in a straight line from one position above the body to another.

    Args:
        rng: Random generator.
        bounds: Lower and upper corner of the body (2, 3) mm.
        towards: Direction from the body towards its cameras (3,), of unit length.

    Returns:
        A function that returns the finger at a time, s: one ball, or none.
    """
    seed = int(rng.integers(1 << 31))
    low, high = bounds
    half_size = (high - low) / 2
    lift = towards * (float(np.abs(towards) @ half_size) + FINGER_CLEARANCE_MM)
    flat = np.eye(3) - np.outer(towards, towards)

    def finger_at(seconds: float) -> tuple[Ball, ...]:
        period = max(int(seconds // FINGER_PERIOD_S), 0)  # first rows are read before 0 s
        period_rng = np.random.default_rng([seed, period])
        start = period_rng.uniform(0.5, FINGER_PERIOD_S - FINGER_PASS_S)
        ends = (low + high) / 2 + period_rng.uniform(-1, 1, (2, 3)) * half_size @ flat + lift
        progress = (seconds - period * FINGER_PERIOD_S - start) / FINGER_PASS_S
        if not 0 <= progress <= 1:
            return ()
        center = (1 - progress) * ends[0] + progress * ends[1]
        return (Ball(center, FINGER_RADIUS_MM, FINGER_LEVEL),)

    return finger_at
