"""Locate tags in pictures of the twin's cameras: time and error from image to 3D, against peers.

    python -m benchmarks.markers speed     # against pupil-apriltags and plain ArucoDetector + PnP
    python -m benchmarks.markers cpu       # pairs per CPU second of 12 tags, against OpenCV alone
    python -m benchmarks.markers table     # errors over tag size, blur, noise, baseline, tilt, gaps

Two cameras of 1280 x 720 px, f = 900 px, 400 mm away and 160 mm apart, see 20 tags of 15 mm. The
cameras are calibrated and arranged on rendered boards first. Errors are after a rigid alignment of
each frame.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from defsense_fab.capture.cameras.extrinsics import estimate_extrinsics
from defsense_fab.capture.cameras.image_sources import one_thread_per_call
from defsense_fab.capture.cameras.intrinsics import calibrate_camera
from defsense_fab.capture.tags.detection import BoardFinder, Detector, TagFollower, TagView
from defsense_fab.capture.tags.tag_patterns import CharucoBoard, Dictionary, dictionary
from defsense_fab.capture.tracking.alignment import align
from defsense_fab.capture.tracking.observations import observe, store_views
from defsense_fab.capture.tracking.reconstruction import reconstruct, tag_corners
from defsense_fab.core.arrays import Float
from defsense_fab.core.camera import Camera
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Patch, Scene

SIZE, FOCAL, AWAY, BASE, TAGS, SIDE = (1280, 720), 900.0, 400.0, 160.0, 20, 15.0
DISTORTIONS = np.array([0.05, -0.1, 0.001, -0.0005, 0.02])
UPRIGHT = np.diag([1.0, -1.0, -1.0])  # a picture that faces the cameras


def cameras(base: float = BASE) -> list[Camera]:
    out = []
    for k, x in enumerate((-base / 2, base / 2)):
        eye = np.array([x, 0, -AWAY])
        z = -eye / np.linalg.norm(eye)
        right = np.cross([0.0, 1, 0], z)
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(z, right), z])
        K = np.array([[FOCAL, 0, 646.5], [0, 1.002 * FOCAL, 354.5], [0, 0, 1]])
        out.append(Camera(f"cam_{k}", SIZE, K, DISTORTIONS, R, -R @ eye))
    return out


def device(rng: np.random.Generator, family: Dictionary, side: float, tilt: float) -> list[Patch]:
    """Return tilted tags in five columns and four rows."""
    out = []
    for k in range(TAGS):
        center = np.array([(k % 5 - 2) * 32.0, (k // 5 - 1.5) * 30.0, 0.0])
        center += rng.normal(size=3) * [2, 2, 8]
        turn = Rotation.from_rotvec(np.radians([0, 0, rng.uniform(-40, 40)]))
        lean = Rotation.from_rotvec(np.radians([*rng.uniform(-tilt, tilt, 2), 0]))
        axes = (turn * lean).as_matrix() @ UPRIGHT
        out.append(Patch(k, family.pattern(k), center, axes, side))
    return out


def bent(tags: list[Patch], t: float) -> list[Patch]:
    """Return the device as it bends and moves, at a time in s."""
    by = 0.6 * np.sin(2 * np.pi * 0.7 * t)
    held = Rotation.from_rotvec(
        0.25 * np.array([np.sin(2.1 * t), np.cos(1.7 * t), np.sin(1.3 * t)])
    )
    move = np.array([10 * np.sin(3 * t), 8 * np.cos(2 * t), 15 * np.sin(t)])
    out = []
    for p in tags:
        angle = by * p.center[0] / 80
        curl = Rotation.from_rotvec([0, angle, 0])
        x = p.center[0]
        at = np.array([x * np.sinc(angle / np.pi), p.center[1], p.center[2] - x * angle / 2])
        out.append(p.moved_to(held.apply(at) + move, (held * curl).as_matrix() @ p.axes))
    return out


def calibrated(true: list[Camera], optics: Optics, seed: int = 0) -> list[Camera]:
    """Return the cameras as calibrated from 30 rendered views of the default board."""
    rng = np.random.default_rng(seed)
    board = CharucoBoard()
    cell = 8 * (board.family.cells + 2 + 7)  # px of a square in the texture
    texture = board.charuco.generateImage((board.columns * cell, board.rows * cell), marginSize=0)
    finder = BoardFinder(board)
    renderers = [Renderer(c, optics, rng) for c in true]
    instants = []
    for _ in range(30):
        lean = Rotation.from_rotvec(np.radians([*rng.uniform(-40, 40, 2), 0]))
        turn = Rotation.from_rotvec(np.radians([0, 0, rng.uniform(-30, 30)]))
        place = rng.uniform([-90, -60, -80], [90, 60, 150])
        patch = Patch(
            0, np.asarray(texture, np.uint8), place, (turn * lean).as_matrix() @ UPRIGHT,
            board.columns * board.square, margin=cell / 2,
        )  # fmt: skip
        views = {}
        for c, renderer in enumerate(renderers):
            view = finder.find(renderer.shoot(Scene(patches=(patch,))).image)
            if view is not None:
                views[c] = view
        instants.append(views)
    detections = [
        calibrate_camera(c.name, SIZE, board, [v[k] for v in instants if k in v])
        for k, c in enumerate(true)
    ]
    rig = estimate_extrinsics(
        [f.camera for f in detections], board, instants, [f.sigma for f in detections]
    )
    return list(rig.cameras)


def corners_of(views: list[TagView], count: int = TAGS) -> tuple[Float, Float]:
    first = np.zeros(1, int)
    visible = [observe(np.zeros(1), store_views([v]), np.arange(count)).part(first) for v in views]
    return np.stack([s.corners for s in visible], 2), np.stack([s.covariance for s in visible], 2)


def error(points: Float, truth: Float, covariance: Float | None = None) -> Float:
    """Return distances (n,) mm after rigid alignment of a frame (m, 3).

    Covariances (m, 3, 3) weight the points, if given.
    """
    good = np.isfinite(points[:, 0])
    weights = None
    if covariance is not None:
        weights = np.where(good, 1 / np.trace(covariance, axis1=1, axis2=2), 0.0)
    back = align(points[None], truth, weights)
    return np.asarray(np.linalg.norm(back.points[0][good] - truth[good], axis=1))


# --- speed ------------------------------------------------------------------------------------


Result = tuple[Float, Float | None]


def ours(rig: list[Camera], family: Dictionary, side: float) -> Callable[[list[Float]], Result]:
    detectors = [TagFollower(c, family) for c in rig]
    pool = ThreadPoolExecutor(len(rig))

    def run(images: list[Float]) -> Result:
        with one_thread_per_call():
            jobs = [pool.submit(d.find, i) for d, i in zip(detectors, images, strict=True)]
            corners, covariance = corners_of([j.result() for j in jobs])
        detections = reconstruct(rig, corners, covariance, side)
        return detections.points[0], detections.covariance[0]

    return run


def plain(rig: list[Camera], family: Dictionary, side: float) -> Callable[[list[Float]], Result]:
    """Return the mean over cameras of centers by ArucoDetector and PnP, as in tutorials."""
    detector = cv2.aruco.ArucoDetector(family.table, cv2.aruco.DetectorParameters())
    model = tag_corners(side)

    def run(images: list[Float]) -> Result:
        sums, count = np.zeros((TAGS, 3)), np.zeros(TAGS)
        for camera, image in zip(rig, images, strict=True):
            quads, ids, _ = detector.detectMarkers(image)
            for quad, number in zip(quads, ids.ravel(), strict=True):
                _, _, t = cv2.solvePnP(
                    model, quad[0].astype(float), camera.matrix, camera.distortions,
                    flags=cv2.SOLVEPNP_IPPE_SQUARE,
                )  # fmt: skip
                sums[number] += camera.rotation.T @ (t.ravel() - camera.translation)
                count[number] += 1
        with np.errstate(all="ignore"):
            return sums / np.where(count > 0, count, np.nan)[:, None], None

    return run


def apriltags(rig: list[Camera], side: float) -> Callable[[list[Float]], Result]:
    """Return the mean over cameras of centers by pupil-apriltags, minus half a pixel."""
    import pupil_apriltags

    detector = pupil_apriltags.Detector("tag36h11", nthreads=2, quad_decimate=1.0)

    def run(images: list[Float]) -> Result:
        sums, count = np.zeros((TAGS, 3)), np.zeros(TAGS)
        for camera, image in zip(rig, images, strict=True):
            for tag in detector.detect(image):
                flat = camera.to_plane(np.asarray(tag.corners) - 0.5)
                # Its corners go the other way round: from the bottom left, against the clock.
                _, _, t = cv2.solvePnP(
                    tag_corners(side), flat[::-1].copy(), np.eye(3), None,
                    flags=cv2.SOLVEPNP_IPPE_SQUARE,
                )  # fmt: skip
                t = t.ravel()
                if tag.tag_id < TAGS:
                    sums[tag.tag_id] += camera.rotation.T @ (t - camera.translation)
                    count[tag.tag_id] += 1
        with np.errstate(all="ignore"):
            return sums / np.where(count > 0, count, np.nan)[:, None], None

    return run


def speed(frames: int = 30) -> None:
    rng = np.random.default_rng(0)
    optics = Optics(blur=0.8, exposure=0, read_noise=2.0)
    true = cameras()
    rig = calibrated(true, optics)
    pairs = []
    for name in ("4X4_50", "APRILTAG_36H11"):
        family = dictionary(name)
        tags = device(rng, family, SIDE, 30)
        renderers = [Renderer(c, optics, rng) for c in true]
        shown = []
        for k in range(frames):
            patches = tuple(bent(tags, k / 30))
            truth = np.array([p.center for p in patches])
            shown.append(([r.shoot(Scene(patches=patches)).image for r in renderers], truth))
        pairs.append((name, family, shown))
    sys.stdout.write("two 1280 x 720 pictures with 20 tags, image to 3D; medians of frames\n")
    sys.stdout.write(f"{'':34}{'ms':>8}{'ms/frame':>10}{'pairs/s':>9}{'RMS mm':>9}{'lost':>6}\n")
    for name, family, shown in pairs:
        methods = {
            f"this, {name}": ours(rig, family, SIDE),
            f"ArucoDetector + PnP, {name}": plain(rig, family, SIDE),
        }
        if name == "APRILTAG_36H11" and find_spec("pupil_apriltags"):
            methods["pupil-apriltags + PnP, 36h11"] = apriltags(rig, SIDE)
        for title, run in methods.items():
            run(shown[0][0])
            took, errors, lost = [], [], 0
            for images, truth in shown:
                started_at = time.perf_counter()
                points, covariance = run(images)
                took.append(time.perf_counter() - started_at)
                errors.append(error(points, truth, covariance))
                lost += int(np.isnan(points[:, 0]).sum())
            ms = 1e3 * float(np.median(took))
            rms = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
            sys.stdout.write(
                f"{title:34}{ms:8.1f}{ms / 2:10.1f}{1e3 / ms:9.1f}{rms:9.3f}{lost:6d}\n"
            )


# --- CPU time ---------------------------------------------------------------------------------


def cpu(frames: int = 40, count: int = 12, rounds: int = 5) -> None:
    """Measure pairs of pictures per CPU second on one core, for pictures at 30 per second."""
    rng = np.random.default_rng(0)
    rig, family = cameras(), dictionary("4X4_50")
    renderers = [Renderer(c, Optics(blur=0.8, exposure=0, read_noise=2.0), rng) for c in rig]
    tags = device(rng, family, SIDE, 30)[:count]
    scenes = [Scene(patches=tuple(bent(tags, k / 30))) for k in range(frames)]
    films = [[r.shoot(s).image for s in scenes] for r in renderers]
    plain = cv2.aruco.ArucoDetector(family.table, cv2.aruco.DetectorParameters())

    def located(finders: Sequence[Detector | TagFollower]) -> None:
        views = [[f.find(i) for i in film] for f, film in zip(finders, films, strict=True)]
        number = np.arange(frames)
        visible = [
            observe(number / 30, store_views(v), np.arange(count)).part(number) for v in views
        ]
        corners, spread = (np.stack([getattr(s, n) for s in visible], 2)
                           for n in ("corners", "covariance"))  # fmt: skip
        reconstruct(rig, corners, spread, SIDE)

    whole, follow = ([kind(c, family) for c in rig] for kind in (Detector, TagFollower))
    methods: dict[str, Callable[[], object]] = {
        "this, images to 3D": lambda: located(follow),
        "this, every image whole": lambda: located(whole),
        "OpenCV's detection alone": lambda: [plain.detectMarkers(i) for f in films for i in f],
    }
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    took: dict[str, list[float]] = {name: [] for name in methods}
    for k in range(rounds + 1):
        for name, run in methods.items():
            started_at = time.process_time()
            run()
            if k:  # the first compiles
                took[name].append(time.process_time() - started_at)
    cv2.setNumThreads(threads)
    sys.stdout.write(f"two 1280 x 720 pictures with {count} tags; medians of {rounds} rounds\n")
    for name, of in took.items():
        sys.stdout.write(f"{name:34}{frames / float(np.median(of)):8.1f} pairs per CPU second\n")


# --- table ------------------------------------------------------------------------------------


def trial(
    side: float = SIDE, blur: float = 0.8, noise: float = 2.0, base: float = BASE,
    tilt: float = 30.0, missing: float = 0.0, single: bool = False, frames: int = 12, seed: int = 0,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the RMS error (mm), its ratio to the stated one, and the share of missed tags."""
    rng = np.random.default_rng(seed)
    optics = Optics(blur=blur, exposure=0, read_noise=noise, shot_noise=0)
    true = cameras(base)
    rig = calibrated(true, Optics(blur=0.8, exposure=0, read_noise=2.0, shot_noise=0), seed)
    family = dictionary("4X4_50")
    tags = device(rng, family, side, tilt)
    detectors = [Detector(c, family) for c in rig]
    renderers = [Renderer(c, optics, rng) for c in true]
    errors, scaled, lost = [], [], 0
    for k in range(frames):
        patches = bent(tags, k / 8)
        truth = np.array([p.center for p in patches])
        selected = tuple(p for p in patches if rng.random() >= missing)
        views = [
            d.find(r.shoot(Scene(patches=selected)).image)
            for d, r in zip(detectors, renderers, strict=True)
        ]
        corners, covariance = corners_of(views)
        if single:
            corners[:, :, 1] = np.nan
        detections = reconstruct(rig, corners, covariance, side)
        good = np.isfinite(detections.points[0, :, 0])
        lost += len(selected) - int(good.sum())
        if single:  # alignment would take the depth's common part away
            gap = rig[0].to_camera(detections.points[0]) - true[0].to_camera(truth)
            errors.append(np.linalg.norm(gap[good], axis=1))
        else:
            errors.append(error(detections.points[0], truth, detections.covariance[0]))
        spread = np.sqrt(np.trace(detections.covariance[0], axis1=1, axis2=2))[good]
        scaled.append(errors[-1] / spread)
    e, s = np.concatenate(errors), np.concatenate(scaled)
    rms, ratio = float(np.sqrt(np.mean(e**2))), float(np.sqrt(np.mean(s**2)))
    return rms, ratio, lost / (frames * TAGS)


