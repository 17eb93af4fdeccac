"""What a consumer's camera makes of its sensor's values: colours, tones, sharpness, compression."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.errors import CaptureError

Image = NDArray[np.uint8]
#: What red, green and blue pixels see of grey in warm light.
_RED, _GREEN, _BLUE = 1.08, 1.0, 0.78


@dataclass(frozen=True)
class ImageProcessing:
    """In this order: a Bayer `mosaic` of colours is filled in, tones are raised to the power of
    `gamma`, edges `sharpened` by that part of what a Gaussian blur of `radius` px takes away, and
    the picture is compressed as a JPEG of a `quality` of 1 to 100 (None: it is not)."""

    mosaic: bool = True
    gamma: float = 0.6
    sharpened: float = 1.2
    radius: float = 1.0
    quality: int | None = 75

    def __post_init__(self) -> None:
        quality = 100 if self.quality is None else self.quality
        if not (self.gamma > 0 and self.sharpened >= 0 and self.radius > 0 and 1 <= quality <= 100):
            raise CaptureError(
                "gamma and radius must be positive, sharpening at least 0, and quality from 1 to"
                " 100",
                code="setting-out-of-range",
                where="image processing",
                record="image processing",
            )

    def tiles(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """The part (h, w) of grey light that each pixel of a sensor of `size` sees."""
        width, height = size
        if not self.mosaic:
            return np.ones((height, width), np.float32)
        tile = np.array([[_RED, _GREEN], [_GREEN, _BLUE]], np.float32)
        return np.tile(tile, (height // 2 + 1, width // 2 + 1))[:height, :width]

    def run(self, raw: Image) -> Image:
        """A sensor's values (h, w) as the camera delivers them in grey."""
        image = raw
        if self.mosaic:
            colour = cv2.cvtColor(image, cv2.COLOR_BayerRGGB2BGR)
            image = cv2.cvtColor(cv2.LUT(colour, self._balance), cv2.COLOR_BGR2GRAY)
        if self.gamma != 1:
            image = cv2.LUT(image, self._tones)
        if self.sharpened:
            soft = cv2.GaussianBlur(image, (0, 0), self.radius)
            image = cv2.addWeighted(image, 1 + self.sharpened, soft, -self.sharpened, 0)
        if self.quality is not None:
            _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.quality])
            image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)
        return np.asarray(image, np.uint8)

    @cached_property
    def _balance(self) -> Image:
        """The white balance (256, 1, 3), blue first."""
        levels: Float = np.arange(256.0)[:, None, None] / [_BLUE, _GREEN, _RED]
        return np.clip(levels + 0.5, 0, 255).astype(np.uint8)

    @cached_property
    def _tones(self) -> Image:
        return (255 * (np.arange(256) / 255) ** self.gamma + 0.5).astype(np.uint8)
