"""Glue is kept away from where channels and wires pass through joints."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import resample
from defsense_fab.geometry.parts.parts import make_parts
from defsense_fab.workflow.build.stage_fabricate import join_steps
from tests.geometry.channels import test_wire_channels as wired
from tests.geometry.parts.test_parts import crossing
from tests.support.surfaces import distance

pytestmark = pytest.mark.slow

body = wired.body  # a bar with a connector bay


@pytest.fixture(scope="module")
def part_set(body):
    """A bar whose halves are joined over a cord and its wire to the bay."""
    cords = [wired.CORDS[0], crossing()[2]]
    rules = wired.rules(replace(wired.WIRES, bay=body.bay))
    return make_parts(body.surface, cords, rules, solid=body.solid)


def passages(part_set, lower, upper, line, radius):
    """Return the points of a line that are within a channel's radius of parts of both sides."""
    surfaces = {part.name: part.surface for part in part_set.parts}
    near = [
        np.min([distance(surfaces[name], line) for name in side], axis=0) < radius
        for side in (lower, upper)
    ]
    return line[near[0] & near[1]]


def test_glue_stays_away_from_channels_and_wires_that_pass_through_a_joint(part_set):
    steps = join_steps(part_set)
    found = {"cord": 0, "wire": 0}
    for cut, step in zip(reversed(part_set.cuts), steps, strict=True):
        for channel in part_set.channels:
            lines = [("cord", channel.inside, part_set.rules.channel / 2)]
            lines += [("wire", lead.inside, wired.WIRES.diameter / 2) for lead in channel.leads]
            for kind, line, radius in lines:
                heights = (line - cut.plane.origin) @ cut.plane.normal
                if np.abs(heights).max() < 0.01:
                    continue  # a groove of this joint
                length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
                dense = resample(line, 0.0, length, round(length / 0.1))
                spots = [s for s in step.glueless if s.cord == channel.name]
                for point in passages(part_set, *step.join, dense, 1.05 * radius):
                    gaps = [np.linalg.norm(s.at - point) + radius - s.reach for s in spots]
                    if abs((point - cut.plane.origin) @ cut.plane.normal) < 0.2:
                        assert min(gaps, default=1.0) < 0, (channel.name, kind, point)
                        found[kind] += 1
    assert found["cord"] > 0
    assert found["wire"] > 0


def test_no_spot_is_small_or_repeated(part_set):
    """Each ring is at least as large as a hole in the face and a margin, and none is repeated."""
    for step in join_steps(part_set):
        for k, spot in enumerate(step.glueless):
            assert spot.reach >= 2.0
            others = [s for s in step.glueless[k + 1 :] if s.cord == spot.cord]
            assert all(np.linalg.norm(s.at - spot.at) > 0.5 for s in others)


def test_every_spot_is_in_its_joint(part_set):
    """A part of each side is nearer to it than the glue may be."""
    surfaces = {part.name: part.surface for part in part_set.parts}
    for step in join_steps(part_set):
        for spot in step.glueless:
            for side in step.join:
                assert min(distance(surfaces[n], spot.at[None])[0] for n in side) < spot.reach
