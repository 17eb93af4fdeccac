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
from defsense_fab.store.manifest import GluelessSpot

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
