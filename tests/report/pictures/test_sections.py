"""Sections go through the movement and the strain; their values are those of the field."""

import numpy as np
import pytest

from defsense_fab.geometry.bodies.orientation import Z_UP
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.report.pictures.color_bar import scale
from defsense_fab.report.pictures.pose_pictures import StrainField, cut_mesh, strain_sections
from defsense_fab.report.pictures.sections import sections
from defsense_fab.report.surface_errors import state_words
from tests.conftest import structured_bar
from tests.report.pictures.test_scene import image_of, rim


@pytest.fixture(scope="module")
def bar():
    """150 x 30 x 20 mm along x."""
    return QuadraticMesh.from_linear(structured_bar([0, -15, -10], [150, 15, 10], [15, 4, 4]))


def bent(nodes, direction):
    """Return displacements and strains of a bar bent towards `direction` (3,)."""
    x, off = nodes[:, 0], nodes @ direction
    moved = 0.002 * x[:, None] ** 2 * direction - 0.004 * (x * off)[:, None] * [1, 0, 0]
    return moved, 0.004 * np.abs(off) * np.where(off < 0, 1.0, 0.5)


@pytest.mark.parametrize("direction", [[0, 0, 1.0], [0, 0, -1.0], [0, 1.0, 0], [0, 0.6, 0.8]])
def test_the_first_section_holds_the_bend_and_the_second_is_square_to_it(bar, direction):
    moved, strain = bent(bar.nodes, np.array(direction))
    planes = sections(bar.nodes, moved, strain, bar.nodes[:, 0] > 140)
    assert planes.moving.normal @ direction == pytest.approx(0, abs=0.05)
    assert planes.moving.normal @ [1, 0, 0] == pytest.approx(0, abs=0.05)
    assert abs(planes.lengthwise.normal @ direction) == pytest.approx(1, abs=0.02)
    for plane in (planes.moving, planes.lengthwise):  # through the middle of the handle
        assert (np.array([145, 0, 0]) - plane.origin) @ plane.normal == pytest.approx(0, abs=6)
    assert (planes.peak - planes.across.origin) @ planes.across.normal == pytest.approx(0, abs=2)


def test_a_bend_is_cut_inside_a_body_with_most_nodes_in_its_skin(bar):
    moved, strain = bent(bar.nodes, np.array([0, 0, 1.0]))
    kept = (np.abs(bar.nodes[:, 1]) == 15) | (np.arange(len(bar.nodes)) % 5 == 0)
    nodes = bar.nodes[kept]
    planes = sections(nodes, moved[kept], strain[kept], nodes[:, 0] > 140)
    assert abs(planes.moving.origin @ planes.moving.normal) < 10


def test_a_twist_is_cut_through_its_axis(bar):
    x, y, z = bar.nodes.T
    moved = 0.004 * x[:, None] * np.stack([0 * x, -z, y], 1)
    strain = 0.002 * np.hypot(y, z)
    planes = sections(bar.nodes, moved, strain, x > 140)
    for plane in (planes.moving, planes.lengthwise):
        assert abs(plane.normal[0]) < 0.1
        assert plane.origin @ plane.normal == pytest.approx(0, abs=1)


def test_an_arm_is_cut_through_its_moving_end_and_largest_strain(bar):
    """Only the last third moves; the strain is largest where the movement starts."""
    x = bar.nodes[:, 0]
    moved = np.maximum(x - 100, 0)[:, None] * [0, 0.5, 0]
    strain = np.exp(-(((x - 105) / 8) ** 2))
    planes = sections(bar.nodes, moved, strain, x > 140)
    assert abs(planes.moving.normal[2]) == pytest.approx(1)
    assert planes.across.origin[0] == pytest.approx(105, abs=3)


