"""Pictures of joints mark in red where glue must stay away."""

import base64
import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from defsense_fab.report.guide.joint_pictures import JointPictures
from defsense_fab.report.guide.steps import Illustration, guide_steps
from defsense_fab.report.guide.templates import glueless_lines
from defsense_fab.store.manifest import GluelessSpot, JointStretch

from .blocks import blocks


def count_red(some):
    """Return the number of red pixels in the picture in which the last joint is closed."""
    sensors = [
        SimpleNamespace(name=s["name"], points=np.asarray(s["points"]))
        for s in some.layout["sensors"]
    ]
    pictures = JointPictures(
        some.device, SimpleNamespace(sensors=sensors), some.manifest, some.parts
    )
    step = [s for s in guide_steps(some.device, some.manifest, some.parts) if s.joint][-1]
    passage = next(p for p in step.passages if p.illustration is Illustration.CLOSE)
    data = base64.b64decode(pictures.draw(step, passage).partition(",")[2])
    red, green, blue = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), int).T
    return int(((red > 150) & (green < 60) & (blue < 60)).sum())


@pytest.fixture(scope="module")
def bonded():
    return blocks(1, 1, "bonded", ends=[["mouth", "mouth"]])


def test_grooves_of_held_cords_are_marked(bonded):
    assert count_red(bonded) == 0
    assert count_red(blocks(1, 1, "held", ends=[["mouth", "mouth"]])) > 200


def test_open_walls_are_marked(bonded):
    (step,) = bonded.manifest.assembly
    center = next(iter(bonded.parts.values())).bounds.mean(0)
    spot = GluelessSpot("cord-0", center - center @ step.opens * step.opens, 8.0)
    manifest = replace(bonded.manifest, assembly=(replace(step, glueless=(spot,)),))
    assert count_red(replace(bonded, manifest=manifest)) > 50


def test_wires_that_slide_later_are_marked_only_in_their_joint():
    some = blocks(3, 2, "bonded", ends=[["bend", "bend"]] * 2, pins=False)
    steps = guide_steps(some.device, some.manifest, some.parts)
    joint_by_index = {s.joint.index: s.joint for s in steps if s.joint}
    last = len(joint_by_index) - 1
    joints = [joint_by_index[j] for j in range(last + 1)]
    assert last > 0
    start, end = some.manifest.cords[0].ends
    path = np.array([-20.0, 0.0, 20.0])[:, None] * joints[0].across
    stretches = (JointStretch(0, 0.0, 15.0), JointStretch(last, 15.0, 40.0))
    for crosses in ((), (last,)):
        wire = replace(end.wire, path=path, stretches=stretches, crosses=crosses)
        cord = replace(some.manifest.cords[0], ends=(start, replace(end, wire=wire)))
        manifest = replace(some.manifest, cords=(cord, *some.manifest.cords[1:]))
        lines = [glueless_lines(some.device, None, manifest, joint) for joint in joints]
        assert [len(x) for x in lines] == [2 if crosses else 0, *[0] * last]
        for line in lines[0]:
            along = line @ joints[0].across
            assert (along.min(), along.max()) == pytest.approx((-20, -5))
