"""Find the read-out board's LED in a camera's images by how it blinks.

Images are reduced to means of blocks, and the newest ones are kept. The LED is where a block's
brightness has two levels and nothing between, and stays on each as long as the LED does. From then
on only the blocks around that place are kept. Moving tags, flickering lamps and noise have other
levels or other times.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.errors import CaptureError

BLOCK_PX = 8  # halved three times
MIN_IMAGE_BLOCKS = 4
RECENT_FRAMES = 600
FIRST_SEARCH_FRAMES = 100
MAX_SEARCH_INTERVAL_FRAMES = 1200
NEIGHBOR_BLOCKS = 2  # on each side of the block that blinks
STEP_FRAMES = 25  # from whose steps candidate blocks are chosen
MAX_CANDIDATES = 100
MIN_CONTRAST_SIGMAS = 8.0
MAX_BETWEEN_SHARE = 0.12  # of the frames that are between the levels
MIN_SWITCHES = 6
MIN_REGULAR_SHARE = 0.7  # of the time that is spent in stays as long as the LED's
MIN_STAY_FRAMES = 3  # of an LED that can be followed

_Blocks = NDArray[np.float32]


@dataclass(frozen=True)
class LedTrace:
    """Brightness of the LED in t frames, all since the first.

    Attributes:
        place: Position of the LED in the image (2,), px.
        brightness: Brightness (t,), grey levels of a block; NaN in early frames that were not kept.
        contrast: Difference between lit and dark, grey levels.
        noise: Standard deviation of either, grey levels.
    """

    place: Float
    brightness: Float
    contrast: float
    noise: float


class LedDetector:
    """Finds an LED that switches at a regular pace.

    Args:
        stay: Frames between two switches: the LED's period times the camera's rate. None accepts
            any regular pace.

    Raises:
        CaptureError: If `stay` is too short to be seen.
    """

    def __init__(self, stay: float | None = None) -> None:
        if stay is not None and not stay >= MIN_STAY_FRAMES:
            raise CaptureError(
                f"an LED that switches every {stay:.1f} frames cannot be followed; at least"
                f" {MIN_STAY_FRAMES} frames are needed",
                code="led-too-fast",
                where="LED",
                action="Choose a longer period",
            )
        self._stay = stay
        self._recent: deque[_Blocks] = deque(maxlen=RECENT_FRAMES)
        self._count = 0
        self._size: tuple[int, int] | None = None
        self._next_search = FIRST_SEARCH_FRAMES
        self._location: tuple[int, int] | None = None  # row and column of the block
        self._neighborhoods: list[_Blocks] = []  # blocks around it, from frame `_first_frame` on
        self._first_frame = 0

    def add(self, image: NDArray[np.uint8]) -> None:
        """Add the next frame.

        Args:
            image: Grey (h, w) or color (h, w, 3) image.

        Raises:
            CaptureError: If the image is too small, or its size differs from the first.
        """
        size = image.shape[1], image.shape[0]
        if self._size is None:
            if min(size) < MIN_IMAGE_BLOCKS * BLOCK_PX:
                raise CaptureError(
                    f"an image of {size[0]} x {size[1]} px is too small",
                    code="image-too-small",
                    where="LED",
                    action="Record at a higher resolution",
                )
            self._size = size
        if size != self._size:
            raise CaptureError(
                f"frame {self._count} is {size[0]} x {size[1]} px, earlier frames are"
                f" {self._size[0]} x {self._size[1]} px",
                code="image-size-changed",
                where="LED",
                action="Pass images of one camera at one size",
                frame=self._count,
                size=size,
            )
        blocks = _block_means(image)
        self._count += 1
        if self._location is not None:
            self._neighborhoods.append(blocks[_neighborhood(self._location)].copy())
            return
        self._recent.append(blocks)
        if self._count >= self._next_search:
            # A search takes as long as several frames, so searches get rarer while none succeeds.
            self._next_search += min(self._count, MAX_SEARCH_INTERVAL_FRAMES)
            self._search()

    @property
    def is_located(self) -> bool:
        """Whether the LED has been found."""
        return self._location is not None

    def trace(self) -> LedTrace | None:
        """Return the LED's position and brightness; None if nothing blinks as it does."""
        if self._location is None:
            self._search()
        if self._location is None:
            return None
        blocks = np.array(self._neighborhoods, float)
        flat = blocks.reshape(len(blocks), -1)
        row, column = self._location
        corner = max(row - NEIGHBOR_BLOCKS, 0), max(column - NEIGHBOR_BLOCKS, 0)
        center = flat[:, (row - corner[0]) * blocks.shape[2] + column - corner[1]]
        levels = _two_levels(center)
        is_lit = center > levels.mean()
        if is_lit.all() or not is_lit.any():
            return None
        dark, bright = flat[~is_lit], flat[is_lit]
        rise = np.median(bright, 0) - np.median(dark, 0)
        weight = rise * (rise > 0.1 * rise.max())
        brightness = flat @ weight / weight.sum()
        steps = np.abs(np.diff(brightness))
        y, x = np.mgrid[: blocks.shape[1], : blocks.shape[2]]
        place = np.array(
            [
                corner[1] + x.ravel() @ weight / weight.sum(),
                corner[0] + y.ravel() @ weight / weight.sum(),
            ]
        )
        contrast = float(np.median(brightness[is_lit]) - np.median(brightness[~is_lit]))
        unknown = np.full(self._first_frame, np.nan)
        return LedTrace(
            (place + 0.5) * BLOCK_PX - 0.5,
            np.concatenate([unknown, brightness]),
            contrast,
            float(np.median(steps) / 0.954),
        )

    def _search(self) -> None:
        """Choose the block that blinks most clearly."""
        if len(self._recent) < 10 * MIN_STAY_FRAMES:
            return
        recent = np.array(self._recent)
        location = _find_blinking_block(recent, self._stay)
        if location is None:
            return
        self._location, self._first_frame = location, self._count - len(recent)
        self._neighborhoods = list(recent[(slice(None), *_neighborhood(location))].copy())
        self._recent.clear()


