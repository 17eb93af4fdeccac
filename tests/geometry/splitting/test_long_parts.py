"""Parts longer than the bed are cut in pieces."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from defsense_fab.core.device.regions import Box
from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.channels.channel_ends import Pockets
from defsense_fab.geometry.kernels import occ, triangle_kernel
from defsense_fab.geometry.parts.parts import make_parts
from defsense_fab.geometry.parts.records import PartRules
from defsense_fab.geometry.printing.print_bed import fits_bed, lay_flat
from defsense_fab.geometry.splitting import piece_checks
from defsense_fab.geometry.splitting.cut_places import find_spoiled
from defsense_fab.geometry.splitting.dowelled_cut import cut_across
from defsense_fab.geometry.splitting.long_parts import split_long_parts
from tests.geometry.parts.cords import cord
from tests.support.errors import raises
from tests.support.surfaces import is_inside

pytestmark = pytest.mark.slow

RULES = PartRules(2.0, 2.2, 0.2, 1.2, pockets=Pockets(2.8, 7.0))
BED = (90.0, 90.0, 100.0)
WAVE = [[2, 0], [10, 0], [50, 5], [100, -3], [140, 0], [148, 0]]


@pytest.fixture(scope="module")
def part_set(bar, bar_solid):
    flat = cord("flat", [0, 0, 1], [0, -5, 4], [1, 0, 0], WAVE)
    return make_parts(bar, [flat], RULES, solid=bar_solid)


@pytest.fixture(scope="module")
def split(part_set):
    return split_long_parts(part_set, BED, RULES)


def test_pieces_fit_the_bed_are_closed_and_add_up(part_set, split):
    after = split
    assert [p.name for p in after.parts] == ["1-bottom-a", "1-bottom-b", "2-top-a", "2-top-b"]
    for part in after.parts:
        assert fits_bed(lay_flat(part.surface, part.down), BED)
        mesh = trimesh.Trimesh(part.surface.vertices, part.surface.faces, process=False)
        assert mesh.is_watertight
        assert mesh.body_count == 1
        assert occ.volume(part.solid) == pytest.approx(part.volume, rel=2e-3)
    total = sum(p.volume for p in after.parts) + after.cut_out
    assert total == pytest.approx(after.body_volume, rel=1e-5)
    dowels = [p for p in after.pins if len(after.cuts[after.contacts[p.contact].cut].cords) == 0]
    assert len(dowels) == 4
    sockets = sum(2 * np.pi * d.socket**2 / 4 * d.depth for d in dowels)
    gone = sum(p.volume for p in part_set.parts) - sum(p.volume for p in after.parts)
    assert gone == pytest.approx(sockets, rel=0.01)


def test_two_dowels_of_different_thickness_join_the_pieces(split):
    part_set = split
    assert [c.sides for c in part_set.cuts] == [((0, 1), (2, 3)), ((0,), (1,)), ((2,), (3,))]
    for k in (1, 2):  # cuts are closed in the opposite order: these before that of the cord
        own = [p for p in part_set.pins if part_set.contacts[p.contact].cut == k]
        assert sorted(p.diameter for p in own)[0] < sorted(p.diameter for p in own)[1]
        halves = [part_set.parts[i] for side in part_set.cuts[k].sides for i in side]
        for pin in own:  # a rod through the joint is in no solid
            line = pin.center + np.linspace(-0.95, 0.95, 9)[:, None] * pin.depth * pin.axis
            assert not any(is_inside(half.surface, line).any() for half in halves)
    notes = [w for w in split.warnings if "1-bottom-a and 1-bottom-b" in w]
    assert len(notes) == 1


def test_cut_spares_pins_pockets_and_numbers_and_continues_the_groove(part_set, split):
    after = split
    for cut in after.cuts[1:]:
        normal, height = cut.plane.normal, cut.plane.origin @ cut.plane.normal
        for pin in part_set.pins:
            assert abs(pin.center @ normal - height) > pin.socket / 2 + 1
        for channel in part_set.channels:
            for end in channel.ends:
                assert abs(end.mouth @ normal - height) > end.pocket + 1
    channel = after.channels[0]
    thread = triangle_kernel.tube(channel.line, channel.sensor.plane.normal, 2.0)
    for part in after.parts:
        common = triangle_kernel.to_manifold(part.surface, part.name) ^ thread
        assert common.volume() < 0.02


def test_spoiled_features_are_reported(part_set, split):
    """If every place cuts something, the note names it."""
    along = np.array([1.0, 0, 0])
    for height, spoilt in ((11.0, "an end of cord flat"), (75.0, "a number")):
        assert find_spoiled(part_set, 0, height, along) == [spoilt]
        note = cut_across(part_set, 0, along, height, RULES).notes[0]
        assert spoilt in note
        assert not any(spoilt in warning for warning in split.warnings)


def test_joint_faces_belong_to_the_right_piece(part_set):
    """Cut a part along its joint's face; the amount of glue depends on these areas."""
    after = cut_across(part_set, 0, np.array([0, 0, 1.0]), -6.0, RULES).part_set
    assert sum(c.area for c in after.contacts[:-1]) == pytest.approx(part_set.contacts[0].area)