def hand():
    """Return nodes of a flat hand: fingers up along z, side by side along x; and which are tips."""
    grid = np.stack(
        np.meshgrid(np.arange(-40, 41, 2.0), [-8, -4, 0, 4, 8.0], np.arange(0, 171, 2.0))
    )
    nodes = grid.reshape(3, -1).T
    in_finger = np.abs((nodes[:, 0] + 40) % 20 - 10) < 7
    nodes = nodes[(nodes[:, 2] < 90) | in_finger]
    return nodes, nodes[:, 2] > 155


@pytest.mark.parametrize("fingers", [[-30, -10, 10, 30], [-30], [-10, 10]])
@pytest.mark.parametrize("level", [100, 150])
@pytest.mark.parametrize("seed", range(3))
def test_bent_fingers_are_cut_along_the_hand(fingers, level, seed):
    """The plane holds the fingers and their movement, wherever the strain is largest."""
    nodes, is_tip = hand()
    is_bent = (np.abs(nodes[:, :1] - fingers) < 9).any(axis=1) & (nodes[:, 2] > 90)
    angle = np.radians(40) * is_bent * np.clip((nodes[:, 2] - 90) / 20, 0, 1)
    y, z = nodes[:, 1], nodes[:, 2] - 90
    moved = np.stack(
        [
            0 * y,
            y * (np.cos(angle) - 1) + z * np.sin(angle),
            z * (np.cos(angle) - 1) - y * np.sin(angle),
        ],
        1,
    )
    moved = moved + np.random.default_rng(seed).normal(0, 0.05, moved.shape)
    strain = 0.2 * is_bent * np.exp(-(((nodes[:, 2] - level) / 8) ** 2)) * np.abs(y) / 8
    q = np.eye(3) if seed == 0 else np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    planes = sections(nodes @ q.T, moved @ q.T, strain, is_tip & is_bent)
    assert abs(planes.moving.normal @ q[:, 0]) > 0.99
    assert abs(planes.lengthwise.normal @ q[:, 1]) > 0.9
    if seed == 0:  # planes that are nearly square to an axis are square to it
        assert np.abs(planes.moving.normal).max() == 1
    through = (planes.moving.origin @ planes.moving.normal) * (planes.moving.normal @ q[:, 0])
    assert min(abs(through - x) for x in fingers) < 8


def test_a_cut_has_the_area_and_the_values_of_its_field(bar):
    normal = np.array([0.6, 0.0, 0.8])
    value = bar.nodes @ [0.3, -0.2, 0.5]
    cut = cut_mesh(bar.nodes, bar.cells, np.array([75, 0, 1.0]), normal, {"value": value})
    assert cut.area == pytest.approx(30 * 20 / 0.6, rel=1e-4)
    points = np.asarray(cut.points, float)
    assert (points - [75, 0, 1.0]) @ normal == pytest.approx(0, abs=1e-4)
    assert cut.point_data["value"] == pytest.approx(points @ [0.3, -0.2, 0.5], abs=1e-4)
    beyond = cut_mesh(bar.nodes, bar.cells, np.array([500, 0, 0.0]), normal, {})
    assert beyond.n_points == 0


def test_a_picture_of_sections_is_not_cut_off(bar):
    moved, strain = bent(bar.nodes, np.array([0, 0, 1.0]))
    corners = structured_bar([0, -15, -10], [150, 15, 10], [15, 4, 4]).boundary()
    body, used = corners.compact()
    planes = sections(bar.nodes, moved, strain, bar.nodes[:, 0] > 140)
    picture = image_of(
        strain_sections(
            StrainField(bar.nodes, bar.cells, moved, strain),
            body,
            moved[used],
            planes,
            Z_UP,
            scale("viridis", "strain (%)", 6.0),
        )
    )
    assert (rim(picture, 1) == 255).all()
    # The colors of small and of large strain.
    for color in ((68, 1, 84), (33, 145, 140)):
        assert (np.abs(picture.astype(int) - color).max(2) < 12).sum() > 50


def test_states_are_described():
    assert state_words({"bend": 1.0, "twist": 0.5}) == "bend + twist 50 %"
    assert state_words({"bend": 1.0, "twist": 0.0}) == "bend"
