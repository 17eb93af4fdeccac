"""Corners of tags agree with the truth of rendered images."""

from functools import cache

import numpy as np
import pytest
from scipy.special import ndtr

from benchmarks.pictures import CONDITIONS, measure
from defsense_fab.capture.tags.detection import Detector
from defsense_fab.capture.tags.edge_fit import refine
from defsense_fab.capture.tags.edge_model import PARAMETERS, converge
from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.core.camera import Camera
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Backdrop, Ellipse, Patch, Scene
from tests.support.errors import raises
from tests.twin.views import STRONG_DISTORTION, turn

FOCAL = 700.0
MATRIX = np.array([[FOCAL, 0, 322], [0, 1.01 * FOCAL, 237], [0, 0, 1]])
VIEW = Camera("left", (640, 480), MATRIX, np.array(STRONG_DISTORTION), np.eye(3), np.zeros(3))
DICTIONARIES = ("4X4_50", "36H11")


@cache
def detector(name):
    """Return the detector of a dictionary; the first one compiles its functions."""
    return Detector(VIEW, dictionary(name))


def tags(rng, name, px, tilt, count=99):
    """Return tags all over the image, `px` pixels wide if they face the camera."""
    far, family, out = 400.0, dictionary(name), []
    shape = [min(int((n - 40) // (1.9 * px)), 7) for n in VIEW.size]
    grid = [np.linspace(-1, 1, n) * (w / 2 - 1.2 * px - 15) for n, w in zip(shape, VIEW.size,
                                                                         strict=True)]  # fmt: skip
    for x, y in np.stack(np.meshgrid(*grid), axis=-1).reshape(-1, 2)[:count]:
        at = np.array([x, y]) + rng.uniform(-3, 3, 2) + np.array(VIEW.size) / 2
        center = far * np.append(VIEW.to_plane(at[None])[0], 1)
        way = turn(z=rng.uniform(0, 6.3)) @ turn(x=tilt) @ turn(z=rng.uniform(0, 6.3))
        axes = np.diag([1, -1, -1.0]) @ way
        number = len(out)
        out.append(Patch(number, family.pattern(number), center, axes, px * far / FOCAL))
    return tuple(out)


def flat(patches):
    """Return the corners (n, 4, 2), px, in an image without distortion."""
    c = np.array([p.corners for p in patches])
    return c[..., :2] / c[..., 2:] * VIEW.focal + MATRIX[:2, 2]


def detect(scene, blur=0.8, noise=2.0, name="4X4_50", seed=0, **optics):
    rng = np.random.default_rng(seed)
    settings = Optics(blur=blur, read_noise=noise, **{"shot_noise": 0.0, **optics})
    return detector(name).find(Renderer(VIEW, settings, rng).shoot(scene).image)


def corner_errors(view, patches):
    """Return errors (n, 8), px, and mean squares per coordinate in units of the variance (n,)."""
    error = view.corners - flat(patches)[view.ids]
    squares = np.einsum("nki,nkij,nkj->n", error, np.linalg.inv(view.covariance[:, :4]), error) / 8
    return error.reshape(-1, 8), squares


@pytest.mark.parametrize("name", DICTIONARIES)
def test_corners_have_no_bias(name):
    patches = tags(np.random.default_rng(1), name, 44, 0.5)
    view = detect(Scene(patches), name=name)
    error, _ = corner_errors(view, patches)
    assert len(view.ids) >= 0.9 * len(patches)
    assert np.abs(error.reshape(-1, 2).mean(axis=0)).max() < 0.01
    assert np.sqrt((error**2).mean()) < 0.03


@pytest.mark.parametrize(
    ("px", "blur", "noise", "tilt"),
    [(20, 0.5, 2, 0.6), (20, 0.8, 1, 0.6), (30, 0.5, 4, 0.0), (30, 1.1, 2, 0.6), (30, 1.5, 2, 0.3),
     (30, 0.8, 2, 1.0), (60, 0.8, 1, 0.6), (60, 1.5, 4, 0.6)],
)  # fmt: skip
def test_stated_covariance_matches_the_errors(px, blur, noise, tilt):
    squares = []
    for name in DICTIONARIES if px >= 30 else ("4X4_50",):
        for seed in range(2 if px < 60 else 3):
            patches = tags(np.random.default_rng(seed), name, px, tilt, 40)
            squares.append(
                corner_errors(detect(Scene(patches), blur, noise, name, seed), patches)[1]
            )
    squares = np.concatenate(squares)
    assert len(squares) >= 40
    assert 0.3 < squares.mean() < 2


@pytest.mark.parametrize(
    ("backdrop", "optics"),
    [
        (Backdrop(20.0), {}),
        (Backdrop(120.0, (160.0, 120.0)), {}),
        (Backdrop(), {"vignetting": 0.7}),
    ],
)
def test_dark_backgrounds_and_uneven_light(backdrop, optics):
    patches = tags(np.random.default_rng(3), "4X4_50", 44, 0.5)
    view = detect(Scene(patches, backdrop=backdrop), **optics)
    error, squares = corner_errors(view, patches)
    assert len(view.ids) >= 0.9 * len(patches)
    assert np.sqrt((error**2).mean()) < 0.03
    assert squares.mean() < 2


@pytest.mark.parametrize("level", [30.0, 210.0])
def test_finger_on_an_edge_moves_no_corner(level):
    rng = np.random.default_rng(5)
    patches = tags(rng, "4X4_50", 50, 0.3)
    fingers = []
    for p in patches:
        q = VIEW.project(p.corners)
        on = q[0] + rng.uniform(0.2, 0.8) * (q[1] - q[0])
        out = (on - q.mean(axis=0)) / np.linalg.norm(on - q.mean(axis=0))
        fingers.append(Ellipse(tuple(on + out * rng.uniform(4, 7)), (7.0, 7.0), 0.0, level))
    view = detect(Scene(patches, occluders=tuple(fingers)))
    error, squares = corner_errors(view, patches)
    if level > 100:
        assert len(view.ids) >= 5
    # At most one in twenty has a large error that its covariance does not state.
    bad = (np.abs(error).max(axis=1) > 0.3) & (squares > 4)
    assert bad.sum() <= max(1, len(bad) // 20)


def test_tags_at_the_image_border_are_right_or_absent():
    family, result = dictionary("4X4_50"), 0
    for k, x in enumerate(np.arange(0, 44, 2.0)):
        center = 400 * np.append(VIEW.to_plane(np.array([[x, 200.0]]))[0], 1)
        patch = Patch(0, family.pattern(k), center, np.diag([1, -1, -1.0]), 40 * 400 / FOCAL)
        view = detect(Scene((patch,)), seed=k)
        if len(view.ids):
            assert view.ids[0] == k
            error = view.corners[0] - flat([patch])[0]
            assert np.abs(error).max() < 0.15
            result += 1
    assert result >= 3


def test_images_of_another_size_and_without_tags():
    with raises(CaptureError, "image-size-differs", size=(100, 100)):
        detector("4X4_50").find(np.zeros((100, 100), np.uint8))
    empty = detector("4X4_50").find(np.zeros((480, 640, 3), np.uint8))
    assert empty.corners.shape == (0, 4, 2)
    assert empty.covariance.shape == (0, 5, 2, 2)


def blurred_step(distance):
    """Return a step that a lens blurs, at distances from it, px."""
    return ndtr(distance / 0.8)


@pytest.mark.parametrize("side", [200, 600])
def test_all_of_a_large_tags_edge_counts(side):
    """Two edges bulge by 1 px, symmetric about their middles, which moves the corners."""
    size, low, high = side + 100, 50.0, side + 50.0
    x, y = np.meshgrid(np.arange(float(size)), np.arange(float(size)))
    bulge = 1 - ((y - size / 2) / (side / 2)) ** 2
    inside = (
        blurred_step(x - low + bulge)
        * blurred_step(high + bulge - x)
        * blurred_step(y - low)
        * blurred_step(high - y)
    )
    noise = np.random.default_rng(0).normal(0, 1, x.shape)
    image = np.clip(210 - 180 * inside + noise + 0.5, 0, 255).astype(np.uint8)
    square = np.array([[low, low], [high, low], [high, high], [low, high]])
    result, _, fitted = refine(image, np.stack([x, y], axis=-1), square[None], 6)
    assert fitted.tolist() == [4]
    left, right = result[0, [0, 3], 0], result[0, [1, 2], 0]
    assert abs(np.diff(left)) < 0.05
    assert abs(np.diff(right)) < 0.05
    part = 0.8  # of an edge, over which the mean bulge of its line is taken
    assert left.mean() == pytest.approx(low - (1 - part**2 / 3), abs=0.08)
    assert right.mean() == pytest.approx(high + (1 - part**2 / 3), abs=0.08)


@pytest.mark.slow
def test_fit_of_an_edge_continues_until_it_converges():
    """Four steps are too few for a short edge out of focus whose start is too sharp."""
    rng = np.random.default_rng(2)
    d, s = rng.uniform(-3, 3, 60), rng.uniform(-6, 6, 60)
    grey = 30 + 170 * ndtr((d - 0.9) / 2.4) + rng.normal(0, 2, 60)
    rows, A, B = (
        np.empty((PARAMETERS + 1, 60)),
        np.empty((PARAMETERS, PARAMETERS)),
        np.empty((PARAMETERS + 1, PARAMETERS + 1)),
    )

    def fit(q, turn):
        result = converge(s, d, grey, 60, 0.0, 1.0, 14.0, q, 170, turn, 4.0, 1e9, rows, A, B)
        return result[2], result[3]

    early, late = (np.array([-1.0, 0, 60, 90, 0.4, 0, 0]) for _ in range(2))
    fit(early, 1)
    variance, converged = fit(late, 2)
    sigma = np.sqrt(variance * np.linalg.inv(A)[0, 0])
    assert converged
    end = late.copy()
    for _ in range(20):
        fit(end, 2)
    assert abs(late[0] - end[0]) < sigma
    assert abs(early[0] - end[0]) > 2 * sigma


def test_detector_corners_replace_failed_fits():
    """Tags are in noise, beyond the image's border, and folded to a line."""
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (100, 120)).astype(np.uint8)
    plane = np.stack(np.meshgrid(np.arange(120.0), np.arange(100.0)), axis=-1)
    square = np.array([[0.0, 0], [30, 0], [30, 30], [0, 30]])
    places = np.array([[40.0, 40], [-8, 5], [95, 80]])
    detected_corners = np.concatenate([square + places[:, None], square[None] * [1, 0] + 20])
    corners, covariance, fitted = refine(image, plane, detected_corners, 6)
    assert (fitted == 0).all()
    assert np.abs(corners - detected_corners).max() < 0.6
    sigma = np.sqrt(np.diagonal(covariance, axis1=2, axis2=3))
    assert (sigma > 0.15).all()
    assert (sigma[:3] < 1).all()
    assert (sigma[3, :, 0] > 5).all()  # where along the line its corners are is unknown
    assert (sigma[3, :, 1] < 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "clean",
        "sharpened-wide",
        "over-exposed",
        "mosaic",
        "webcam-dim",
    ],  # more: benchmarks.pictures
)
def test_pictures_as_cameras_make_them(name):
    """Errors are smaller than OpenCV's, in images of another renderer.

    They have sharpening, clipped levels, a color mosaic, tone curves and compression.
    """
    ours, plain = measure(CONDITIONS[name], frames=1, seed=11)
    assert ours.found >= plain.found - 0.01
    assert ours.rms < 0.3 * plain.rms
    assert ours.rms < (0.01 if name == "clean" else 0.06)
    assert ours.inside > 0.75  # errors of one frame are much alike
