"""Smoothing a cord never breaks a limit that was kept, and never breaks one more."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from defsense_fab.core.curve import Hermite, catmull_rom
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.limits.worsening import worsened_limits
from defsense_fab.optimization.prediction.design_task import layout_limits
from defsense_fab.optimization.refinement.repair import repair_layout
from defsense_fab.workflow.design.repair_cords import smooth_cord
from defsense_fab.workflow.device import load_device

BAR = Path(__file__).parents[3] / "fixtures" / "devices" / "bar"


def test_smooth_cords_keep_what_the_drawn_ones_keep(bar):
    device, rng = load_device(BAR), np.random.default_rng(1)
    limits = layout_limits(device)
    outcomes = {"kept": 0, "moved": 0, "refused": 0}
    for trial in range(16):
        points = device.sensors[0].curve.points.copy()
        points[2:-2] += rng.normal(0, 5, points[2:-2].shape)
        tangents = catmull_rom(points)
        tangents[2:-2] *= rng.uniform(0.3, 1.5, (len(points) - 4, 1))
        drawn = replace(device.sensors[0], curve=Hermite(points, tangents))
        layout = (drawn, *device.sensors[1:])
        if trial % 2:  # within the limits, with tangents that do not follow from the points
            layout = repair_layout(layout, bar, limits).sensors
        before = verify(layout, bar, limits)
        try:
            found = smooth_cord(replace(device, sensors=layout), bar, drawn.name)
        except LayoutError:
            outcomes["refused"] += 1
            continue
        curve = found.sensor.curve
        np.testing.assert_allclose(curve.tangents, catmull_rom(curve.points), atol=2e-3)
        after = verify((found.sensor, *layout[1:]), bar, limits)
        assert not worsened_limits(before, after, limits)
        outcomes["moved" if found.has_moved else "kept"] += 1
    assert outcomes["moved"]
    assert outcomes["refused"] <= 4


def test_without_a_body_there_is_nothing_to_keep():
    device = load_device(BAR)
    assert not smooth_cord(device, None, device.sensors[0].name).has_moved