def table() -> None:
    rows: list[tuple[str, dict[str, float]]] = [("15 mm, blur 0.8 px, noise 2, 160 mm, 30 deg", {})]
    rows += [(f"tags of {s:g} mm", {"side": s}) for s in (8, 10, 20)]
    rows += [(f"blur {b:g} px", {"blur": b}) for b in (0.5, 1.2, 1.6)]
    rows += [(f"noise {n:g} of 255", {"noise": n}) for n in (0.5, 5, 10)]
    rows += [(f"{b:g} mm apart", {"base": b}) for b in (60, 100, 300)]
    rows += [(f"tilted up to {t:g} deg", {"tilt": t}) for t in (0, 45, 60)]
    rows += [(f"{m:.0%} of the tags hidden", {"missing": m}) for m in (0.3, 0.6)]
    rows += [("one camera", {"single": 1}), ("one camera, 10 mm", {"single": 1, "side": 10})]
    sys.stdout.write(f"{'':46}{'RMS mm':>9}{'/ stated':>10}{'lost':>7}\n")
    for title, options in rows:
        rms, ratio, lost = trial(**options)  # type: ignore[arg-type]
        sys.stdout.write(f"{title:46}{rms:9.3f}{ratio:10.2f}{lost:7.1%}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    parts = {"speed": speed, "cpu": cpu, "table": table}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help=f"any of {', '.join(parts)}; default: speed table")
    for name in parser.parse_args().parts or ["speed", "table"]:
        parts[name]()
