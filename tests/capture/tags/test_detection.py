"""Tags are followed from image to image."""

import numpy as np

from defsense_fab.capture.tags.detection import Detector, TagFollower
from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Patch, Scene
from tests.twin.views import camera

UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
FAMILY = dictionary("4X4_50")
VIEW = camera((0, -400, 0), focal=900, size=(960, 720), lens=(0.05, -0.1, 0.0, 0.0, 0.0))
RENDERER = Renderer(VIEW, Optics(), np.random.default_rng(0))


def image(*places):
    """Return an image of tags by number at (x, z) mm."""
    patches = tuple(
        Patch(n, FAMILY.pattern(n), np.array([x, 0.0, z]), UPRIGHT, 15.0) for n, x, z in places
    )
    return RENDERER.shoot(Scene(patches)).image


class CountingFollower(TagFollower):
    """A follower that records the boxes that it searches; None for a whole image."""

    def __init__(self):
        super().__init__(VIEW, FAMILY)
        self.boxes = []
        find = self._detector.find

        def counted(picture, box=None):
            self.boxes.append(box)
            return find(picture, box)

        self._detector.find = counted


def test_following_finds_the_same_as_whole_images():
    follower, whole = CountingFollower(), Detector(VIEW, FAMILY)
    for k in range(20):
        picture = image((1, -30 + 1.5 * k, 40), (2, 25, -30 + k), (3, 0, 0))
        view, expected = follower.find(picture), whole.find(picture)
        a, b = np.argsort(view.ids), np.argsort(expected.ids)
        assert view.ids[a].tolist() == expected.ids[b].tolist() == [1, 2, 3]
        np.testing.assert_allclose(view.corners[a], expected.corners[b], atol=0.02)
    assert sum(box is None for box in follower.boxes) == 2  # the first and the eleventh
    x0, y0, x1, y1 = next(box for box in follower.boxes if box)
    assert (x1 - x0) * (y1 - y0) < 0.5 * 960 * 720


def test_tag_that_jumps_is_found_at_once_and_a_new_one_within_ten_images():
    follower = CountingFollower()
    for _ in range(3):
        assert follower.find(image((1, -100, 60))).ids.tolist() == [1]
    assert follower.find(image((1, 100, -60))).ids.tolist() == [1]
    assert follower.boxes[-1] is None
    both = image((1, 100, -60), (2, -120, 70))
    numbers = [sorted(follower.find(both).ids.tolist()) for _ in range(10)]
    assert numbers[0] == [1]
    assert numbers[-1] == [1, 2]


def test_tag_that_was_hidden_is_found_where_it_was():
    follower = CountingFollower()
    for _ in range(2):
        follower.find(image((1, -100, 0), (2, 60, 0)))
    for _ in range(3):
        assert follower.find(image((1, -100, 0))).ids.tolist() == [1]
    whole = follower.boxes.count(None)
    assert sorted(follower.find(image((1, -100, 0), (2, 60, 0))).ids.tolist()) == [1, 2]
    assert follower.boxes.count(None) == whole


def test_repeated_number_is_found_twice():
    follower = CountingFollower()
    twice = image((1, -100, 0), (1, 100, 40))
    for _ in range(12):
        assert follower.find(twice).ids.tolist() == [1, 1]
    assert follower.boxes.count(None) == 2


def test_nothing_in_view():
    follower = CountingFollower()
    for _ in range(3):
        assert len(follower.find(image()).ids) == 0
    assert follower.boxes == [None] * 3
