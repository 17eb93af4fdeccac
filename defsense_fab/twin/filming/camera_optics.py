"""Lens, sensor and image processing of simulated cameras."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.camera import Camera, distort
from ...core.errors import CaptureError

Image = NDArray[np.uint8]
# Sensitivity of red, green and blue pixels to grey in warm light.
RED_GAIN, GREEN_GAIN, BLUE_GAIN = 1.08, 1.0, 0.78
RAY_SPACING_PX = 8  # between exactly undistorted pixels; others are interpolated
LAMP_FLICKER_HZ = 100.0  # of lamps at 50 Hz mains
GAIN_WANDER_PERIOD_S = 7.0  # of the automatic exposure
KERNEL_SUBSAMPLES = 8  # per pixel, of the disc of a lens out of focus


@dataclass(frozen=True)
class ImageProcessing:
    """Processing of the sensor's values in a consumer camera, in the order of the fields.

    Attributes:
        mosaic: Whether the sensor has a Bayer mosaic, whose colors are interpolated.
        gamma: Exponent of the tone curve.
        sharpening: Share of the detail removed by a blur that is added to the image.
        radius: Standard deviation of the blur, px.
        quality: JPEG quality, 1 to 100; None for no compression.

    Raises:
        CaptureError: A value is out of range (`out-of-range`).
    """

    mosaic: bool = True
    gamma: float = 0.6
    sharpening: float = 1.2
    radius: float = 1.0
    quality: int | None = 75

    def __post_init__(self) -> None:
        quality = 100 if self.quality is None else self.quality
        is_valid = self.gamma > 0 and self.sharpening >= 0 and self.radius > 0
        if not (is_valid and 1 <= quality <= 100):
            raise CaptureError(
                "gamma and radius must be positive, sharpening at least 0, and quality from 1 to"
                " 100",
                code="out-of-range",
                where="image processing",
                record="image processing",
            )

    def sensitivity(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return the sensitivity (h, w) of each pixel to grey light, for a sensor of `size` px."""
        width, height = size
        if not self.mosaic:
            return np.ones((height, width), np.float32)
        tile = np.array([[RED_GAIN, GREEN_GAIN], [GREEN_GAIN, BLUE_GAIN]], np.float32)
        return np.tile(tile, (height // 2 + 1, width // 2 + 1))[:height, :width]

    def run(self, raw: Image) -> Image:
        """Return the grey image (h, w) that the camera delivers for sensor values (h, w)."""
        image = raw
        if self.mosaic:
            color = cv2.cvtColor(image, cv2.COLOR_BayerRGGB2BGR)
            image = cv2.cvtColor(cv2.LUT(color, self._white_balance), cv2.COLOR_BGR2GRAY)
        if self.gamma != 1:
            image = cv2.LUT(image, self._tone_curve)
        if self.sharpening:
            soft = cv2.GaussianBlur(image, (0, 0), self.radius)
            image = cv2.addWeighted(image, 1 + self.sharpening, soft, -self.sharpening, 0)
        if self.quality is not None:
            _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, self.quality])
            image = np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)
        return np.asarray(image, np.uint8)

    @cached_property
    def _white_balance(self) -> Image:
        """Lookup table (256, 1, 3), blue first."""
        levels: Float = np.arange(256.0)[:, None, None] / [BLUE_GAIN, GREEN_GAIN, RED_GAIN]
        return np.clip(levels + 0.5, 0, 255).astype(np.uint8)

    @cached_property
    def _tone_curve(self) -> Image:
        return (255 * (np.arange(256) / 255) ** self.gamma + 0.5).astype(np.uint8)


@dataclass(frozen=True)
class Optics:
    """Lens, shutter and sensor of a simulated camera.

    Attributes:
        blur: Standard deviation of the point spread, px.
        exposure: Exposure time, s.
        read_noise: Standard deviation of the read noise, grey levels.
        shot_noise: Variance of the noise per grey level; the variance of a pixel is
            read_noise^2 + shot_noise * level.
        gain: Grey levels per level of the scene.
        vignetting: Share of the light that is lost in the corners of the image.
        defocus_radius: Radius of the discs of a lens out of focus, px.
        side_falloff: Share of the light that is lost on the right of the image.
        readout_time: Time from reading the first row to the last, s; 0 for a global shutter.
        flicker: Share by which lamps on 50 Hz mains change.
        gain_wander: Share by which the automatic exposure changes.
        processing: Processing of the sensor's values; None for none.

    Raises:
        CaptureError: A value is out of range (`out-of-range`).
    """

    blur: float = 0.6
    exposure: float = 0.004
    read_noise: float = 1.5
    shot_noise: float = 0.03
    gain: float = 1.0
    vignetting: float = 0.15
    defocus_radius: float = 0.0
    side_falloff: float = 0.0
    readout_time: float = 0.0
    flicker: float = 0.0
    gain_wander: float = 0.0
    processing: ImageProcessing | None = None

    def __post_init__(self) -> None:
        lengths = (self.blur, self.defocus_radius, self.exposure, self.readout_time)
        noise = (self.read_noise, self.shot_noise)
        shares = (self.vignetting, self.side_falloff, self.flicker, self.gain_wander)
        is_valid = all(x >= 0 for x in lengths + noise) and self.gain > 0
        if not (is_valid and all(0 <= x <= 1 for x in shares)):
            raise CaptureError(
                "blur, times and noise must be at least 0, the gain positive, and shares of the"
                " light from 0 to 1",
                code="out-of-range",
                where="optics",
                record="optics",
            )


