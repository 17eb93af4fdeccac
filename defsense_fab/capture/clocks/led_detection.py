"""Find the read-out board's LED in a camera's images by how it blinks.

Images are reduced to means of blocks, and the newest ones are kept. The LED is where a block's
brightness has two levels and nothing between, and stays on each for the same time. Moving tags,
flickering lamps and noise have other levels or irregular times.
"""

from __future__ import annotations

from collections import deque

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
MIN_REGULAR_SHARE = 0.7  # of the time that is spent in stays of the usual length
MIN_STAY_FRAMES = 3  # of an LED that can be followed

_Blocks = NDArray[np.float32]


class LedDetector:
    """Finds an LED that switches at a regular pace."""

    def __init__(self) -> None:
        self._recent: deque[_Blocks] = deque(maxlen=RECENT_FRAMES)
        self._count = 0
        self._size: tuple[int, int] | None = None
        self._next_search = FIRST_SEARCH_FRAMES

    def add(self, image: NDArray[np.uint8]) -> Float | None:
        """Add the next frame, and search the newest frames from time to time.

        Args:
            image: Grey (h, w) or color (h, w, 3) image.

        Returns:
            Position of the LED in the image (2,), px; None until it is found.

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
        self._count += 1
        self._recent.append(_block_means(image))
        if self._count < self._next_search:
            return None
        # A search takes as long as several frames, so searches get rarer while none succeeds.
        self._next_search += min(self._count, MAX_SEARCH_INTERVAL_FRAMES)
        return _find_led(np.array(self._recent))


def _find_led(recent: _Blocks) -> Float | None:
    """Return the position (2,), px, of an LED in blocks (t, rows, columns); None if there is none.

    The position is the mean of the blocks around the one that blinks most clearly, weighted by
    their contrast.
    """
    location = _find_blinking_block(recent)
    if location is None:
        return None
    row, column = (slice(max(k - NEIGHBOR_BLOCKS, 0), k + NEIGHBOR_BLOCKS + 1) for k in location)
    blocks = recent[:, row, column].astype(float)
    flat = blocks.reshape(len(blocks), -1)
    center = blocks[:, location[0] - row.start, location[1] - column.start]
    is_lit = center > _two_levels(center).mean()
    rise = np.median(flat[is_lit], 0) - np.median(flat[~is_lit], 0)
    weight = rise * (rise > 0.1 * rise.max())
    y, x = np.mgrid[: blocks.shape[1], : blocks.shape[2]]
    place = np.array(
        [
            column.start + x.ravel() @ weight / weight.sum(),
            row.start + y.ravel() @ weight / weight.sum(),
        ]
    )
    return np.asarray((place + 0.5) * BLOCK_PX - 0.5)


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


def _two_levels(values: Float) -> Float:
    """Return the two levels (2,) of values (t,), by two means."""
    levels = np.quantile(values, [0.1, 0.9])
    for _ in range(8):
        is_high = values > levels.mean()
        if is_high.all() or not is_high.any():
            break
        levels = np.array([np.median(values[~is_high]), np.median(values[is_high])])
    return np.asarray(levels)


def _find_blinking_block(recent: _Blocks) -> tuple[int, int] | None:
    """Return row and column of the block that blinks most clearly in blocks (t, rows, columns)."""
    flat = recent.reshape(len(recent), -1)
    spread = flat[::3].std(0)
    step = np.median(np.abs(np.diff(flat[:STEP_FRAMES], axis=0)), axis=0) + 0.02
    order = np.argsort(spread / step)[::-1][:MAX_CANDIDATES]
    best: tuple[float, int] | None = None
    for k in order:
        if spread[k] < 1.5 * step[k]:
            break
        clarity = _blinking_clarity(flat[:, k].astype(float))
        if clarity > 0 and (best is None or clarity > best[0]):
            best = clarity, int(k)
    if best is None:
        return None
    row, column = divmod(best[1], recent.shape[2])
    return row, column


def _blinking_clarity(values: Float) -> float:
    """Return contrast over noise of values (t,) that blink regularly; 0 for others."""
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
    expected = float(np.median(stays))
    is_regular = np.abs(stays - expected) <= max(1.5, 0.08 * expected)
    if (
        expected < MIN_STAY_FRAMES
        or stays[is_regular].sum() < MIN_REGULAR_SHARE * stays.sum()
        or is_regular.mean() < 0.5
    ):
        return 0.0
    return 1 / noise
