"""Moulds are closed, open without undercut, and hold their parts."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from defsense_fab.core.errors import FabricationError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.channels.channel_ends import Pockets
from defsense_fab.geometry.kernels import surface_queries, triangle_kernel
from defsense_fab.geometry.kernels.cutting_tools import axes_from_normal
from defsense_fab.geometry.moulds.mould_checks import check_opening
from defsense_fab.geometry.moulds.moulds import check_openings, make_moulds
from defsense_fab.geometry.moulds.openings import depth_inside
from defsense_fab.geometry.moulds.records import MouldRules
from defsense_fab.geometry.parts.parts import make_parts
from defsense_fab.geometry.parts.records import PartRules
from tests.geometry.parts.cords import cord
from tests.support.errors import raises
from tests.support.surfaces import from_trimesh, is_inside

pytestmark = pytest.mark.slow

RULES = PartRules(2.0, 2.2, 0.15, 1.5, pockets=Pockets(2.75, 7.0))
SHRINKAGE = 0.004
WAVE = [[2, 0], [10, 0], [50, 5], [100, -3], [140, 0], [148, 0]]


def slanted():
    """Two planes that are neither parallel nor at right angles: parts between them are wedges."""
    return [
        cord("flat", [0, 0, 1], [0, -5, 4], [1, 0, 0], WAVE),
        cord("slanted", [0, 0.9, 0.436], [0, 6, 0], [1, 0, 0],
             [[2, 8], [10, 8], [60, 8], [140, 7], [148, 7]]),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def part_set(bar):
    return make_parts(bar, slanted(), RULES)


@pytest.fixture(scope="module")
def moulds(part_set):
    messages = []
    out = make_moulds(
        part_set, MouldRules(shrinkage=SHRINKAGE), lambda result, what: messages.append(what)
    )
    assert messages == [f"mould of {p.name}" for p in part_set.parts]
    return out


def mesh_of(surface):
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def enlarged(part):
    return Surface(part.surface.vertices / (1 - SHRINKAGE), part.surface.faces)


def test_every_part_has_a_mould_of_few_closed_pieces(part_set, moulds):
    assert [m.part for m in moulds] == [p.name for p in part_set.parts]
    assert all(2 <= len(m.pieces) <= 4 for m in moulds)
    assert min(len(m.pieces) for m in moulds) == 2  # one face: a cup and its lid
    for mould in moulds:
        for piece in mould.pieces:
            mesh = mesh_of(piece.surface)
            assert mesh.is_watertight
            assert mesh.is_winding_consistent
            assert mesh.volume > 0
            assert mesh.body_count == 1


def test_checks_of_sound_moulds_hold(moulds):
    """The guide prints these values next to their limits."""
    for check in (c for m in moulds for c in m.checks):
        assert check.holds, check
        if "keys" in check.name:
            assert not check.note


def test_the_cavity_is_the_part_less_its_shrinkage(part_set, moulds):
    """By points of the block, of which each is in one piece, in the cavity, or in the play between
    pieces: kernels and construction are out of it."""
    rng = np.random.default_rng(5)
    for part, mould in list(zip(part_set.parts, moulds, strict=True))[:2]:
        assert mould.cavity * (1 - SHRINKAGE) ** 3 == pytest.approx(part.volume, rel=1e-3)
        solids = [enlarged(part), *(p.surface for p in mould.pieces)]
        low = np.min([s.bounds[0] for s in solids], axis=0)
        high = np.max([s.bounds[1] for s in solids], axis=0)
        points = rng.uniform(low, high, (10_000, 3))
        owners = np.sum([is_inside(s, points) for s in solids], axis=0)
        assert (owners > 1).mean() < 2e-4
        whole = sum(mesh_of(s).volume for s in solids)
        assert mould.block * 0.98 < whole < mould.block
        # What is left are holes for screws, pouring and air, and the play around keys and cores.
        box = np.prod(high - low)
        assert (owners > 0).mean() * box == pytest.approx(whole, rel=0.04)


def test_pieces_come_off_without_passing_through_the_part(part_set, moulds):
    """Rays from each piece's surface along its way meet the part nowhere."""
    rng = np.random.default_rng(6)
    for part, mould in zip(part_set.parts, moulds, strict=True):
        cast = enlarged(part)
        assert mould.strain == 0
        for piece in mould.pieces:
            points = piece.surface.scatter(400, rng)
            near = depth_inside(cast, points) == 0
            for step in (0.5, 2.0, 8.0, 40.0):
                assert depth_inside(cast, points[near] + step * piece.opens).max() < 0.08
            start = points[near][:15] + 0.05 * piece.opens
            for origin in start:
                met = surface_queries.cast_ray(origin, piece.opens, cast)
                # A ray that grazes the wall beside which a core slides goes in and out at once.
                assert len(met) < 2 or np.ptp(met) < 0.6 or len(met) % 2 == 1


