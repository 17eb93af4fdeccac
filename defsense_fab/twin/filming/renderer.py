"""The twin's cameras: pictures of a scene whose every pixel is an area, with their truth.

Outlines are projected by the camera's own model, in pieces so short that what remains of the lens's
bending is under a thousandth of a pixel, and filled exactly (`raster.py`); a box pixel, the lens's
blur, vignetting, noise, eight bits, and what a camera does to them, follow. Occlusion by the
body goes by pixel centres.
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
from .camera_optics import Optics, plane_of_pixels, project, reach_of_lens
from .raster import develop, fill_depth, paint
from .render_primitives import Box, RenderPrimitive, box_of, grown, render_primitives, union

# What is behind everything: a wall with a gradient and blotches, out of focus, at rest.


def wall(backdrop: Backdrop, camera: Camera, pad: int) -> NDArray[np.float32]:
    """Grey levels (h + 2 pad, w + 2 pad) of the image and `pad` px around it."""
    width, height = camera.size
    x, y = ((np.arange(-pad, n + pad) / n - 0.5).astype(np.float32) for n in camera.size)
    out = backdrop.level + backdrop.slope[0] * x + backdrop.slope[1] * y[:, None]
    if backdrop.texture:
        rng = np.random.default_rng([backdrop.seed, zlib.crc32(camera.name.encode())])
        shape = [2 + n // backdrop.grain for n in (height, width)]
        coarse = rng.normal(0, backdrop.texture, shape).astype(np.float32)
        out += cv2.resize(coarse, (len(x), len(y)), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(np.clip(out, 0, 255), np.float32)


_FLICKER, _WANDERS = 100.0, 7.0  # Hz of lamps at 50 Hz; s, period of the automatic exposure
_SPARE = 1 << 18  # values in the bank of noise beyond those of a picture


@dataclass(frozen=True)
class RenderedImage:
    """`image` (h, w) uint8 and the truth about the scene's m patches: the part (m,) of each,
    without its margin, that is in the picture, and its `corners` (m, 4, 2) px, NaN behind the
    camera and where the model of the lens has ended."""

    image: NDArray[np.uint8]
    visible: Float
    corners: Float


def render(
    camera: Camera, scene: Scene, optics: Optics, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """The image (h, w) of a scene that stands still."""
    return Renderer(camera, optics, rng).shoot(scene).image


class Renderer:
    """Takes pictures with one camera; keeps what does not change between them."""

    def __init__(self, camera: Camera, optics: Optics, rng: np.random.Generator) -> None:
        self.camera, self.optics, self._rng = camera, optics, rng
        width, height = camera.size
        self._pad = 1 + int(np.ceil(3 * optics.blur + optics.focus))
        self._kernel = _point_spread(optics, self._pad) if optics.focus else None
        self._size = (width + 2 * self._pad, height + 2 * self._pad)
        self._inner = np.array([self._pad, self._pad, self._pad + width, self._pad + height])
        self._rays = plane_of_pixels(camera, self._pad)
        self._limit = reach_of_lens(camera)
        self._gain = _gain(camera.size, optics)
        silent = optics.read == 0 and optics.shot == 0
        count = width * height + (1 if silent else _SPARE)
        self._noise = np.zeros(count, np.float32)
        if not silent:
            rng.standard_normal(dtype=np.float32, out=self._noise)
        shape = self._size[::-1]
        self._depth = np.full(shape, np.inf, np.float32)
        self._seen, self._left = np.zeros(shape, np.float32), np.ones(shape, np.float32)
        self._backdrop: Backdrop | None = None
        self._ground = np.zeros(shape, np.float32)
        self._wall = self._sharp = self._soft = self._ground
        self._last: Box = (0, 0, 0, 0)

    def shoot(
        self, middle: Scene, instants: Sequence[Scene] = (), time: float = 0.0
    ) -> RenderedImage:
        """A picture of a scene at a `time`, s; of what moves in it, as it is at `instants` of the
        exposure (see `exposure.py`): body and corners are those in the middle."""
        instants = instants or [middle]
        if any(len(s.patches) != len(middle.patches) for s in instants):
            raise CaptureError(
                "the number of patches changes during an exposure",
                code="patches-differ",
                where=f"camera {self.camera.name}",
            )
        self._hang(middle.backdrop)
        drawn = [
            render_primitives(s, self.camera, self._limit, self._pad, self._size) for s in instants
        ]
        points, pixels, outline = self._body(middle)
        box = union([outline, *(t.box for d in drawn for t in d)])
        view = _view(box)
        self._depth[view], self._ground[view] = np.inf, self._wall[view]
        if middle.body is not None:
            fill_depth(
                pixels, middle.body.faces, points, middle.skin, middle.shade, box, self._depth,
                self._ground,
            )  # fmt: skip
        light = np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
        visible = np.zeros(len(middle.patches))
        for d in drawn:
            self._seen[view], self._left[view] = 0, 1
            for thing in d:
                area = self._paint(thing, middle.slack)
                if thing.patch >= 0:
                    visible[thing.patch] += area / max(thing.area, 1e-9) / len(drawn)
            light += self._seen[view] + self._left[view] * self._ground[view]
        self._blur(light / np.float32(len(drawn)), box)
        corners = np.array([p.corners for p in middle.patches]).reshape(-1, 4, 3)
        shown = project(self.camera, self.camera.to_camera(corners), self._limit)
        return RenderedImage(self._develop(time), np.clip(visible, 0, 1), shown)

    def _hang(self, backdrop: Backdrop) -> None:
        if backdrop != self._backdrop:
            self._backdrop, self._last = backdrop, (0, 0, 0, 0)
            self._wall = wall(backdrop, self.camera, self._pad)
            self._sharp = self._wall.copy()
            self._soft = self._blurred(self._wall)

    def _body(self, scene: Scene) -> tuple[Float, Float, Box]:
        """Its vertices (n, 3) mm in the camera's frame, (n, 2) px of the canvas, and their box."""
        if scene.body is None:
            return np.empty((0, 3)), np.empty((0, 2)), (0, 0, 0, 0)
        points = self.camera.to_camera(scene.body.vertices)
        pixels = project(self.camera, points, self._limit) + self._pad
        return points, pixels, box_of(pixels, self._size)

    def _paint(self, thing: RenderPrimitive, slack: float) -> float:
        return float(
            paint(
                thing.edges, thing.weights, thing.plane, thing.scale, np.array(thing.box),
                self._rays, self._depth, slack if thing.patch >= 0 else 0.0, self._inner,
                self._seen, self._left,
            )
        )  # fmt: skip

    def _blur(self, light: NDArray[np.float32], box: Box) -> None:
        """Put what was drawn into the picture, in place of what was drawn last."""
        self._sharp[_view(self._last)] = self._wall[_view(self._last)]
        self._sharp[_view(box)] = light
        near = grown(union([box, self._last]), self._pad, self._size)
        wide = grown(near, self._pad, self._size)
        x, y = near[0] - wide[0], near[1] - wide[1]
        soft = self._blurred(self._sharp[_view(wide)])
        self._soft[_view(near)] = soft[y : y + near[3] - near[1], x : x + near[2] - near[0]]
        self._last = box

    def _blurred(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        if light.size == 0:
            return light.copy()
        if self._kernel is not None:
            soft = cv2.filter2D(light, -1, self._kernel, borderType=cv2.BORDER_REPLICATE)
            return np.asarray(soft, np.float32)
        if self.optics.blur == 0:
            return light.copy()
        size, sigma = 2 * self._pad - 1, self.optics.blur
        soft = cv2.GaussianBlur(light, (size, size), sigma, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(soft, np.float32)

    def _develop(self, time: float) -> NDArray[np.uint8]:
        width, height = self.camera.size
        out = np.empty((height, width), np.uint8)
        start = int(self._rng.integers(len(self._noise) - width * height))
        sign = float(self._rng.choice([-1.0, 1.0]))
        o = self.optics
        gain = self._gain
        if o.flicker or o.wander:
            gain = gain * _lamps(o, time, height)[:, None]
        develop(self._soft, self._pad, gain, o.read, o.shot, self._noise, start, sign, out)
        return out if o.processing is None else o.processing.run(out)


def _view(box: Box) -> tuple[slice, slice]:
    return slice(box[1], box[3]), slice(box[0], box[2])


def _gain(size: tuple[int, int], optics: Optics) -> NDArray[np.float32]:
    x, y = (np.linspace(-1, 1, n, dtype=np.float32) for n in size)
    lost = optics.vignetting * (x * x + y[:, None] * y[:, None]) / 2
    gain = optics.gain * (1 - lost) * (1 - optics.slant * (1 + x) / 2)
    if optics.processing is not None:
        gain = gain * optics.processing.tiles(size)
    return np.asarray(gain, np.float32)


def _lamps(optics: Optics, time: float, rows: int) -> NDArray[np.float32]:
    """How much of the light each row (h,) gets."""
    at = time + optics.rolling * (np.arange(rows) / rows - 0.5)
    # A shutter that is open for whole periods of the lamps does not see them flicker.
    seen = optics.flicker * np.sinc(_FLICKER * optics.exposure)
    lamps = 1 + seen * np.sin(2 * np.pi * _FLICKER * at)
    lamps = lamps * (1 + optics.wander * np.sin(2 * np.pi * time / _WANDERS))
    return np.asarray(lamps, np.float32)


def _point_spread(optics: Optics, reach: int) -> NDArray[np.float32]:
    """Of a lens out of focus (2 reach + 1, 2 reach + 1): a disc, softened by the rest of its
    blur."""
    fine = 8
    n = (2 * reach + 1) * fine
    at = (np.arange(n) - (n - 1) / 2) / fine
    disc = (np.hypot(at, at[:, None]) <= optics.focus).astype(np.float32)
    if optics.blur:
        disc = cv2.GaussianBlur(disc, (0, 0), optics.blur * fine)
    kernel = cv2.resize(disc, (2 * reach + 1, 2 * reach + 1), interpolation=cv2.INTER_AREA)
    return np.asarray(kernel / kernel.sum(), np.float32)