def pixel_gain(size: tuple[int, int], optics: Optics) -> NDArray[np.float32]:
    """Return the gain (h, w) of each pixel of an image of `size` px."""
    x, y = (np.linspace(-1, 1, n, dtype=np.float32) for n in size)
    loss = optics.vignetting * (x * x + y[:, None] * y[:, None]) / 2
    gain = optics.gain * (1 - loss) * (1 - optics.side_falloff * (1 + x) / 2)
    if optics.processing is not None:
        gain = gain * optics.processing.sensitivity(size)
    return np.asarray(gain, np.float32)


def row_light(optics: Optics, time: float, rows: int) -> NDArray[np.float32]:
    """Return the share of the light (rows,) that each row gets in an exposure at `time` s."""
    row_time = time + optics.readout_time * (np.arange(rows) / rows - 0.5)
    # A shutter that is open for whole periods of the lamps does not record their flicker.
    flicker = optics.flicker * np.sinc(LAMP_FLICKER_HZ * optics.exposure)
    light = 1 + flicker * np.sin(2 * np.pi * LAMP_FLICKER_HZ * row_time)
    light = light * (1 + optics.gain_wander * np.sin(2 * np.pi * time / GAIN_WANDER_PERIOD_S))
    return np.asarray(light, np.float32)


def defocus_kernel(optics: Optics, reach: int) -> NDArray[np.float32]:
    """Return the point spread (2 reach + 1, 2 reach + 1) of a lens out of focus.

    It is a disc, softened by the Gaussian blur of the lens.
    """
    n = (2 * reach + 1) * KERNEL_SUBSAMPLES
    x = (np.arange(n) - (n - 1) / 2) / KERNEL_SUBSAMPLES
    disc = (np.hypot(x, x[:, None]) <= optics.defocus_radius).astype(np.float32)
    if optics.blur:
        disc = cv2.GaussianBlur(disc, (0, 0), optics.blur * KERNEL_SUBSAMPLES)
    kernel = cv2.resize(disc, (2 * reach + 1, 2 * reach + 1), interpolation=cv2.INTER_AREA)
    return np.asarray(kernel / kernel.sum(), np.float32)


def lens_reach(camera: Camera) -> float:
    """Return the radius, on the plane at depth one, up to which the lens model is monotonic.

    Further out the model would fold back into the image.
    """
    r = np.linspace(0, 4, 4001)
    axis = np.stack([r, 0 * r], axis=-1)
    distorted = distort(axis, camera.distortions, fisheye=camera.fisheye)[0][:, 0]
    folds = np.flatnonzero(~(np.diff(distorted) > 0))
    return float(r[folds[0]]) if len(folds) else float(r[-1])


def project(camera: Camera, points: Float, reach: float) -> Float:
    """Project points to the image.

    Args:
        camera: The camera.
        points: Points (..., 3) mm in the frame of the camera.
        reach: Result of `lens_reach`.

    Returns:
        Pixels (..., 2); NaN behind the camera and beyond the reach of its lens.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = points[..., :2] / points[..., 2:]
    is_visible = (points[..., 2] > 0) & ((plane * plane).sum(-1) < reach * reach)
    return camera.to_pixels(np.where(is_visible[..., None], plane, np.nan))


def pixel_rays(camera: Camera, pad: int) -> NDArray[np.float32]:
    """Return the undistorted points, at depth one, of the pixels and `pad` more on each side.

    They are interpolated between every eighth pixel, which is accurate enough for depths.

    Returns:
        Points (h + 2 pad, w + 2 pad, 2).
    """
    width, height = (n + 2 * pad for n in camera.size)
    x, y = (np.arange(0, n + RAY_SPACING_PX, RAY_SPACING_PX) for n in (width, height))
    exact = camera.to_plane(np.stack(np.meshgrid(x - pad, y - pad), axis=-1).astype(float))
    rows, columns = _hat_weights(height, len(y)), _hat_weights(width, len(x))
    return np.stack([rows @ exact[..., k] @ columns.T for k in (0, 1)], axis=-1).astype(np.float32)


def _hat_weights(count: int, knots: int) -> Float:
    """Return the weights (count, knots) of linear interpolation between the knots."""
    distance = np.abs(np.arange(count)[:, None] / RAY_SPACING_PX - np.arange(knots))
    return np.asarray(np.maximum(1 - distance, 0))
