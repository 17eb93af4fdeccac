"""Detect tags in realistic pictures, and compare with plain OpenCV.

    python -m benchmarks.pictures                        # every condition, two cameras, 12 tags
    python -m benchmarks.pictures clean sharpened-1.6 --frames 20 --seed 3

The pictures share no code with the twin or the corner fit. 36 rays per pixel meet the tags' planes,
a disc (a lens out of focus) blurs the result, square pixels average it, and the effects of the
condition follow. Only `twin-webcam`, `twin-phone` and `twin-industrial` are pictures of the twin.
`found` is the share of the completely visible tags that are detected. `centre` is the error of the
tags' centers with the true cameras (RMS and 95th percentile), for tags that both methods detect.
`inside` is the share of coordinates within two stated standard deviations. Plain OpenCV is
ArucoDetector with default settings; the same code triangulates its corners, with one covariance for
all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.markers import bent, cameras
from defsense_fab.capture.tags.detection import Detector
from defsense_fab.capture.tags.tag_patterns import Dictionary, dictionary
from defsense_fab.capture.tracking.reconstruction import triangulate
from defsense_fab.core.arrays import Float
from defsense_fab.core.camera import Camera
from defsense_fab.twin.filming.camera_kinds import CAMERA_KINDS, CameraKind, print_patch
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Patch, Scene

Image = NDArray[np.uint8]
FINE, TAGS, SIDE = 6, 12, 15.0
PAPER, INK, WALL = 205.0, 28.0, 110.0


@dataclass(frozen=True)
class Condition:
    """How a picture is made from light (h, w) in gray levels, before noise.

    Attributes `focus` (radius of the disc, px), `noise` (gray levels), `light` (factor), `motion`
    (px), and the processing by the camera afterwards.
    """

    focus: float = 0.9
    noise: float = 2.0
    light: float = 1.0
    motion: float = 0.0
    then: tuple[Callable[[Float, np.random.Generator], Float], ...] = ()


def unsharp(amount: float, sigma: float = 1.2) -> Callable[[Float, np.random.Generator], Float]:
    return lambda v, _: v + amount * (v - cv2.GaussianBlur(v, (0, 0), sigma))


def gamma(exponent: float) -> Callable[[Float, np.random.Generator], Float]:
    return lambda v, _: 255 * (np.clip(v, 0, 255) / 255) ** exponent


def jpeg(quality: int) -> Callable[[Float, np.random.Generator], Float]:
    def run(v: Float, _: np.random.Generator) -> Float:
        kind = [cv2.IMWRITE_JPEG_QUALITY, quality]
        _, data = cv2.imencode(".jpg", np.clip(v + 0.5, 0, 255).astype(np.uint8), kind)
        return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).astype(float)

    return run


def mosaic(v: Float, rng: np.random.Generator) -> Float:
    """Return a gray scene under warm light as a Bayer pattern that OpenCV demosaics."""
    gains = np.array([[1.08, 1.0], [1.0, 0.78]])
    tiles = np.tile(gains, (v.shape[0] // 2 + 1, v.shape[1] // 2 + 1))[: v.shape[0], : v.shape[1]]
    raw = np.clip(v * tiles + 0.5, 0, 255).astype(np.uint8)
    colour = cv2.cvtColor(raw, cv2.COLOR_BayerRGGB2BGR).astype(float) / [0.78, 1.0, 1.08]
    return cv2.cvtColor(np.clip(colour, 0, 255).astype(np.float32), cv2.COLOR_BGR2GRAY)


CONDITIONS: dict[str, Condition] = {
    "clean": Condition(),
    "dim": Condition(light=0.35, noise=3.0),
    "jpeg-60": Condition(then=(jpeg(60),)),
    "motion-4px": Condition(motion=4.0),
    "sharpened-0.8": Condition(then=(unsharp(0.8),)),
    "sharpened-1.6": Condition(then=(unsharp(1.6),)),
    "sharpened-wide": Condition(noise=1.5, then=(unsharp(1.6, 2.0),)),
    "sharpened-crisp": Condition(focus=0.5, noise=0.7, then=(unsharp(1.6, 1.0),)),
    "over-exposed": Condition(light=1.5),
    "mosaic": Condition(then=(mosaic,)),
    "gamma-0.55": Condition(then=(gamma(0.55),)),
    "out-of-focus": Condition(focus=2.5),
    "webcam": Condition(
        focus=1.2, noise=3.0, light=1.1,
        then=(mosaic, gamma(0.6), unsharp(1.2, 1.0), jpeg(75)),
    ),
    "webcam-dim": Condition(
        focus=1.2, noise=5.0, light=0.5,
        then=(mosaic, gamma(0.6), unsharp(1.2, 1.0), jpeg(60)),
    ),
    "phone": Condition(focus=0.7, noise=1.5, then=(gamma(0.5), unsharp(0.6, 2.0), jpeg(90))),
}  # fmt: skip


def tags(rng: np.random.Generator, family: Dictionary) -> list[Patch]:
    """Return tags in four columns and three rows, tilted by up to 30 degrees."""
    out = []
    for k in range(TAGS):
        center = np.array([(k % 4 - 1.5) * 38.0, (k // 4 - 1.0) * 36.0, 0.0])
        center += rng.normal(size=3) * [2, 2, 8]
        turn = Rotation.from_rotvec(np.radians([0, 0, rng.uniform(-180, 180)]))
        lean = Rotation.from_rotvec(np.radians([*rng.uniform(-30, 30, 2), 0]))
        axes = (turn * lean).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        out.append(Patch(k, family.pattern(k), center, axes, SIDE))
    return out


def backdrop(camera: Camera) -> Float:
    y, x = np.mgrid[0 : camera.size[1], 0 : camera.size[0]].astype(np.float32)
    return WALL + 25 * np.sin(x / 97) * np.cos(y / 61) + 0.02 * x


def seen_of(camera: Camera, patch: Patch, box: tuple[int, int, int, int], wall: Float) -> Float:
    """Return the light of the pixels of a box x0, y0, x1, y1, at FINE times their number.

    Each ray meets a cell of the tag's plane, or passes it.
    """
    x0, y0, x1, y1 = box
    y, x = np.mgrid[0 : (y1 - y0) * FINE, 0 : (x1 - x0) * FINE]
    at = np.stack([x, y], axis=-1).reshape(-1, 2)
    rays = camera.to_plane((at + 0.5) / FINE - 0.5 + [x0, y0])
    rays = np.column_stack([rays, np.ones(len(rays))]) @ camera.rotation
    normal = patch.axes[:, 2]
    reach = normal @ (patch.center - camera.center) / (rays @ normal)
    flat = (camera.center + reach[:, None] * rays - patch.center) @ patch.axes[:, :2]
    n = patch.pattern.shape[0]
    column, row = flat[:, 0] / patch.cell + n / 2, n / 2 - flat[:, 1] / patch.cell
    on = (np.minimum(column, row) > -1) & (np.maximum(column, row) < n + 1)
    inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < n)
    cell = np.clip(np.stack([row, column]).astype(int), 0, n - 1)
    white = ~inside | (patch.pattern[cell[0], cell[1]] > 128)
    lit = 1 + 0.1 * float(patch.axes[0, 2])
    out = np.where(on, np.where(white, PAPER, INK) * lit, wall[y0:y1, x0:x1].mean())
    return out.reshape(y.shape).astype(np.float32)


def expose(
    camera: Camera, patches: list[Patch], condition: Condition, rng: np.random.Generator
) -> Image:
    """Return the picture (h, w) of tags."""
    light, kernel = backdrop(camera), spread_of(condition, rng)
    pad = kernel.shape[0] // (2 * FINE) + 2
    for p in sorted(patches, key=lambda p: -p.center[2]):
        n = p.pattern.shape[0]
        around = np.array([[-1, -1], [n + 1, -1], [n + 1, n + 1], [-1, n + 1]])
        outline = camera.project(p.to_world(around))
        low, high = np.floor(outline.min(0)) - pad, np.ceil(outline.max(0)) + pad + 1
        x0, y0 = np.maximum(low, 0).astype(int)
        x1, y1 = np.minimum(high, camera.size).astype(int)
        if x1 - x0 < 4 * pad or y1 - y0 < 4 * pad:
            continue
        fine = cv2.filter2D(
            seen_of(camera, p, (x0, y0, x1, y1), light), -1, kernel, borderType=cv2.BORDER_REPLICATE
        )
        visible = cv2.resize(fine, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
        light[y0:y1, x0:x1] = visible
    value = light * condition.light
    spread = np.sqrt(condition.noise**2 * (0.4 + 0.6 * np.maximum(value, 0) / 128))
    value = np.clip(value + spread * rng.standard_normal(value.shape), 0, 255)
    for step in condition.then:
        value = step(value.astype(np.float32), rng)
    return np.clip(value + 0.5, 0, 255).astype(np.uint8)


def spread_of(condition: Condition, rng: np.random.Generator) -> Float:
    """Return the image of a point in fine pixels: a disc, and a line if there is motion."""
    radius = condition.focus * FINE
    length = round(condition.motion * FINE)
    n = int(np.ceil(radius)) + length // 2 + 1
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    disc = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1).astype(np.float32)
    if length:
        way, line = rng.uniform(0, np.pi), np.zeros_like(disc)
        for s in np.linspace(-length / 2, length / 2, 4 * length):
            line[round(n + s * np.sin(way)), round(n + s * np.cos(way))] += 1
        disc = cv2.filter2D(disc, -1, line, borderType=cv2.BORDER_CONSTANT)
    return disc / disc.sum()


@dataclass(frozen=True)
class Result:
    """Result of one method in a condition.

    It has the share of found tags, the RMS and the 95th percentile of the errors of the centers
    (mm), and the share of their coordinates within two standard deviations.
    """

    found: float
    rms: float
    p95: float
    inside: float


def filmed(
    camera: Camera, patches: list[Patch], kind: CameraKind, rng: np.random.Generator
) -> Image:
    """Return the picture (h, w) of tags by the twin's camera."""
    prints = tuple(print_patch(p, kind.ink, kind.curl) for p in patches)
    renderer = Renderer(camera, kind.optics, rng)
    return renderer.shoot(Scene(prints, gloss=kind.gloss), time=float(rng.uniform(0, 10))).image


