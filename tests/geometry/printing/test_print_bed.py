"""Parts on the bed."""

import numpy as np
import pytest
import trimesh

from defsense_fab.core.errors import FabricationError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.printing.print_bed import (
    arrange,
    choose_side_down,
    count_fewest_plates,
    find_other_side,
    first_layer_area,
    fits_bed,
    lay_flat,
)
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.surfaces import from_trimesh

BED = (220.0, 220.0, 250.0)
GAP_MM = 5.0


def turned(surface, seed):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    return Surface(surface.vertices @ q.T, surface.faces), q


@pytest.mark.parametrize("seed", range(5))
def test_a_part_lies_on_its_face_and_takes_the_least_rectangle(seed):
    body, q = turned(box_surface([0, 0, 0], [80, 30, 10]), seed)
    flat = lay_flat(body, q @ [0, 0, -1.0])
    assert flat.volume == pytest.approx(80 * 30 * 10)
    assert np.ptp(flat.bounds, axis=0) == pytest.approx([80, 30, 10])
    assert flat.bounds[0] == pytest.approx([-40, -15, 0])


def test_faces_in_hollows_are_not_stood_on():
    """An L lies on its outer sides, never on the inner one that is asked for."""
    el = trimesh.creation.box([40, 20, 10]).union(
        trimesh.creation.box([10, 20, 40], np.array([[1, 0, 0, 15], [0, 1, 0, 0], [0, 0, 1, 15],
                                                     [0, 0, 0, 1.0]])), engine="manifold"
    )  # fmt: skip
    surface = from_trimesh(el)
    # The step inside is larger than the rim.
    down = choose_side_down(surface, [np.array([-1.0, 0, 0])])
    flat = lay_flat(surface, down)
    low = flat.vertices[:, 2] < 1e-9
    assert low[flat.faces].all(axis=1).sum() >= 2


def test_a_body_without_flats_stands_on_its_widest_end():
    """An egg with a notch: the hull's largest side spans the notch and touches at its rims only."""
    egg = trimesh.creation.icosphere(subdivisions=4)
    egg.apply_scale([40, 20, 20])
    knife = trimesh.creation.box([90, 4, 30])
    knife.apply_translation([0, 0, -20])
    notched = egg.difference(knife, engine="manifold")
    surface = from_trimesh(notched)
    down = choose_side_down(surface, [])
    solid = triangle_kernel.to_manifold(surface, "egg")
    assert first_layer_area(solid, down) > 20
    assert first_layer_area(solid, np.array([0, 0, -1.0])) < first_layer_area(solid, down)


def test_plates_hold_all_parts_side_by_side():
    rng = np.random.default_rng(3)
    parts = {f"p{k}": box_surface([0, 0, 0], rng.uniform(10, 120, 3)) for k in range(20)}
    placed = arrange(
        {n: lay_flat(s, np.array([0, 0, -1.0])) for n, s in parts.items()}, BED, "printer", GAP_MM
    )
    assert set(placed) == set(parts)
    boxes = [(p.plate, p.surface.bounds) for p in placed.values()]
    for k, (plate, (low, high)) in enumerate(boxes):
        assert (low >= -1e-9).all()
        assert (high <= BED).all()
        for other, (a, b) in boxes[:k]:
            if other == plate:
                assert (b[:2] + 4.9 < low[:2]).any() or (high[:2] + 4.9 < a[:2]).any()
    assert max(plate for plate, _ in boxes) > 0


def test_part_that_fills_the_bed_gets_a_separate_plate():
    down = np.array([0, 0, -1.0])
    sizes = {"a": [205, 110, 5], "b": [215, 30, 5], "c": [50, 50, 5]}
    parts = {n: lay_flat(box_surface([0, 0, 0], s), down) for n, s in sizes.items()}
    plates = {n: p.plate for n, p in arrange(parts, BED, "printer", GAP_MM).items()}
    assert plates["b"] not in (plates["a"], plates["c"])


def test_lower_bound_of_plates_is_reached():
    """A part that fills its plate, up to the edge, asks for this one alone."""
    down = np.array([0, 0, -1.0])
    for sizes, count in (
        ([[218, 218, 5]], 1),
        ([[218, 218, 5], [100, 100, 5]], 2),
        ([[218, 30, 5]] * 3, 3),
        ([[120, 120, 5]] * 3, 3),
        ([[270, 20, 20]], 1),
    ):
        parts = {str(k): lay_flat(box_surface([0, 0, 0], s), down) for k, s in enumerate(sizes)}
        plates = {p.plate for p in arrange(parts, BED, "printer", GAP_MM).values()}
        assert len(plates) == count_fewest_plates(parts, BED, "printer", GAP_MM) == count


def test_a_part_too_high_on_one_side_lies_on_another():
    tower = box_surface([0, 0, 0], [40, 50, 200])
    low = (220.0, 220.0, 45.0)
    down = find_other_side(tower, low)
    assert fits_bed(lay_flat(tower, down), low)
    assert abs(down) == pytest.approx([1, 0, 0])
    assert find_other_side(tower, (220.0, 220.0, 30.0)) is None


def test_a_long_part_lies_across_the_corners_and_a_longer_one_is_refused():
    long = lay_flat(box_surface([0, 0, 0], [270, 20, 20]), np.array([0, 0, -1.0]))
    across = arrange({"rod": long}, BED, "fdm-tpu", GAP_MM)["rod"].surface
    assert (across.bounds[0] >= -1e-9).all()
    assert (across.bounds[1] <= BED).all()
    assert across.volume == pytest.approx(long.volume)
    longer = lay_flat(box_surface([0, 0, 0], [320, 20, 20]), np.array([0, 0, -1.0]))
    with raises(FabricationError, "part-too-large", part="rod", printer="fdm-tpu") as caught:
        arrange({"rod": longer}, BED, "fdm-tpu", GAP_MM)
    assert caught.value.data["size"] == pytest.approx((320, 20, 20))