def test_checks_describe_the_pieces_and_fail_for_wrong_ones(part_set, split):
    after = split
    values = {c.name: c.value for c in after.checks}
    assert all(c.holds for c in after.checks)
    assert not any(name.startswith(("1-bottom: ", "2-top: ")) for name in values)
    assert {f"{p.name}: share thinner than 0.8 mm" for p in after.parts} <= set(values)
    assert values["wall around the dowels of 1-bottom"] > 0.7
    assert 1.0 < values["room around cord flat where 1-bottom is cut across"] < 1.15

    whole, halves = part_set.parts[0], after.parts[:2]
    plane = after.cuts[1].plane
    dowels = [p for p in after.pins if after.contacts[p.contact].cut == 1]
    beside = [replace(d, center=d.center - 40 * part_set.cuts[0].plane.normal) for d in dowels]
    with raises(FabricationError, "wall-too-thin", part="1-bottom"):
        piece_checks.check_dowel_walls(whole, beside, RULES)
    with raises(FabricationError, "overlaps-solid"):
        piece_checks.check_dowels_fit(
            whole, halves, [replace(d, diameter=d.diameter + 0.3) for d in dowels]
        )
    with raises(FabricationError, "volume-not-conserved", part="1-bottom"):
        piece_checks.check_piece_volumes(whole, halves[:1], dowels)
    line = plane.origin - np.array([[3.0], [1.0]]) * plane.normal
    line[:, 2] = 4.0
    plug = triangle_kernel.tube(line, np.array([0, 0, 1.0]), 30.0)
    plugged = triangle_kernel.to_manifold(halves[0].surface, "") + plug
    plugged = replace(halves[0], surface=triangle_kernel.to_surface(plugged))
    with raises(FabricationError, "channel-blocked", what="cord flat"):
        piece_checks.check_crossings(part_set, whole, [plugged, halves[1]], plane, RULES)


def test_every_pin_and_number_belongs_to_its_piece(split):
    part_set = split
    for pin in part_set.pins:
        contact = part_set.contacts[pin.contact]
        for i, way in ((contact.lower, -1.0), (contact.upper, 1.0)):
            low, high = part_set.parts[i].surface.bounds
            tip = pin.center + 0.5 * way * pin.axis
            assert (tip > low - 1e-3).all()
            assert (tip < high + 1e-3).all()
    for label in part_set.labels:
        low, high = part_set.parts[label.part].surface.bounds
        assert (label.center > low - 1).all()
        assert (label.center < high + 1).all()


def test_fitting_parts_are_unchanged_and_wide_parts_are_refused(part_set):
    same = split_long_parts(part_set, (220.0, 220.0, 250.0), RULES)
    assert same is part_set
    with raises(FabricationError, "part-too-large", part="1-bottom") as caught:
        split_long_parts(part_set, (25.0, 25.0, 100.0), RULES)
    assert caught.value.data["size"] == pytest.approx((150, 30, 19), abs=0.5)
    thin = replace(RULES, wall=14.0)
    with raises(FabricationError, "part-too-large", part="1-bottom", reason="no-dowel-room"):
        split_long_parts(part_set, BED, thin)


@pytest.fixture(scope="module")
def standing(bar):
    """Two halves of a bar that stand on their joint."""
    points = [[-12, 0], [-5, 0], [0, 3], [5, 0], [12, 0]]
    across = cord("across", [1, 0, 0], [75, 0, 0], [0, 1, 0], points)
    return make_parts(bar, [across], replace(RULES, pockets=None))


def test_a_part_too_high_that_cannot_be_cut_lies_on_another_side(standing):
    tall = [p.name for p in standing.parts]
    no_room = replace(RULES, wall=14.0)
    low = (100.0, 100.0, 60.0)
    assert not any(fits_bed(lay_flat(p.surface, p.down), low) for p in standing.parts)
    result = split_long_parts(standing, low, no_room)
    assert [p.name for p in result.parts] == tall
    for before, after in zip(standing.parts, result.parts, strict=True):
        assert fits_bed(lay_flat(after.surface, after.down), low)
        assert after.surface is before.surface
    notes = [w for w in result.warnings if w not in standing.warnings]
    assert all(name in note for name, note in zip(tall, notes, strict=True))
    with raises(FabricationError, "part-too-large", reason="cross-section-too-large") as caught:
        split_long_parts(standing, (31.0, 31.0, 40.0), no_room)
    assert caught.value.data["size"] == pytest.approx((30, 30, 75), abs=0.5)


def test_warnings_describe_the_pieces(part_set):
    """Not those of the part that was cut; a piece without a number is reported."""
    old = "1-bottom has no face large enough for its number: write the number on it"
    bare = replace(
        part_set,
        labels=tuple(m for m in part_set.labels if m.part == 1),
        warnings={old: None, "else": None},
    )
    warnings = split_long_parts(bare, BED, RULES).warnings
    assert old not in warnings
    assert "else" in warnings
    unmarked = [w.split()[0] for w in warnings if "has no number engraved" in w]
    assert [n for n in unmarked if n.startswith("1")] == ["1-bottom-a", "1-bottom-b"]
    assert len([n for n in unmarked if n.startswith("2")]) == 1


def test_a_region_that_is_kept_whole_is_not_cut(part_set, split):
    """The best cut is through the middle, where a bolt hole is now."""
    before = split.cuts[1].plane
    hole = Box(before.origin - np.array([6, 3, 20]), before.origin + np.array([6, 3, 20]))
    after = split_long_parts(part_set, BED, replace(RULES, kept=(hole,)))
    for cut in after.cuts[1:]:
        assert abs(cut.plane.normal[0]) == pytest.approx(1)
        assert not hole.low[0] - 2 < cut.plane.origin[0] < hole.high[0] + 2


def test_a_part_whose_sections_are_all_kept_whole_is_refused(part_set):
    whole = Box(np.array([0.0, -3, -15]), np.array([150.0, 3, 15]))
    with raises(FabricationError, "part-too-large"):
        split_long_parts(part_set, BED, replace(RULES, kept=(whole,)))
