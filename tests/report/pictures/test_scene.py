"""Pictures hold all shapes without empty margins."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from defsense_fab.geometry.bodies.orientation import Y_UP, Z_UP
from defsense_fab.report.pictures import part_pictures, views
from defsense_fab.report.pictures.body_views import draw_routing
from defsense_fab.report.pictures.part_pictures import exploded
from defsense_fab.report.pictures.scene import Scene
from tests.conftest import box_surface

pytestmark = pytest.mark.slow


def image_of(uri):
    return np.array(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))).convert("RGB"))


def rim(image, wide):
    """Return the outermost pixels."""
    return np.concatenate(
        [
            image[:wide].reshape(-1, 3),
            image[-wide:].reshape(-1, 3),
            image[:, :wide].reshape(-1, 3),
            image[:, -wide:].reshape(-1, 3),
        ]
    )


@pytest.mark.parametrize("size", [(20, 25, 300), (300, 200, 6), (40, 30, 20)])
@pytest.mark.parametrize("frame", [Z_UP, Y_UP], ids=["z up", "y up"])
def test_a_body_fills_its_picture_from_every_side(size, frame):
    body = box_surface([-3, 5, 7], np.array([-3, 5, 7]) + size)
    sides = [f(frame) for f in (views.three_quarter, views.behind, views.front, views.side)]
    with Scene() as scene:
        scene.solid(body, "#446688")
        for view in [*sides, *views.around(frame)]:
            shot = scene.shot(view, 400, 300)
            assert shot.size[0] <= 400 and shot.size[1] <= 300  # noqa: PT018
            assert max(shot.size[0] / 400, shot.size[1] / 300) > 0.98
            drawn = np.argwhere(shot.image.min(2) < 200)[:, ::-1]
            ends = shot.pixel(body.vertices)
            assert drawn.min(0) == pytest.approx(ends.min(0), abs=2)
            assert drawn.max(0) + 1 == pytest.approx(ends.max(0), abs=2)
            assert (rim(shot.image, 1) == 255).all()


def test_axes_point_up_and_right():
    for frame in (Z_UP, Y_UP):
        view = views.three_quarter(frame)
        assert view.flat(frame)[0, 0] > 0.5
        assert view.flat(frame)[1] == pytest.approx([0, view.flat(frame)[1, 1]])
        assert view.flat(frame)[1, 1] > 0.5
        assert np.cross(view.right, view.up) == pytest.approx(view.back)


def test_hidden_shapes_are_detected():
    near, far = box_surface([-20, -20, -20], [20, -10, 20]), box_surface([-5, 10, -5], [5, 20, 5])
    with Scene() as scene:
        scene.solid(near, "#aa0000", name="near")
        scene.solid(far, "#00aa00", name="far")
        before = scene.shot(views.front(Z_UP), 200, 200).image
        areas = scene.visible_areas()
        assert areas["near"].sum() > 0.9 * areas["near"].size
        assert not areas["far"].any()
        again = scene.shot(views.front(Z_UP), 200, 200).image
        assert (again == before).all()
        around = [views.front(Z_UP), views.side(Z_UP)]
        assert part_pictures.choose_clearest_view(scene, around, ["near", "far"]) is around[1]


@pytest.mark.parametrize("size", [(20, 25, 300), (300, 200, 8), (40, 30, 25)])
def test_labels_and_dimensions_are_not_cut_off(size):
    body = box_surface([0, 0, 0], size)
    cord = np.linspace([1, 1, 1], np.array(size) - 1.0, 9)
    picture = image_of(draw_routing(body, [cord], [], 1.0, Z_UP))
    assert picture.shape[0] <= 768
    assert picture.shape[1] <= 1100
    assert (rim(picture, 1) == 255).all()
    parts = {f"{k}-a-part-with-a-long-name": body for k in range(9)}
    shifts = {n: np.array([0, 0, 30.0 * k]) for k, n in enumerate(parts)}
    picture = image_of(exploded(parts, shifts, Z_UP))
    assert picture.shape[1] <= 1110
    assert (rim(picture, 1) == 255).all()
