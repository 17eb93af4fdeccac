"""What tells one layout of cords from another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from defsense_fab.core.prediction import Prediction
from defsense_fab.pipeline.artifacts import typed_json
from defsense_fab.pipeline.artifacts.layout import (
    BandRecord,
    CordPath,
    CordRecord,
    LayoutRecord,
    LimitsRecord,
    layout_hash,
    load_layout,
)  # fmt: skip


def cord(straight, name, channel, y):
    sensor = straight(name, y=y)
    line = np.array([[0.0, 0, 0], [150, 0, 0]])
    return CordRecord(
        **vars(CordPath.of(sensor)), channel=channel, points=line, length=150.0, min_radius=9.0,
        min_wall=2.0, inlets=(1.0, 1.0), cord_diameter=2.0, peak_strain=0.1, least_strain=0.0,
        stretch=line, series=0.0, prestretch=None, noise=0.003,
    )  # fmt: skip


def test_it_is_of_the_cords_alone_and_survives_the_file(straight, tmp_path):
    cords = cord(straight, "left", 0, 5.0), cord(straight, "right", 1, -5.0)
    told = Prediction(
        "affine", (0.003,) * 2, 1.2, 1.1, 3, "held out", 1.0, 0.9, 2.0, 1.5, 0.1, {}, {}
    )
    band = BandRecord(1.0, 0.9, 1.1, 0.3, 0.05, 0.05, 0.01, 0.5, 600)
    limits = LimitsRecord(1.2, 5.0, 3.4)
    one = LayoutRecord(
        "bar", "mesh", limits, None, cords, 4.0, (), (), told, {}, {}, band, told, (), False, (), 1
    )
    known = layout_hash(one)
    assert layout_hash(replace(one, mesh="other", seed=2, sensors=cords[::-1])) == known
    typed_json.save(tmp_path / "layout.json", one)
    assert layout_hash(load_layout(tmp_path)) == known
    bent = replace(cords[0], control_points=cords[0].control_points + 0.01)
    swapped = replace(cords[0], channel=1), replace(cords[1], channel=0)
    for other in ((bent, cords[1]), swapped, cords[:1]):
        assert layout_hash(replace(one, sensors=other)) != known
