"""Images of a scene, with exact pixel areas and the true positions of its patches.

Outlines are projected with the camera's own model, in pieces so short that the lens bends them by
less than a thousandth of a pixel, and are filled exactly (`raster.py`). Box pixels, the lens's
blur, vignetting, noise, eight bits and the camera's image processing follow. Occlusion by the body
is decided at pixel centers.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ..scenes.scene import Backdrop, Scene
from .camera_optics import Optics, defocus_kernel, lens_reach, pixel_gain, pixel_rays, row_light
from .raster import develop, fill_depth, paint
from .render_primitives import (
    EMPTY_BOX,
    Box,
    Canvas,
    RenderPrimitive,
    bounding_box,
    grow,
    render_primitives,
    union,
)

SPARE_NOISE = 1 << 18  # values in the bank of noise beyond those of one image


@dataclass(frozen=True)
class RenderedImage:
    """An image of a scene of m patches, and the truth about them.

    Attributes:
        image: Grey levels (h, w) uint8.
        visible: Share (m,) of each patch, without its margin, that is visible.
        corners: Corners (m, 4, 2) px of the patches; NaN behind the camera and beyond the reach of
            its lens.
    """

    image: NDArray[np.uint8]
    visible: Float
    corners: Float


def render(
    camera: Camera, scene: Scene, optics: Optics, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return the image (h, w) of a scene at rest."""
    return Renderer(camera, optics, rng).shoot(scene).image


