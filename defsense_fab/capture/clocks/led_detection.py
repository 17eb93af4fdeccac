"""The read-out board's LED in a camera's images, found by how it blinks.

Images are kept as means of blocks, the last ones only. Where a block's brightness has two levels
and nothing between, and stays on each as long as the LED does, the LED is; from then on the blocks
around that place are kept. Tags that move, lamps that flicker, and noise have other levels or other
times.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.errors import CaptureError

_BLOCK = 8  # px, three times halved
_KEPT = 600  # frames
_FIRST, _LOOK = 100, 1200  # frames until the first look; between two looks, at most
_AROUND = 2  # blocks about the one that blinks
_STEPS = 25  # frames by whose steps blocks are chosen
_MOST = 100  # blocks that are looked at
_CONTRAST = 8.0  # of the levels, by their standard deviations
_BETWEEN = 0.12  # part of the frames that may be between the levels
_SWITCHES = 6
_ON_TIME = 0.7  # part of the stays that must be as long as the LED's
_SHORT = 3  # frames: the shortest stay of an LED that is followed

_Blocks = NDArray[np.float32]


@dataclass(frozen=True)
class LedTrace:
    """Of t frames, all since the first: the LED's `place` (2,) px; its `brightness` (t,), grey
    levels of a block, NaN where no longer known; `contrast` of lit and dark, and the `noise` of
    either, in the same."""

    place: Float
    brightness: Float
    contrast: float
    noise: float


class LedDetector:
    """Looks for an LED that switches every `stay` frames (the LED's period times the camera's
    rate); None: at any regular pace."""

    def __init__(self, stay: float | None = None) -> None:
        """Raises CaptureError for stays too short to be seen."""
        if stay is not None and not stay >= _SHORT:
            raise CaptureError(
                f"LED: an LED that switches every {stay:.1f} frames cannot be followed; at least"
                f" {_SHORT}: choose a longer period",
                code="led-too-fast",
            )
        self._stay = stay
        self._recent: deque[_Blocks] = deque(maxlen=_KEPT)
        self._count = 0
        self._size: tuple[int, int] | None = None
        self._next = _FIRST
        self._found: tuple[int, int] | None = None
        self._near: list[_Blocks] = []  # of the blocks around what was found, from frame
        self._since = 0

    def add(self, image: NDArray[np.uint8]) -> None:
        """The next frame (h, w), or (h, w, 3). Raises CaptureError where the size changes."""
        size = image.shape[1], image.shape[0]
        if self._size is None:
            if min(size) < 4 * _BLOCK:
                raise CaptureError(
                    f"LED: an image of {size[0]} x {size[1]} px is too small",
                    code="image-too-small",
                )
            self._size = size
        if size != self._size:
            raise CaptureError(
                f"LED: frame {self._count} is {size[0]} x {size[1]} px, those before are"
                f" {self._size[0]} x {self._size[1]} px; give one camera's images of one size",
                code="image-size-changed",
                frame=self._count,
                size=size,
            )
        blocks = _means(image)
        self._count += 1
        if self._found is not None:
            self._near.append(blocks[_around(self._found)].copy())
            return
        self._recent.append(blocks)
        if self._count >= self._next:
            # A look takes as long as some frames: less and less often, where there is no LED.
            self._next += min(self._count, _LOOK)
            self._look()

    @property
    def found(self) -> bool:
        """Whether it is known where the LED is."""
        return self._found is not None

    def trace(self) -> LedTrace | None:
        """Where the LED is and how bright it was; None where nothing blinks as it does."""
        if self._found is None:
            self._look()
        if self._found is None:
            return None
        near = np.array(self._near, float)
        flat = near.reshape(len(near), -1)
        row, column = self._found
        corner = max(row - _AROUND, 0), max(column - _AROUND, 0)
        middle = flat[:, (row - corner[0]) * near.shape[2] + column - corner[1]]
        levels = _levels(middle)
        lit = middle > levels.mean()
        if lit.all() or not lit.any():
            return None
        dark, bright = flat[~lit], flat[lit]
        rise = np.median(bright, 0) - np.median(dark, 0)
        weight = rise * (rise > 0.1 * rise.max())
        brightness = flat @ weight / weight.sum()
        steps = np.abs(np.diff(brightness))
        y, x = np.mgrid[: near.shape[1], : near.shape[2]]
        place = np.array([corner[1] + x.ravel() @ weight / weight.sum(),
                          corner[0] + y.ravel() @ weight / weight.sum()])  # fmt: skip
        contrast = float(np.median(brightness[lit]) - np.median(brightness[~lit]))
        before = np.full(self._since, np.nan)
        return LedTrace(
            (place + 0.5) * _BLOCK - 0.5, np.concatenate([before, brightness]), contrast,
            float(np.median(steps) / 0.954),
        )  # fmt: skip

    def _look(self) -> None:
        """Choose the block that blinks most clearly."""
        if len(self._recent) < 10 * _SHORT:
            return
        recent = np.array(self._recent)
        found = _blinking(recent, self._stay)
        if found is None:
            return
        self._found, self._since = found, self._count - len(recent)
        self._near = list(recent[(slice(None), *_around(found))].copy())
        self._recent.clear()


def _means(image: NDArray[np.uint8]) -> _Blocks:
    """Of blocks: halved three times, which is faster than at once, the last time without rounding
    off."""
    grey = image if image.ndim == 2 else image[:, :, 1]
    height, width = (n // _BLOCK * _BLOCK for n in grey.shape)
    grey = np.ascontiguousarray(grey[:height, :width])
    for _ in range(2):
        height, width = height // 2, width // 2
        grey = np.asarray(cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    last = grey.astype(np.float32)
    return np.asarray(
        cv2.resize(last, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.float32
    )


def _around(place: tuple[int, int]) -> tuple[slice, slice]:
    row, column = (slice(max(k - _AROUND, 0), k + _AROUND + 1) for k in place)
    return row, column


def _levels(values: Float) -> Float:
    """The two levels (2,) of values (t,) (two means)."""
    levels = np.quantile(values, [0.1, 0.9])
    for _ in range(8):
        lit = values > levels.mean()
        if lit.all() or not lit.any():
            break
        levels = np.array([np.median(values[~lit]), np.median(values[lit])])
    return np.asarray(levels)


def _blinking(recent: _Blocks, stay: float | None) -> tuple[int, int] | None:
    """Row and column of the block (t, rows, columns) that has the clearest two levels among those
    that stay as long on them as the LED does."""
    flat = recent.reshape(len(recent), -1)
    wide = flat[::3].std(0)
    step = np.median(np.abs(np.diff(flat[:_STEPS], axis=0)), axis=0) + 0.02
    order = np.argsort(wide / step)[::-1][:_MOST]
    best: tuple[float, int] | None = None
    for k in order:
        if wide[k] < 1.5 * step[k]:
            break
        clear = _clear(flat[:, k].astype(float), stay)
        if clear > 0 and (best is None or clear > best[0]):
            best = clear, int(k)
    if best is None:
        return None
    row, column = divmod(best[1], recent.shape[2])
    return row, column


def _clear(values: Float, stay: float | None) -> float:
    """Contrast over noise of what blinks as the LED does; 0 for what does not."""
    levels = _levels(values)
    rise = float(levels[1] - levels[0])
    part = (values - levels[0]) / max(rise, 1e-6)
    off = np.minimum(np.abs(part), np.abs(part - 1))
    noise = max(float(np.median(off)) / 0.6745, 0.02 / max(rise, 1e-6))
    if rise <= 0.3 or 1 / noise < _CONTRAST or np.mean(off > 0.25) > _BETWEEN:
        return 0.0
    # What is between the levels belongs to the state before.
    states = np.where(part > 0.75, 1, np.where(part < 0.25, 0, -1))
    known = np.maximum.accumulate(np.where(states >= 0, np.arange(len(states)), 0))
    states = states[known]
    ends = np.flatnonzero(np.diff(states)) + 1
    if len(ends) < _SWITCHES:
        return 0.0
    stays = np.diff(ends)
    usual = stay if stay is not None else float(np.median(stays))
    right = np.abs(stays - usual) <= max(1.5, 0.08 * usual)
    if usual < _SHORT or stays[right].sum() < _ON_TIME * stays.sum() or right.mean() < 0.5:
        return 0.0
    return 1 / noise
