"""Connector bays, and the wires' routes to them or out of the skin."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from defsense_fab.core.curve import bend_radius
from defsense_fab.core.device.device import BaySpec, BodySpec
from defsense_fab.core.errors import BodyError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.body import Body, load_body
from defsense_fab.geometry.bodies.connector_bay import place_bay
from defsense_fab.geometry.channels.channel_ends import Pockets
from defsense_fab.geometry.channels.planar_routing import HEADINGS
from defsense_fab.geometry.channels.wire_channels import Wires
from defsense_fab.geometry.kernels import occ, triangle_kernel
from defsense_fab.geometry.parts.parts import make_parts
from defsense_fab.geometry.parts.records import PartRules
from defsense_fab.geometry.printing.export import write_stl
from tests.conftest import box_surface
from tests.geometry.parts.cords import cord as plane_cord
from tests.support import body_scripts
from tests.support.errors import raises
from tests.support.surfaces import distance, from_trimesh, is_inside, read_stl

pytestmark = pytest.mark.slow

BAY = BaySpec(np.array([0.0, 0, 0]), (14.0, 7.0, 8.0))
WIRES = Wires(1.1, 1.3)


def rules(wires):
    return PartRules(2.0, 2.2, 0.2, 1.2, pockets=Pockets(2.8, 7.0, wires))


def cord(name, origin, points, normal=(0, 0, 1)):
    return plane_cord(name, normal, origin, [1, 0, 0], points)


#: One in the bay's own plane, one 8 mm above its middle, one upright and beside it.
CORDS = [
    cord("level", [0, 10, 0], [[2, 0], [10, 0], [60, -2], [140, 0], [148, 0]]),
    cord("above", [0, -9, 8], [[2, 0], [10, 0], [60, 0], [140, 0], [148, 0]]),
    cord("upright", [0, -4, -9], [[2, 0], [10, 0], [60, 0], [140, 0], [148, 0]], (0, 1, 0)),
]


@pytest.fixture(scope="module")
def body(bar_solid):
    bay = place_bay(BAY, occ.tessellate(bar_solid, 0.05))
    solid = occ.cut_out(bar_solid, [bay])
    return Body(occ.tessellate(solid, 0.05), occ.volume(solid), solid, (), bay)


@pytest.fixture(scope="module")
def part_set(body):
    return make_parts(body.surface, CORDS, rules(replace(WIRES, bay=body.bay)), solid=body.solid)


def with_bay(surface, bay):
    """Cut a bay out of a surface."""
    solid = triangle_kernel.to_manifold(surface, "body")
    return triangle_kernel.to_surface(triangle_kernel.cut_out(solid, [bay]))


def leads(part_set):
    pairs = [(c, e.lead) for c in part_set.channels for e in c.ends if e.lead]
    assert pairs
    return pairs


def test_every_wire_reaches_the_bay(part_set, body):
    assert [e.wire for c in part_set.channels for e in c.ends] == ["bay"] * 6
    for channel, lead in leads(part_set):
        end = lead.whole[-1]
        local = (end - body.bay.origin) @ body.bay.axes
        assert (np.abs(local[:2]) < [7, 3.5]).all()
        assert 0 < local[2] < 8
        # It begins on the cord's line, in the pocket, and stays in the plane.
        ferrule = channel.ends[0] if lead is channel.ends[0].lead else channel.ends[1]
        assert lead.inside[0] == pytest.approx(ferrule.mouth - (ferrule.pocket - 7) * ferrule.out)
        assert lead.path[[0, -1]] == pytest.approx(lead.inside[[0, -1]])
        off = (lead.inside - channel.sensor.plane.origin) @ channel.sensor.plane.normal
        assert np.abs(off).max() < 1e-9
        assert (lead.drop is not None) == (channel.name == "above")


def test_bends_hold_the_wires(part_set):
    """At least 45 degrees before anything else, and no bend tighter than two diameters."""
    for _, lead in leads(part_set):
        first = np.abs(lead.way.moves[: HEADINGS // 8])
        assert (first == 1).all()
        assert bend_radius(lead.inside).min() == pytest.approx(2.6, rel=0.01)


def test_leads_keep_their_walls(part_set, body):
    whole = body.surface
    # Facets of the bay's walls do not count: the wire ends there.
    corners = whole.vertices[whole.faces]
    local = np.abs((corners - body.bay.origin) @ body.bay.axes)
    skin = whole.faces[~((local[:, :, 0] < 7.01) & (local[:, :, 1] < 3.51)).all(axis=1)]
    for channel, lead in leads(part_set):
        to_skin = distance(Surface(whole.vertices, skin), lead.whole)
        assert to_skin.min() > 0.65 + 0.8 - 0.03
        for other in part_set.channels:
            if other is not channel:
                for points, radius in other.hollows(2.2, rules(WIRES).pockets):
                    gap = np.linalg.norm(lead.whole[:, None] - points[None], axis=2).min()
                    assert gap > 0.65 + radius + 0.8 - 0.03
        own, late = channel.inside[60:-60], lead.whole[40:]
        if len(late):
            gap = np.linalg.norm(late[:, None] - own[None], axis=2).min()
            assert gap > 0.65 + 1.1 + 0.8 - 0.05


def test_wires_lie_in_air_and_can_be_inserted(part_set, tmp_path):
    """Measured on what the STL files hold, closed and with the halves apart."""
    assert sum(len(part_set.channels[c].leads) for cut in part_set.cuts for c in cut.cords) >= 6
    parts = []
    for part in part_set.parts:
        write_stl(part.surface, tmp_path / "part.stl")
        parts.append(read_stl(tmp_path / "part.stl"))
    for cut in part_set.cuts:
        for c in cut.cords:
            for lead in part_set.channels[c].leads:
                for lift in (0.0, 0.5, 3.0, 12.0):
                    for side, sign in zip(cut.sides, (-1, 1), strict=True):
                        for i in side:
                            points = lead.whole - sign * lift * cut.plane.normal
                            assert not is_inside(parts[i], points).any()
                            assert distance(parts[i], points).min() > 0.55


def test_both_kernels_cut_the_same_leads(part_set):
    assert not [w for w in part_set.warnings if "STEP" in w]
    for part in part_set.parts:
        assert occ.volume(part.solid) == pytest.approx(part.volume, rel=1e-3)


def test_without_a_bay_wires_leave_next_to_the_mouth(bar):
    part_set = make_parts(bar, CORDS[:2], rules(WIRES))
    ends = [e for c in part_set.channels for e in c.ends]
    assert [e.wire for e in ends] == ["bend"] * 4
    for end in ends:
        assert end.pocket == pytest.approx(7 + WIRES.room(0.8))
        assert distance(bar, end.lead.exit[None])[0] < 1e-4
        # The hole and the chamfered mouth keep a wall between them.
        assert np.linalg.norm(end.lead.exit - end.mouth) > 1.4 + 0.53 + 0.8 + 0.65


def test_wire_without_a_route_states_why_and_leaves_by_its_mouth(bar):
    far_bay = place_bay(replace(BAY, at=np.array([75.0, 0, -15])), bar)
    body = with_bay(bar, far_bay)
    under = cord("under", [0, 0, 0], [[2, -11], [10, -11], [75, -3], [140, -11], [148, -11]],
                 (0, 1, 0))  # fmt: skip
    part_set = make_parts(body, [under], rules(replace(WIRES, bay=far_bay, relief=False)))
    assert [e.wire for e in part_set.channels[0].ends] == ["bay", "bay"]
    away = cord("away", [0, 0, -9], [[100, -13], [100, -9], [100, 0], [100, 9], [100, 13]])
    part_set = make_parts(body, [away], rules(replace(WIRES, bay=far_bay, relief=False)))
    for end, which in zip(part_set.channels[0].ends, ("start", "end"), strict=True):
        assert end.wire == "mouth"
        assert end.pocket == 7.0
        assert end.unled
        assert any("cord away" in w and which in w and end.unled in w for w in part_set.warnings)


def test_a_cord_that_ends_in_the_bay_needs_no_lead(body):
    ends = [[9, 0], [16, 0], [60, 2], [140, 0], [148, 0]]
    part_set = make_parts(
        body.surface, [cord("c", [0, 0, 0], ends)], rules(replace(WIRES, bay=body.bay))
    )
    start, end = part_set.channels[0].ends
    assert start.wire == "bay"
    assert start.lead is None
    assert start.pocket == 7.0
    assert end.wire == "bay"
    assert end.lead is not None


def test_bends_keep_away_from_their_own_cord(bar):
    """Mouths 6 mm apart on one face: the bends go to the outer sides."""
    leg = [[2, 3], [6, 3], [10, 3], [14, 3], [18, 3.3], [24, 5.2], [30, 7], [36, 8], [42, 6]]
    points = [[x, -y] for x, y in leg] + [[44.5, 0]] + [[x, y] for x, y in leg[::-1]]
    part_set = make_parts(bar, [cord("loop", [0, 0, 0], points)], rules(WIRES))
    for end, twin in zip(part_set.channels[0].ends, part_set.channels[0].ends[::-1], strict=True):
        assert end.wire == "bend"
        other = twin.mouth - np.linspace(0, twin.pocket, 50)[:, None] * twin.out
        gap = np.linalg.norm(end.lead.inside[:, None] - other[None], axis=2).min()
        assert gap > 0.65 + 1.4 + 0.8 - 0.02


def test_seats_keep_out_of_the_bay(bar):
    wide_bay = place_bay(BaySpec(np.array([75.0, 0, 15]), (24.0, 24.0, 6.0)), bar)
    body = with_bay(bar, wide_bay)
    requested_rules = replace(rules(replace(WIRES, bay=wide_bay)), seats=20)
    part_set = make_parts(
        body, [cord("c", [0, 0, -8], [[2, 0], [10, 0], [60, 0], [148, 0]])], requested_rules
    )
    assert len(part_set.seats) > 10
    for seat in part_set.seats:
        beside = np.abs((seat.center - wide_bay.origin) @ wide_bay.axes)
        assert (beside[:2] > 12).any() or beside[2] > 8


@pytest.mark.parametrize("seed", range(4))
def test_a_bay_opens_square_to_the_face_however_the_body_lies(seed):
    box = box_surface([-30, -20, -20], [30, 20, 20])
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    body = Surface(np.ascontiguousarray(box.vertices @ turn.T), box.faces)
    # 12 mm from two edges, so that the other faces lie within the opening's reach.
    bay = place_bay(BaySpec(turn @ [18.0, 8, 20], (8.0, 8.0, 6.0)), body)
    assert bay.axes[:, 2] == pytest.approx(turn[:, 2], abs=1e-9)


def test_obstacles_over_or_behind_a_bay_are_detected():
    def solid(low, high):
        return triangle_kernel.to_manifold(box_surface(low, high), "box")

    block = solid([-40, -20, -20], [40, 20, 20])
    at = BaySpec(np.array([0.0, 0, 20]), (14.0, 7.0, 8.0))
    for obstructed, code in (
        (block - solid([-41, -21, 15], [41, 0, 17]), "bay-wall-thin"),
        (block - solid([-20, 3.6, 13], [20, 8, 18]), "bay-wall-thin"),
        (block + solid([5, -20, 20], [40, 20, 40]), "bay-opening-covered"),
    ):
        with raises(BodyError, code):
            place_bay(at, triangle_kernel.to_surface(obstructed))


@pytest.mark.parametrize(
    ("at", "size", "code"),
    [
        ([0, 0, 40], (14, 7, 8), "bay-off-skin"),
        ([0, 11, 0], (14, 7, 8), "bay-skin-uneven"),
        ([0, 7.5, 0], (14, 7, 8), "bay-wall-thin"),
        ([75, 0, 15], (14, 7, 29.5), "bay-wall-thin"),
        ([75, 0, 15], (14, 7, 60), "bay-wall-thin"),
        ([0, 0, 0], (60, 7, 8), "bay-skin-uneven"),
        ([0, 0, 0], (400, 7, 8), "bay-too-large"),
    ],
)
def test_a_bay_without_room_is_refused(bar, at, size, code):
    with raises(BodyError, code):
        place_bay(BaySpec(np.array(at, float), size), bar)


def test_bay_in_a_strongly_curved_skin_is_refused():
    surface = from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=12.0))
    with raises(BodyError, "bay-skin-uneven"):
        place_bay(BaySpec(np.array([0.0, 0, 12]), (20.0, 10.0, 4.0)), surface)
    good = place_bay(BaySpec(np.array([0.0, 0, 12]), (6.0, 6.0, 5.0)), surface)
    cap = surface.volume - with_bay(surface, good).volume
    assert 36 * 5 < cap < 36 * 6  # its floor lies 5 mm under the lowest skin of its opening


def test_cad_and_mesh_bodies_get_their_bay(tmp_path):
    script = tmp_path / "box.py"
    script.write_text(body_scripts.HEAD + "def body():\n    return box(40, 30, 20)\n")
    spec = BodySpec("script", script, bay=BaySpec(np.array([20.0, 0, 10]), (14.0, 7.0, 8.0)))
    cad = load_body(spec)
    write_stl(load_body(replace(spec, bay=None)).surface, tmp_path / "box.stl")
    mesh = load_body(replace(spec, kind="mesh", path=tmp_path / "box.stl"))
    for body in (cad, mesh):
        assert body.volume == pytest.approx(40 * 30 * 20 - 14 * 7 * 8, rel=1e-6)
        assert body.surface.volume == pytest.approx(body.volume, rel=1e-6)
        assert body.bay is not None
    assert occ.volume(cad.solid) == pytest.approx(cad.volume)