def measure(
    condition: Condition | CameraKind, frames: int, seed: int, name: str = "4X4_50"
) -> tuple[Result, Result]:
    """Return the results of our detector and of plain OpenCV."""
    rng = np.random.default_rng(seed)
    family, rig = dictionary(name), cameras()
    ours = [Detector(c, family) for c in rig]
    plain = cv2.aruco.ArucoDetector(family.table, cv2.aruco.DetectorParameters())
    still = tags(rng, family)
    shown, visible = 0, [0, 0]
    errors: list[list[Float]] = [[], []]
    scaled: list[Float] = []
    for k in range(frames):
        patches = bent(still, k / 7)
        truth = np.array([p.center for p in patches])
        views: list[Float] = [np.full((TAGS, 2, 4, 2), np.nan) for _ in range(2)]
        spread = np.full((TAGS, 2, 5, 2, 2), np.nan)
        for c, camera in enumerate(rig):
            image = (
                expose(camera, patches, condition, rng)
                if isinstance(condition, Condition)
                else filmed(camera, patches, condition, rng)
            )
            shown += TAGS
            view = ours[c].find(image)
            view = view.only(view.ids < TAGS)
            views[0][view.ids, c], spread[view.ids, c] = view.corners, view.covariance
            quads, ids, _ = plain.detectMarkers(image)
            for quad, number in zip(quads, () if ids is None else ids.ravel(), strict=True):
                if number >= TAGS:
                    continue
                flat = camera.to_plane(quad[0].astype(float)) * camera.focal
                views[1][number, c] = flat + camera.matrix[:2, 2]
        even = np.broadcast_to(0.25 * np.eye(2), spread.shape)
        detections = [triangulate(rig, v, s) for v, s in zip(views, (spread, even), strict=True)]
        for m, v in enumerate(views):
            visible[m] += int(np.isfinite(v[:, :, 0, 0]).sum())
        both = np.isfinite(detections[0].points[:, 0]) & np.isfinite(detections[1].points[:, 0])
        for m in range(2):
            errors[m].append(np.linalg.norm(detections[m].points - truth, axis=1)[both])
        own_method = np.isfinite(detections[0].points[:, 0])
        sigma = np.sqrt(np.diagonal(detections[0].covariance[own_method], axis1=1, axis2=2))
        scaled.append(np.abs(detections[0].points[own_method] - truth[own_method]) / sigma)
    stated = np.concatenate(scaled).ravel()
    out = []
    for m in range(2):
        e = np.concatenate(errors[m])
        out.append(
            Result(
                visible[m] / shown,
                float(np.sqrt(np.mean(e**2))) if len(e) else np.nan,
                float(np.percentile(e, 95)) if len(e) else np.nan,
                float((stated <= 2).mean()) if m == 0 and len(stated) else np.nan,
            )
        )
    return out[0], out[1]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    every = CONDITIONS | {f"twin-{name}": kind for name, kind in CAMERA_KINDS.items()}
    parser.add_argument("condition", nargs="*", help=f"of {', '.join(every)}")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tags", default="4X4_50")
    options = parser.parse_args()
    sys.stdout.write(
        f"{'':16}{'found':>7}{'OpenCV':>8}{'centre, mm':>12}{'p95':>8}{'OpenCV':>9}{'p95':>8}"
        f"{'inside':>8}\n"
    )
    for name in options.condition or every:
        a, b = measure(every[name], options.frames, options.seed, options.tags)
        sys.stdout.write(
            f"{name:16}{a.found:7.1%}{b.found:8.1%}{a.rms:12.4f}{a.p95:8.4f}{b.rms:9.4f}"
            f"{b.p95:8.4f}{a.inside:8.1%}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