class Renderer:
    """Renders images of one camera; it caches what does not change between images.

    Args:
        camera: The camera.
        optics: Lens, shutter and sensor of the camera.
        rng: Random generator of the noise.
    """

    def __init__(self, camera: Camera, optics: Optics, rng: np.random.Generator) -> None:
        self.camera, self.optics, self._rng = camera, optics, rng
        width, height = camera.size
        pad = 1 + int(np.ceil(3 * optics.blur + optics.defocus_radius))
        self._kernel = defocus_kernel(optics, pad) if optics.defocus_radius else None
        size = (width + 2 * pad, height + 2 * pad)
        self._canvas = Canvas(camera, lens_reach(camera), pad, size)
        self._inner = np.array([pad, pad, pad + width, pad + height])
        self._rays = pixel_rays(camera, pad)
        self._gain = pixel_gain(camera.size, optics)
        is_silent = optics.read_noise == 0 and optics.shot_noise == 0
        count = width * height + (1 if is_silent else SPARE_NOISE)
        self._noise = np.zeros(count, np.float32)
        if not is_silent:
            rng.standard_normal(dtype=np.float32, out=self._noise)
        shape = size[::-1]
        self._depth = np.full(shape, np.inf, np.float32)
        self._light, self._uncovered = np.zeros(shape, np.float32), np.ones(shape, np.float32)
        self._backdrop: Backdrop | None = None
        self._ground = np.zeros(shape, np.float32)
        self._wall = self._sharp = self._soft = self._ground
        self._last_box: Box = EMPTY_BOX

    def shoot(
        self, middle: Scene, instants: Sequence[Scene] = (), time: float = 0.0
    ) -> RenderedImage:
        """Render an image.

        Args:
            middle: The scene in the middle of the exposure; the body and the true corners are
                taken from it.
            instants: The scene at instants of the exposure (see `expose`), for what moves.
            time: Middle of the exposure, s.

        Returns:
            The image and the truth about the patches.

        Raises:
            CaptureError: The instants have different numbers of patches (`patches-differ`).
        """
        instants = instants or [middle]
        if any(len(s.patches) != len(middle.patches) for s in instants):
            raise CaptureError(
                "the number of patches changes during an exposure",
                code="patches-differ",
                where=f"camera {self.camera.name}",
            )
        self._set_backdrop(middle.backdrop)
        frames = [render_primitives(s, self._canvas) for s in instants]
        points, pixels, outline = self._project_body(middle)
        box = union([outline, *(p.box for frame in frames for p in frame)])
        view = _slices(box)
        self._depth[view], self._ground[view] = np.inf, self._wall[view]
        if middle.body is not None:
            fill_depth(
                pixels,
                middle.body.faces,
                points,
                middle.skin,
                middle.shade,
                box,
                self._depth,
                self._ground,
            )
        light = np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
        visible = np.zeros(len(middle.patches))
        for frame in frames:
            self._light[view], self._uncovered[view] = 0, 1
            for primitive in frame:
                area = self._paint(primitive, middle.slack)
                if primitive.patch >= 0:
                    visible[primitive.patch] += area / max(primitive.area, 1e-9) / len(frames)
            light += self._light[view] + self._uncovered[view] * self._ground[view]
        self._update_blurred(light / np.float32(len(frames)), box)
        corners = np.array([p.corners for p in middle.patches]).reshape(-1, 4, 3)
        true_corners = self._canvas.project(self.camera.to_camera(corners))
        return RenderedImage(self._develop(time), np.clip(visible, 0, 1), true_corners)

    def _set_backdrop(self, backdrop: Backdrop) -> None:
        if backdrop != self._backdrop:
            self._backdrop, self._last_box = backdrop, EMPTY_BOX
            self._wall = _render_wall(backdrop, self.camera, self._canvas.pad)
            self._sharp = self._wall.copy()
            self._soft = self._blur(self._wall)

    def _project_body(self, scene: Scene) -> tuple[Float, Float, Box]:
        """Return vertices (n, 3) mm in the camera's frame, (n, 2) px of the canvas, and a box."""
        if scene.body is None:
            return np.empty((0, 3)), np.empty((0, 2)), EMPTY_BOX
        points = self.camera.to_camera(scene.body.vertices)
        pixels = self._canvas.project(points) + self._canvas.pad
        return points, pixels, bounding_box(pixels, self._canvas.size)

    def _paint(self, primitive: RenderPrimitive, slack: float) -> float:
        """Paint a primitive behind what is painted already; return its visible area, px."""
        return float(
            paint(
                primitive.edges,
                primitive.weights,
                primitive.plane,
                primitive.scale,
                np.array(primitive.box),
                self._rays,
                self._depth,
                slack if primitive.patch >= 0 else 0.0,
                self._inner,
                self._light,
                self._uncovered,
            )
        )

    def _update_blurred(self, light: NDArray[np.float32], box: Box) -> None:
        """Replace what was drawn in the last image, and blur the parts that changed."""
        self._sharp[_slices(self._last_box)] = self._wall[_slices(self._last_box)]
        self._sharp[_slices(box)] = light
        pad, size = self._canvas.pad, self._canvas.size
        changed = grow(union([box, self._last_box]), pad, size)
        source = grow(changed, pad, size)
        x, y = changed[0] - source[0], changed[1] - source[1]
        soft = self._blur(self._sharp[_slices(source)])
        height, width = changed[3] - changed[1], changed[2] - changed[0]
        self._soft[_slices(changed)] = soft[y : y + height, x : x + width]
        self._last_box = box

    def _blur(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        if light.size == 0:
            return light.copy()
        if self._kernel is not None:
            soft = cv2.filter2D(light, -1, self._kernel, borderType=cv2.BORDER_REPLICATE)
            return np.asarray(soft, np.float32)
        if self.optics.blur == 0:
            return light.copy()
        size, sigma = 2 * self._canvas.pad - 1, self.optics.blur
        soft = cv2.GaussianBlur(light, (size, size), sigma, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(soft, np.float32)

    def _develop(self, time: float) -> NDArray[np.uint8]:
        """Return the grey levels (h, w) with gain, noise and image processing."""
        width, height = self.camera.size
        image = np.empty((height, width), np.uint8)
        start = int(self._rng.integers(len(self._noise) - width * height))
        sign = float(self._rng.choice([-1.0, 1.0]))
        o = self.optics
        gain = self._gain
        if o.flicker or o.gain_wander:
            gain = gain * row_light(o, time, height)[:, None]
        develop(
            self._soft,
            self._canvas.pad,
            gain,
            o.read_noise,
            o.shot_noise,
            self._noise,
            start,
            sign,
            image,
        )
        return image if o.processing is None else o.processing.run(image)


def _slices(box: Box) -> tuple[slice, slice]:
    return slice(box[1], box[3]), slice(box[0], box[2])


def _render_wall(backdrop: Backdrop, camera: Camera, pad: int) -> NDArray[np.float32]:
    """Return the grey levels (h + 2 pad, w + 2 pad) of the background, which is out of focus."""
    width, height = camera.size
    x, y = ((np.arange(-pad, n + pad) / n - 0.5).astype(np.float32) for n in camera.size)
    levels = backdrop.level + backdrop.slope[0] * x + backdrop.slope[1] * y[:, None]
    if backdrop.texture:
        rng = np.random.default_rng([backdrop.seed, zlib.crc32(camera.name.encode())])
        shape = [2 + n // backdrop.grain for n in (height, width)]
        coarse = rng.normal(0, backdrop.texture, shape).astype(np.float32)
        levels += cv2.resize(coarse, (len(x), len(y)), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(np.clip(levels, 0, 255), np.float32)
