"""What a consumer's camera makes of its sensor's values: colours, tones, sharpness, compression."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.camera import Camera, distort
from ...core.errors import CaptureError

# What a lens shows, and where its model ends.

_STEP = 8  # px between exact rays; in between they are interpolated


def reach_of_lens(camera: Camera) -> float:
    """How far from the axis, on the plane at depth one, the model of the lens holds: further out
    it would fold back into the image."""
    r = np.linspace(0, 4, 4001)
    shown = distort(np.stack([r, 0 * r], axis=-1), camera.distortions, fisheye=camera.fisheye)[0][
        :, 0
    ]
    back = np.flatnonzero(~(np.diff(shown) > 0))
    return float(r[back[0]]) if len(back) else float(r[-1])


def project(camera: Camera, points: Float, limit: float) -> Float:
    """Points (..., 3) mm in the camera's frame to px (..., 2); NaN behind it or beyond the lens."""
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = points[..., :2] / points[..., 2:]
    seen = (points[..., 2] > 0) & ((plane * plane).sum(-1) < limit * limit)
    return camera.to_pixels(np.where(seen[..., None], plane, np.nan))


def plane_of_pixels(camera: Camera, pad: int) -> NDArray[np.float32]:
    """Undistorted points at depth one (h + 2 pad, w + 2 pad, 2) of the pixels and of `pad` more
    around the image; interpolated, which will do for depths."""
    width, height = (n + 2 * pad for n in camera.size)
    x, y = (np.arange(0, n + _STEP, _STEP) for n in (width, height))
    exact = camera.to_plane(np.stack(np.meshgrid(x - pad, y - pad), axis=-1).astype(float))
    rows, columns = _hats(height, len(y)), _hats(width, len(x))
    return np.stack([rows @ exact[..., k] @ columns.T for k in (0, 1)], axis=-1).astype(np.float32)


def _hats(count: int, knots: int) -> Float:
    """Weights (count, knots) of linear interpolation between knots every `_STEP`."""
    away = np.abs(np.arange(count)[:, None] / _STEP - np.arange(knots))
    return np.asarray(np.maximum(1 - away, 0))


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


@dataclass(frozen=True)
class Optics:
    """What makes a picture of what is seen: `blur`, standard deviation of the point spread, px, of
    a lens out of focus by discs of radius `focus` px; `exposure` s; noise of variance
    `read`^2 + `shot` * level, grey levels; `gain`, grey levels per level of the scene;
    `vignetting`, the part of the light that is lost in the image's corners, `slant` that on its
    right; `rolling` s from the first row to the last; `flicker`, the part by which lamps at 50 Hz
    change, `wander` that by which the automatic exposure does; `processing` of the values."""

    blur: float = 0.6
    exposure: float = 0.004
    read: float = 1.5
    shot: float = 0.03
    gain: float = 1.0
    vignetting: float = 0.15
    focus: float = 0.0
    slant: float = 0.0
    rolling: float = 0.0
    flicker: float = 0.0
    wander: float = 0.0
    processing: ImageProcessing | None = None

    def __post_init__(self) -> None:
        rest = (self.blur, self.focus, self.exposure, self.read, self.shot, self.rolling)
        parts = (self.vignetting, self.slant, self.flicker, self.wander)
        if not (all(x >= 0 for x in rest) and self.gain > 0 and all(0 <= x <= 1 for x in parts)):
            raise CaptureError(
                "blur, times and noise must be at least 0, the gain positive, and shares of the"
                " light from 0 to 1",
                code="setting-out-of-range",
                where="optics",
                record="optics",
            )
