"""Rendered images against the camera model: exact areas, noise and motion smear."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer, render
from defsense_fab.twin.scenes.scene import Backdrop, Patch, Scene
from tests.support.errors import raises
from tests.twin.views import UPRIGHT, camera, tag, turn

NOISELESS = Optics(blur=0.0, read_noise=0.0, shot_noise=0.0, vignetting=0.0)
DARK = Backdrop(0.0, (0.0, 0.0), 0.0)
FLAT = {"backdrop": DARK, "ink": (0.0, 250.0), "shade": 0.0}
WHITE, BLACK = np.full((1, 1), 255, np.uint8), np.zeros((1, 1), np.uint8)


def centroid(image):
    weight = image.astype(float)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


def expected_centroid(view, patch, count=200):
    """Return the centroid of a patch, with the area in each pixel taken to be at its center.

    Where an edge is parallel to the rows, it differs from the true centroid by up to an eighth of
    a pixel times the length of the edge over the area.
    """
    sides = np.linspace(patch.corners, np.roll(patch.corners, -1, 0), count, endpoint=False, axis=1)
    outline = view.project(sides.reshape(-1, 3))
    centroids = []
    for axis in (0, 1):
        pixels = np.arange(np.floor(outline[:, axis].min()), np.ceil(outline[:, axis].max()) + 1)
        before = [area_before(outline, axis, k) for k in (pixels[0] - 0.5, *(pixels + 0.5))]
        centroids.append((pixels * np.diff(before)).sum() / before[-1])
    return np.array(centroids)


def area_before(outline, axis, limit):
    """Return the area of the part of a polygon (p, 2) with coordinates below the limit."""
    after = np.roll(outline, -1, 0)
    share = (limit - outline[:, axis]) / np.where(after == outline, 1, after - outline)[:, axis]
    crossing = np.flatnonzero((outline[:, axis] <= limit) != (after[:, axis] <= limit))
    cut = {k: outline[k] + share[k] * (after[k] - outline[k]) for k in crossing}
    points = []
    for k, corner in enumerate(outline):
        points += [corner] if corner[axis] <= limit else []
        points += [cut[k]] if k in cut else []
    x, y = np.array(points).T if points else np.zeros((2, 1))
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@settings(max_examples=12, deadline=None)
@given(
    st.floats(-60, 60), st.floats(-45, 45), st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3)
)  # fmt: skip
def test_centroid_of_a_square_agrees_with_the_camera_model(x, z, tilt, sway, roll):
    view = camera((0, -150, 0))
    axes = turn(tilt, 0, sway) @ UPRIGHT @ turn(z=roll)
    patch = Patch(0, WHITE, np.array([x, 0, z]), axes, 15.0, margin=0.0)
    picture = Renderer(view, NOISELESS, np.random.default_rng(0)).shoot(Scene((patch,), **FLAT))
    corners = view.project(patch.corners)
    assert np.allclose(picture.corners[0], corners, atol=1e-9)
    ray = (patch.center - view.center) / np.linalg.norm(patch.center - view.center)
    is_cut_off = (corners.min(0) < 0).any() or (corners.max(0) > [319, 239]).any()
    if is_cut_off or ray @ axes[:, 2] > -0.25:  # partly outside, or seen at a grazing angle
        return
    assert picture.visible[0] == pytest.approx(1, abs=1e-5)
    # Eight bits leave errors of up to half a level of 250 in the pixels of the edges. They move
    # the centroid by 0.002 px where the edges are parallel to rows or columns, else by less.
    assert centroid(picture.image) == pytest.approx(expected_centroid(view, patch), abs=0.004)


def test_edge_bent_by_the_lens_is_rendered_where_it_is():
    view = camera((40, -150, 60))
    patch = Patch(0, WHITE, np.array([10, 0, 5.0]), turn(1.3, 0.1, 0.2), 70.0, margin=0.0)
    image = render(view, Scene((patch,), **FLAT), NOISELESS, np.random.default_rng(0)) / 250.0
    at = np.linspace(0.1, 0.9, 2001)
    left = view.project(patch.to_world(np.stack([0 * at, at], axis=-1)))
    for row in range(int(left[:, 1].min()) + 2, int(left[:, 1].max()) - 2):
        inside = (left[:, 1] > row - 0.5) & (left[:, 1] < row + 0.5)
        edge = np.interp(np.linspace(row - 0.5, row + 0.5, 33), left[:, 1], left[:, 0]).mean()
        assert inside.any()
        middle = round(float(edge)) + 6
        filled = image[row, middle - 15 : middle].sum()
        assert middle - 0.5 - filled == pytest.approx(edge, abs=0.005)


def test_image_equals_brute_force():
    """Compare every pixel with 16 x 16 rays through it."""
    view = camera((60, -110, 70), size=(48, 36), focal=45.0, lens=(-0.3, 0.1, 0.003, 0.002, 0))
    patch = Patch(3, tag(5), np.array([2, 1, 3.0]), turn(1.1, 0.2, 0.5), 60.0)
    scene = Scene((patch,), **{**FLAT, "backdrop": Backdrop(100.0, (0.0, 0.0), 0.0)})
    image = render(view, scene, NOISELESS, np.random.default_rng(0))
    fine = (np.arange(16) + 0.5) / 16 - 0.5
    x = (np.arange(48)[:, None] + fine).ravel()
    y = (np.arange(36)[:, None] + fine).ravel()
    plane = view.to_plane(np.stack(np.meshgrid(x, y), axis=-1))
    rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1) @ view.rotation
    normal = patch.axes[:, 2]
    far = (patch.center - view.center) @ normal / (rays @ normal)
    hit = (view.center + rays * far[..., None] - patch.center) @ patch.axes[:, :2] / patch.cell
    cells = np.floor(hit * [1, -1] + 3).astype(int)
    inside = ((cells >= -1) & (cells < 7)).all(-1)
    padded = np.pad(patch.pattern, 1, constant_values=255) / 255 * 250.0
    column, row = np.moveaxis(np.clip(cells + 1, 0, 7), -1, 0)
    values = np.where(inside, padded[row, column], 100.0)
    exact = values.reshape(36, 16, 48, 16).mean((1, 3))
    assert np.abs(image - exact).max() < 4  # half a level, and the error of 16 rays across a pixel
    assert np.abs((image - exact).mean()) < 0.05


def test_noise_has_the_specified_variance():
    scene = Scene(backdrop=Backdrop(120.0, (0.0, 0.0), 0.0))
    optics = Optics(blur=0.7, read_noise=2.0, shot_noise=0.05, vignetting=0.2)
    renderer = Renderer(camera((0, -150, 0)), optics, np.random.default_rng(1))
    pair = [renderer.shoot(scene).image.astype(float) for _ in range(2)]
    assert np.var(pair[0] - pair[1]) / 2 == pytest.approx(4 + 0.05 * 112 + 1 / 12, rel=0.03)
    assert pair[0][110:130, 150:170].mean() == pytest.approx(120, abs=0.6)
    assert pair[0][:6, :6].mean() == pytest.approx(120 * 0.8, abs=2.5)


def test_instants_smear_moving_patches_and_keep_their_centers():
    view = camera((0, -150, 0), lens=(0.0, 0.0, 0.0, 0.0))
    positions = np.linspace(-1.5, 1.5, 7)
    scenes = [
        Scene((Patch(0, WHITE, np.array([x, 0, 0]), UPRIGHT, 10.0, margin=0.0),), **FLAT)
        for x in positions
    ]
    renderer = Renderer(view, NOISELESS, np.random.default_rng(0))
    smeared, still = renderer.shoot(scenes[3], scenes).image, renderer.shoot(scenes[3]).image
    assert centroid(smeared) == pytest.approx(centroid(still), abs=0.01)
    assert ((smeared > 5) & (smeared < 245)).sum() > 2 * ((still > 5) & (still < 245)).sum()
    assert smeared.sum() == pytest.approx(still.sum(), rel=2e-3)


def test_same_seed_gives_the_same_image():
    scene = Scene((Patch(0, BLACK, np.zeros(3), turn(1.3), 20.0),))
    view = camera((0, -150, 0))
    images = [render(view, scene, Optics(), np.random.default_rng(s)) for s in (4, 4, 5)]
    assert (images[0] == images[1]).all()
    assert (images[0] != images[2]).any()


def test_patches_of_earlier_images_leave_no_trace():
    view = camera((0, -150, 0))
    renderer = Renderer(view, Optics(read_noise=0.0, shot_noise=0.0), np.random.default_rng(0))
    empty = renderer.shoot(Scene()).image
    renderer.shoot(Scene((Patch(0, BLACK, np.array([30.0, 0, 20]), turn(1.3), 20.0),)))
    assert (renderer.shoot(Scene()).image == empty).all()


def test_invalid_optics_are_rejected():
    for invalid in ({"blur": -1.0}, {"gain": 0.0}, {"read_noise": float("nan")}):
        with raises(CaptureError, "out-of-range", record="optics"):
            Optics(**invalid)
