"""Parts as they are exported: volumes, sockets, grooves, numbers and refusals."""

from dataclasses import replace

import manifold3d as m3
import numpy as np
import pytest
import trimesh

from defsense_fab.core.curve import Hermite, Plane
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.bodies.orientation import Y_UP
from defsense_fab.geometry.channels.channel_ends import Pockets
from defsense_fab.geometry.kernels import occ, triangle_kernel
from defsense_fab.geometry.kernels.cutting_tools import Number, axes_from_normal, cylinder
from defsense_fab.geometry.parts.alignment_pins import find_free_spots
from defsense_fab.geometry.parts.division import Cut, Division
from defsense_fab.geometry.parts.part_contacts import find_contacts
from defsense_fab.geometry.parts.parts import make_parts, part_names
from defsense_fab.geometry.parts.records import PartRules
from defsense_fab.geometry.printing.export import write_stl
from tests.conftest import box_surface
from tests.geometry.parts.cords import cord
from tests.support.errors import raises
from tests.support.surfaces import distance, is_inside, read_stl

pytestmark = pytest.mark.slow

RULES = PartRules(2.0, 2.2, 0.2, 1.2, pockets=Pockets(2.8, 7.0))


def crossing():
    """Three planes that cross inside the bar: two cords along it, one across."""
    wave = [[2, 0], [10, 0], [50, 5], [100, -3], [140, 0], [148, 0]]
    return [
        cord("flat", [0, 0, 1], [0, -5, 4], [1, 0, 0], wave),
        cord("upright", [0, 1, 0], [0, 6, 0], [1, 0, 0],
             [[2, 8], [10, 8], [60, 8], [140, 7], [148, 7]]),
        cord("across", [1, 0, 0], [75, 0, 0], [0, 1, 0],
             [[-13, -9], [-8, -8.5], [-3, -6], [0, -1], [2, 4], [3, 9], [3.5, 13]]),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def part_set(bar, bar_solid):
    return make_parts(bar, crossing(), replace(RULES, seats=6), solid=bar_solid)


@pytest.fixture(scope="module")
def exported(part_set, tmp_path_factory):
    """Surfaces as read from the STL files."""
    folder = tmp_path_factory.mktemp("stl")
    out = []
    for part in part_set.parts:
        write_stl(part.surface, folder / f"{part.name}.stl")
        out.append(read_stl(folder / f"{part.name}.stl"))
    return out


def test_exported_parts_and_removed_volume_add_up(part_set, exported, bar):
    assert len(part_set.parts) >= 5
    total = sum(triangle_kernel.to_manifold(s, "part").volume() for s in exported)
    assert total + part_set.cut_out == pytest.approx(135000, rel=1e-5)
    channels = triangle_kernel.union([c.solid for c in part_set.channels])
    body = triangle_kernel.to_manifold(bar, "bar")
    sockets = sum(2 * np.pi * p.socket**2 / 4 * p.depth for p in part_set.pins)
    flats = sum(s.size**2 * 0.3 for s in part_set.seats)
    least = float((body ^ channels).volume()) + sockets + flats
    assert (
        least < part_set.cut_out < least + 60 * (len(part_set.parts) + len(part_set.seats))
    )  # the numbers


def test_exported_parts_do_not_overlap(exported):
    """Mating faces that are rounded to single precision do not pass through each other."""
    solids = [triangle_kernel.to_manifold(s, "part") for s in exported]
    for i, a in enumerate(solids):
        for b in solids[:i]:
            assert (a ^ b).volume() < 1e-3


def test_both_kernels_agree(part_set):
    assert not [w for w in part_set.warnings if "STEP" in w]
    for part in part_set.parts:
        assert occ.volume(part.solid) == pytest.approx(part.volume, rel=1e-3)
        assert occ.centroid(part.solid) == pytest.approx(part.center, abs=0.01)


def test_cords_lie_in_air_closed_and_with_the_halves_apart(part_set, exported):
    for channel in part_set.channels:
        for surface in exported:
            assert distance(surface, channel.inside).min() >= 1.0
    for cut in part_set.cuts:
        for c in cut.cords:
            line = part_set.channels[c].inside
            for gap in (0.5, 2.0, 10.0):
                for side, sign in zip(cut.sides, (-1, 1), strict=True):
                    for i in side:
                        moved = line - sign * gap * cut.plane.normal
                        assert not is_inside(exported[i], moved).any()
                        assert distance(exported[i], moved).min() >= 0.99


def test_sockets_leave_the_clearance_and_pins_touch_nothing(part_set, exported):
    assert len(part_set.pins) >= 2 * len(part_set.cuts)
    for pin in part_set.pins:
        contact = part_set.contacts[pin.contact]
        assert pin.socket == pytest.approx(pin.diameter + 0.2)
        for i, sign in ((contact.lower, -1), (contact.upper, 1)):
            middle = pin.center + sign * pin.depth / 2 * pin.axis
            assert distance(exported[i], middle[None])[0] == pytest.approx(
                pin.socket / 2, abs=0.006
            )
            bottom = pin.center + sign * (pin.depth - 0.5) * pin.axis
            assert distance(exported[i], bottom[None])[0] == pytest.approx(0.5, abs=0.01)
        assert pin.length < 2 * pin.depth
        rod = triangle_kernel.union([triangle_kernel.solid_of(t) for t in pin.shape])
        frame = np.column_stack(
            [axes_from_normal(pin.axis), pin.center - pin.length / 2 * pin.axis]
        )
        for surface in exported:
            part = triangle_kernel.to_manifold(surface, "part")
            assert (part ^ rod.transform(frame)).volume() < 1e-6


def test_no_part_fits_turned_round_or_in_another_place(part_set):
    faces = {}
    for pin in part_set.pins:
        faces.setdefault(pin.contact, []).append(pin)
    pairs = [f for f in faces.values() if len(f) == 2]
    assert len(pairs) >= 4
    for a, b in pairs:
        assert abs(a.diameter - b.diameter) >= 0.5  # turned round, the thick pin meets a thin hole
    apart = np.sort([np.linalg.norm(a.center - b.center) for a, b in pairs])
    assert np.diff(apart).min() >= 0.99


def test_every_part_is_numbered_readably(part_set, exported):
    assert sorted(m.part for m in part_set.labels) == list(range(len(part_set.parts)))
    for mark in part_set.labels:
        contact = part_set.contacts[mark.contact]
        outward = contact.plane.normal * (1 if mark.part == contact.lower else -1)
        axes = mark.tools[0].axes
        assert axes[:, 2] == pytest.approx(outward)
        assert np.linalg.det(axes) == pytest.approx(1)  # seen from outside nothing is mirrored
        for stroke in mark.tools:
            floor = stroke.origin + axes[:, :2] @ stroke.polygon.mean(axis=0)
            assert distance(exported[mark.part], floor[None])[0] < 1e-4


def test_digits_look_like_digits():
    """A 4 on a raster: two strokes above, one below, and the line under it."""
    tools = Number("4", 7.0, 0.8).engraved(np.zeros(3), np.eye(3), 0.6)

    def filled(x, y):
        return any((t.polygon.min(0) < [x, y]).all() and (t.polygon.max(0) > [x, y]).all()
                   for t in tools)  # fmt: skip

    left, right = -1.55, 1.55
    spots = [(left, 3), (right, 3), (right, 0), (0, 0.8), (0, -3.9), (left, 0), (0, 3.8)]
    assert [filled(*at) for at in spots] == [True] * 5 + [False] * 2


def test_joints_of_cord_and_wire_have_pockets(part_set, exported):
    for channel in part_set.channels:
        for end in channel.ends:
            assert end.pocket == 7.0, end.reason
            middle = end.mouth - 4 * end.out
            near = min(distance(s, middle[None])[0] for s in exported)
            assert near == pytest.approx(1.4, abs=0.01)
            beyond = end.mouth - 9 * end.out
            assert min(distance(s, beyond[None])[0] for s in exported) < 1.15


def test_short_cord_has_no_pockets_and_states_why(bar):
    points = [[-13, 0], [-10, 0], [-4, 0], [4, 0], [10, 0], [13, 0]]
    long = replace(RULES, pockets=Pockets(2.8, 10.0))
    part_set = make_parts(bar, [cord("c", [1, 0, 0], [75, 0, 0], [0, 1, 0], points)], long)
    assert [e.pocket for e in part_set.channels[0].ends] == [0, 0]
    assert part_set.channels[0].ends[0].reason


def test_marker_seats_are_flat_shallow_and_clear_of_cords(part_set, bar, exported):
    assert [s.number for s in part_set.seats] == [1, 2, 3, 4, 5, 6]
    assert not [w for w in part_set.warnings if "marker seats" in w]
    for seat in part_set.seats:
        assert distance(bar, seat.center[None])[0] == pytest.approx(0.3, abs=1e-6)
        corner = seat.center + seat.axes[:, :2] @ np.array([0.45, 0.45]) * seat.size
        assert min(distance(s, corner[None])[0] for s in exported) < 1e-4
        for c in part_set.channels:
            assert np.linalg.norm(c.inside - seat.center, axis=1).min() > 1.1 + 1.2
    centers = np.array([s.center for s in part_set.seats])
    gaps = np.linalg.norm(centers[:, None] - centers[None], axis=2)[~np.eye(6, dtype=bool)]
    assert gaps.min() > 15


def test_seats_avoid_joints_while_there_is_room(bar):
    part_set = make_parts(bar, crossing()[:1], replace(RULES, seats=8))
    assert len(part_set.seats) == 8
    for seat in part_set.seats:  # the plane is z = 4; a seat's corner lies 7.4 mm from its middle
        assert abs(seat.center[2] - 4) > 7.3


def test_sockets_do_not_pass_through_a_thin_gap():
    """A slot 0.3 mm high, 2 to 4 mm below the face: distances that are sampled have no sign."""
    block = triangle_kernel.to_manifold(box_surface([0, 0, 0], [60, 30, 30]), "block")
    plane = Plane.from_normal(np.array([0, 0, 15.0]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    for depth in (2.0, 2.4, 2.9, 3.3, 3.8):
        slot = [[-1, -1, 14.7 - depth], [40, 31, 15 - depth]]
        solid = block - triangle_kernel.to_manifold(box_surface(*slot), "slot")
        above, below = solid.split_by_plane(plane.normal, 15.0)
        cut = Cut(plane, np.zeros(3), (0,), ((0,), (1,)))
        (contact,) = find_contacts(Division((below, above), (below, above), (cut,), 0.0), [])
        spots = find_free_spots(contact, 4.0, 5.0, 0.2, 0.8)
        assert len(spots)
        for at in contact.world(spots):
            hole = cylinder(at, at - 5.0 * plane.normal, 4.2)
            missing = triangle_kernel.solid_of(hole) - below
            assert missing.volume() < 1e-6


def test_more_seats_than_there_is_room_for(bar):
    part_set = make_parts(bar, crossing()[:1], replace(RULES, seats=40, tag=18.0))
    assert 0 < len(part_set.seats) < 40
    assert any(f"{len(part_set.seats)} of 40" in w for w in part_set.warnings)


LID = cord(
    "c", [0, 0, 1], [75, 0, 5], [0, 1, 0], [[-13, 0], [-10, 0], [-4, 1], [4, -1], [10, 0], [13, 0]]
)


@pytest.fixture(scope="module")
def limited(bar, bar_solid):
    return make_parts(bar, [LID], replace(RULES, limit=True), solid=bar_solid)


def test_a_limited_cut_takes_off_only_a_lid(bar, limited):
    assert len(limited.parts) == 2
    sizes = sorted(p.volume for p in limited.parts)
    assert sizes[0] < 30 * 10 * 30  # 10 mm high, as wide as the bar, less than 30 mm long
    assert all(p.solid is not None for p in limited.parts)
    whole = make_parts(bar, [LID], RULES)
    assert min(p.volume for p in whole.parts) > 40000


def test_a_lid_has_play_in_its_recess(limited):
    rest, lid = (triangle_kernel.to_manifold(p.surface, p.name) for p in limited.parts)
    assert lid.volume() < rest.volume()
    for way in ([0.09, 0, 0], [-0.09, 0, 0]):
        assert (rest ^ lid.translate(way)).volume() < 1e-3
    assert (rest ^ lid.translate([0.12, 0, 0])).volume() > 1


def horseshoe():
    """Two legs of 30 mm, 80 mm long, on a foot."""
    boxes = [([0, 0, 0], [20, 30, 30]), ([0, 0, 0], [100, 10, 30]), ([0, 20, 0], [100, 30, 30])]
    solids = [triangle_kernel.to_manifold(box_surface(*b), "leg") for b in boxes]
    return triangle_kernel.to_surface(triangle_kernel.union(solids))


def test_pieces_without_cords_are_not_cut_off():
    """A plane across both legs, with a cord through one of them: the other stays whole."""
    body = horseshoe()
    points = [[0, 2], [0, 6], [0, 15], [0, 20], [0, 25], [0, 28]]
    sensor = cord("c", [1, 0, 0], [60, 5, 0], [0, 1, 0], points)
    part_set = make_parts(body, [sensor], replace(RULES, pockets=None))
    assert len(part_set.parts) == 2
    assert min(p.volume for p in part_set.parts) == pytest.approx(40 * 10 * 30, rel=0.05)


def test_written_parts_are_closed_when_read_again(bar, tmp_path):
    """Oblique ends put near-duplicate vertices where tube, pocket and chamfer meet."""
    points = [[2, -4], [10, -3], [50, 2], [100, -3], [140, 2], [148, 4]]
    part_set = make_parts(bar, [cord("c", [0, 0.1, 1], [0, 0, 0], [1, 0, 0], points)], RULES)
    for part in part_set.parts:
        write_stl(part.surface, tmp_path / "part.stl")
        mesh = trimesh.load(tmp_path / "part.stl", force="mesh")
        edges = np.sort(mesh.edges, axis=1)
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
        assert mesh.is_watertight
        assert mesh.body_count == 1
        assert mesh.volume == pytest.approx(part.volume, rel=1e-6)


def test_a_lid_under_a_roof_is_not_cut_out():
    """A jaw above the plate: its piece of the plate cannot come off upwards."""
    boxes = [([0, 0, 0], [100, 40, 20]), ([0, 0, 0], [10, 40, 60]), ([0, 0, 50], [100, 40, 60])]
    jaw = triangle_kernel.union(
        [triangle_kernel.to_manifold(box_surface(*b), "jaw") for b in boxes]
    )
    points = [[-18, 0], [-14, 0], [-5, 0], [5, 0], [14, 0], [18, 0]]
    sensor = cord("c", [0, 0, 1], [60, 20, 14], [0, 1, 0], points)
    part_set = make_parts(
        triangle_kernel.to_surface(jaw), [sensor], replace(RULES, limit=True, pockets=None)
    )
    surfaces = [[part_set.parts[i].surface for i in side] for side in part_set.cuts[0].sides]
    low, high = (
        triangle_kernel.union([triangle_kernel.to_manifold(s, "p") for s in side])
        for side in surfaces
    )
    for lift in np.arange(1.0, 80.0):
        assert (low ^ high.translate([0, 0, lift])).volume() < 0.01


def test_neighboring_pockets_keep_their_wall(bar):
    straight = [[2, 0], [10, 0], [50, 0], [100, 0], [140, 0], [148, 0]]
    for apart, length in ((3.4, 0.0), (3.8, 7.0)):
        sensors = [cord(f"c{y:g}", [0, 0, 1], [0, y, 0], [1, 0, 0], straight)
                   for y in (-apart / 2, apart / 2)]  # fmt: skip
        part_set = make_parts(bar, sensors, RULES)
        assert {e.pocket for c in part_set.channels for e in c.ends} == {length}


def test_a_wide_curve_is_followed_closely():
    """Few control points far apart: the cord's true path keeps its clearance all along."""
    body = box_surface([0, 0, -10], [210, 210, 10])
    points = np.array([[2, 105], [60, 105], [150, 105], [208, 105]], float)
    tangents = np.array([[60, 0], [60, 300], [60, -300], [60, 0]], float)
    plane = Plane.from_normal(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    part_set = make_parts(body, [Sensor("c", plane, Hermite(points, tangents))], RULES)
    path = plane.to_world(Hermite(points, tangents).sample(3000))
    assert min(distance(p.surface, path).min() for p in part_set.parts) >= 1.09


def test_a_hollow_body_and_a_body_in_pieces_are_refused(bar):
    outer = triangle_kernel.to_manifold(bar, "bar")
    hole = triangle_kernel.to_manifold(box_surface([60, -5, -12], [90, 5, -8]), "hole")
    straight = cord("c", [0, 0, 1], [0, 0, 4], [1, 0, 0], STRAIGHT)
    with raises(FabricationError, "closed-cavity") as caught:
        make_parts(triangle_kernel.to_surface(outer - hole), [straight], RULES)
    assert caught.value.data["at"] == pytest.approx([75, 0, -10])
    with raises(FabricationError, "separate-pieces"):
        make_parts(
            triangle_kernel.to_surface(outer + hole.translate([0, 100, 0])), [straight], RULES
        )


def test_seats_are_optional_and_fit_thin_bodies(bar):
    straight = [cord("c", [0, 0, 1], [0, 0, 0], [1, 0, 0], STRAIGHT)]
    assert make_parts(bar, straight, RULES).seats == ()
    plate = box_surface([0, -30, -2.75], [150, 30, 2.75])
    across = [cord("c", [0, 0, 1], [0, 20, 0], [1, 0, 0], STRAIGHT)]
    part_set = make_parts(plate, across, replace(RULES, seats=4, pockets=None))
    assert len(part_set.seats) == 4
    small = make_parts(bar, straight, replace(RULES, seats=2, tag=5.0))
    assert len(small.seats) == 2


def test_parts_are_named_by_where_they_lie():
    bounds = np.array([[0, 0, 0], [100, 30, 40.0]])
    stack = [[50, 15, z] for z in (35, 5, 15, 25)]
    assert part_names(stack, bounds) == ["4-top", "1-bottom", "2-lower-middle", "3-upper-middle"]
    octants = [[x, y, z] for z in (10, 30) for y in (7, 22) for x in (25, 75)]
    assert part_names(octants, bounds)[0] == "1-bottom-front-left"
    assert part_names(octants, bounds)[7] == "8-top-back-right"
    row = [
        name.split("-", 1)[1]
        for name in part_names([[k, 15, 20] for k in range(5, 100, 15)], bounds)
    ]
    assert row == ["left", "second-from-left", "third-from-left", "middle", "third-from-right",
                   "second-from-right", "right"]  # fmt: skip
    many = part_names([[8.4 * k, 15, 20] for k in range(12)], bounds)
    assert not any(c.isdigit() for name in many for c in name.split("-", 1)[1])
    assert part_names([[50, 15, 20]], bounds) == ["1-whole"]
    assert len(set(part_names(np.random.default_rng(0).random((30, 3)) * 40, bounds))) == 30


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("distance", [2.5, 5.0, 7.5])
def test_words_of_parts_that_lie_close_together_differ(axis, distance):
    """Two of the parts lie nearer than a level; both have words of their own."""
    bounds = np.array([[0, 0, 0], [100, 100, 100.0]])
    octants = [np.array([x, y, z]) for z in (20.0, 70) for y in (20.0, 70) for x in (20.0, 70)]
    names = part_names([*octants, octants[7] + distance * np.eye(3)[axis]], bounds)
    words = [name.split("-", 1)[1] for name in names]
    assert len(set(words)) == len(words)


@pytest.mark.parametrize("seed", range(5))
def test_many_parts_have_words_without_numbers(seed):
    centers = np.random.default_rng(seed).random((60, 3)) * 100
    names = part_names(centers, np.array([[0, 0, 0], [100, 100, 100.0]]))
    assert not any(c.isdigit() for name in names for c in name.split("-", 1)[1])


def test_left_and_top_are_those_of_the_viewer():
    """With y up and z to the viewer; and of a long body that is seen from its side, along -x."""
    bounds = np.array([[0, 0, 0], [40, 100, 30.0]])
    assert part_names([[20, 80, 15], [20, 20, 15]], bounds, Y_UP) == ["2-top", "1-bottom"]
    assert part_names([[10, 50, 5], [10, 50, 25]], bounds, Y_UP) == ["2-back", "1-front"]
    along_y = np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]])
    assert part_names([[20, 10, 15], [20, 90, 15]], bounds, along_y) == ["1-left", "2-right"]
    assert part_names([[5, 50, 15], [35, 50, 15]], bounds, along_y) == ["2-back", "1-front"]


STRAIGHT = [[2, 0], [10, 0], [50, 0], [100, 0], [140, 0], [148, 0]]


@pytest.mark.parametrize(
    ("sensors", "code", "data"),
    [
        ([cord("c", [0, 0, 1], [0, 0, 40], [1, 0, 0], STRAIGHT)],
         "path-leaves-body", {"cord": "c", "misses": True}),
        ([cord("c", [0, 0, 1], [0, 0, 15], [1, 0, 0], STRAIGHT)], None, {"cord": "c"}),
        ([cord("c", [0, 0, 1], [0, 0, 14], [1, 0, 0], STRAIGHT)],
         "wall-too-thin", {"cord": "c", "wall": pytest.approx(-0.1, abs=5e-3)}),
        ([cord("c", [0, 0, 1], [0, 0, 0], [1, 0, 0], [[2, 0], [50, 0], [60, 18], [70, 0],
                                                          [148, 0]])],
         "path-leaves-body", {"cord": "c", "misses": False}),
        ([cord("a", [0, 0, 1], [0, 0, 0], [1, 0, 0], STRAIGHT),
          cord("b", [0, 1, 0], [0, 2, 0], [1, 0, 0], STRAIGHT)],
         "wall-too-thin", {"cords": ("a", "b"), "wall": pytest.approx(-0.2, abs=5e-3)}),
        ([cord("c", [0, 0, 1], [0, 0, 0], [1, 0, 0],
               [[2, 0], [40, 0], [41, 1], [42, 0], [100, 0], [148, 0]])],
         "bend-too-tight", {"cord": "c"}),
        ([cord("a", [0, 0, 1], [0, 5, 0.0], [1, 0, 0], STRAIGHT),
          cord("b", [0, 0, 1], [0, -5, 0.4], [1, 0, 0], STRAIGHT)],
         "channel-cuts-part", {"cords": ["b"]}),
    ],
)  # fmt: skip
def test_impossible_cords_are_refused_with_their_place(bar, sensors, code, data):
    with pytest.raises(FabricationError) as caught:
        make_parts(bar, sensors, RULES)
    assert code in (None, caught.value.code)
    assert {name: caught.value.data.get(name) for name in data} == data


def test_channels_that_open_into_another_joint_are_reported(bar):
    """Two planes along the bar that cross at a small angle in the middle."""
    tilt = np.radians(4)
    steep = cord("b", [-np.sin(tilt), 0, np.cos(tilt)], [75, -3, 0], [1, 0, 0],
                 [[-73, 0], [-60, 0], [0, 0], [60, 0], [73, 0]])  # fmt: skip
    flat = cord("a", [0, 0, 1], [0, 3, 0], [1, 0, 0], STRAIGHT)
    part_set = make_parts(bar, [flat, steep], RULES)
    warnings = [w for w in part_set.warnings if "'a'" in w and "'b'" in w]
    assert warnings
    assert "mm near (" in warnings[0]


def test_walls_without_thickness_are_refused(bar):
    body = triangle_kernel.to_manifold(bar, "bar")
    plate = m3.Manifold.cube((1e-5, 20.0, 20.0)).translate((75.0, 10.0, -10.0))
    surface = triangle_kernel.to_surface(body + plate)
    with raises(FabricationError, "part-too-thin", cords=["flat"]) as caught:
        make_parts(surface, crossing()[:1], RULES)
    assert caught.value.data["at"][0] == pytest.approx(75.0, abs=0.1)