def _block_means(image: NDArray[np.uint8]) -> _Blocks:
    """Return the means of an image's blocks.

    Halving three times is faster than reducing at once; only the last time is not rounded.
    """
    grey = image if image.ndim == 2 else image[:, :, 1]
    height, width = (n // BLOCK_PX * BLOCK_PX for n in grey.shape)
    grey = np.ascontiguousarray(grey[:height, :width])
    for _ in range(2):
        height, width = height // 2, width // 2
        grey = np.asarray(cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    quarter = grey.astype(np.float32)
    return np.asarray(
        cv2.resize(quarter, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.float32
    )


def _neighborhood(location: tuple[int, int]) -> tuple[slice, slice]:
    row, column = (slice(max(k - NEIGHBOR_BLOCKS, 0), k + NEIGHBOR_BLOCKS + 1) for k in location)
    return row, column


def _two_levels(values: Float) -> Float:
    """Return the two levels (2,) of values (t,), by two means."""
    levels = np.quantile(values, [0.1, 0.9])
    for _ in range(8):
        is_high = values > levels.mean()
        if is_high.all() or not is_high.any():
            break
        levels = np.array([np.median(values[~is_high]), np.median(values[is_high])])
    return np.asarray(levels)


def _find_blinking_block(recent: _Blocks, stay: float | None) -> tuple[int, int] | None:
    """Return row and column of the block that blinks most clearly in blocks (t, rows, columns)."""
    flat = recent.reshape(len(recent), -1)
    spread = flat[::3].std(0)
    step = np.median(np.abs(np.diff(flat[:STEP_FRAMES], axis=0)), axis=0) + 0.02
    order = np.argsort(spread / step)[::-1][:MAX_CANDIDATES]
    best: tuple[float, int] | None = None
    for k in order:
        if spread[k] < 1.5 * step[k]:
            break
        clarity = _blinking_clarity(flat[:, k].astype(float), stay)
        if clarity > 0 and (best is None or clarity > best[0]):
            best = clarity, int(k)
    if best is None:
        return None
    row, column = divmod(best[1], recent.shape[2])
    return row, column


def _blinking_clarity(values: Float, stay: float | None) -> float:
    """Return contrast over noise of values (t,) that blink as the LED does; 0 for others."""
    levels = _two_levels(values)
    rise = float(levels[1] - levels[0])
    part = (values - levels[0]) / max(rise, 1e-6)
    deviation = np.minimum(np.abs(part), np.abs(part - 1))
    noise = max(float(np.median(deviation)) / 0.6745, 0.02 / max(rise, 1e-6))
    if (
        rise <= 0.3
        or 1 / noise < MIN_CONTRAST_SIGMAS
        or np.mean(deviation > 0.25) > MAX_BETWEEN_SHARE
    ):
        return 0.0
    # A value between the levels keeps the state before it.
    states = np.where(part > 0.75, 1, np.where(part < 0.25, 0, -1))
    known = np.maximum.accumulate(np.where(states >= 0, np.arange(len(states)), 0))
    states = states[known]
    switches = np.flatnonzero(np.diff(states)) + 1
    if len(switches) < MIN_SWITCHES:
        return 0.0
    stays = np.diff(switches)
    expected = stay if stay is not None else float(np.median(stays))
    is_regular = np.abs(stays - expected) <= max(1.5, 0.08 * expected)
    if (
        expected < MIN_STAY_FRAMES
        or stays[is_regular].sum() < MIN_REGULAR_SHARE * stays.sum()
        or is_regular.mean() < 0.5
    ):
        return 0.0
    return 1 / noise