def test_a_piece_that_locks_is_found(part_set, moulds):
    """The check fails if the pieces come off in another direction."""
    mould = moulds[0]
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in mould.pieces]
    cast = triangle_kernel.to_manifold(enlarged(part_set.parts[0]), "part")
    across = axes_from_normal(mould.pieces[0].opens)[:, 0]
    with pytest.raises(FabricationError) as caught:
        check_opening(
            "x", solids, [across, *(p.opens for p in mould.pieces[1:])], cast, [0.0] * len(solids)
        )
    assert caught.value.code in ("mould-pieces-lock", "mould-does-not-open")


def test_pouring_hole_and_vents_are_at_the_top(part_set, moulds):
    for part, mould in zip(part_set.parts, moulds, strict=True):
        top = (enlarged(part).vertices @ mould.up).max()
        for hole in (mould.pour, *mould.vents):
            assert hole @ mould.up == pytest.approx(top, abs=0.01)
            # Open from the cavity to the outside: no piece is in the way.
            line = hole + np.linspace(-0.2, 30, 60)[:, None] * mould.up
            assert not any(is_inside(p.surface, line).any() for p in mould.pieces)
        assert len(mould.vents) >= 2


def ball_with_holes(holes):
    """A ball of 24 mm, and straight holes through it: an axis, a place and a height each."""
    body = trimesh.creation.icosphere(subdivisions=2, radius=24)
    for way, (x, y, z) in holes:
        hole = trimesh.creation.cylinder(4, 80, sections=24)
        turn = trimesh.geometry.align_vectors([0, 0, 1], way)
        turn[:3, 3] = x, y, z
        hole.apply_transform(turn)
        body = body.difference(hole, engine="manifold")
    return from_trimesh(body)


def over_the_middle():
    points = [[-14, 0], [-9, 0], [0, 2], [9, 0], [14, 0]]
    return [cord("one", [0, 0, 1], [0, 0, 16], [1, 0, 0], points)]


def test_a_round_part_that_is_cut_off_centre_takes_a_shell_of_two_pieces():
    part_set = make_parts(ball_with_holes([]), over_the_middle(), replace(RULES, pockets=None))
    low, high = make_moulds(part_set, MouldRules())
    assert [p.name for p in low.pieces] == [
        "mould-1-bottom-lid", "mould-1-bottom-cup-1", "mould-1-bottom-cup-2",
    ]  # fmt: skip
    assert len(high.pieces) == 2
    assert low.strain < 0.05
    assert low.pieces[1].opens == pytest.approx(-low.pieces[2].opens)
    for half in low.pieces[1:]:  # lies on its outside as it is printed
        assert half.down == pytest.approx(half.opens)


def test_holes_that_cannot_be_cast_are_refused_with_their_place():
    across = [([1, 0, 0], (0, y, -2)) for y in (-10, 10)]
    body = ball_with_holes(across + [([0, 1, 0], (x, 0, -14)) for x in (-8, 8)])
    part_set = make_parts(body, over_the_middle(), replace(RULES, pockets=None))
    with raises(FabricationError, "undercut-too-deep", part="1-bottom") as caught:
        check_openings(part_set)
    assert len(caught.value.data["at"]) == 3
