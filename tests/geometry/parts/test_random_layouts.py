"""Random layouts are made and pass every check, or are refused with a cord and a place.

`DEFSENSE_RANDOM_LAYOUTS=100` runs as many on each body.
"""

import os
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from defsense_fab.core.device.device import BaySpec
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.geometry.printing.print_bed import lay_flat
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.prediction.as_built import fabricate
from defsense_fab.optimization.prediction.design_task import layout_limits
from tests.geometry import slicer
from tests.geometry.parts.random_layouts import random_layout
from tests.support.places import DEVICES

COUNT = int(os.environ.get("DEFSENSE_RANDOM_LAYOUTS", "4"))
#: Number of layouts by body; a layout of the blob takes four times as long as one of the bar.
BODIES = {"bar": COUNT, "blob": max(COUNT // 2, 1), "bar with a bay": COUNT}
LAYOUTS = [(name, seed) for name, count in BODIES.items() for seed in range(count)]


@cache
def body(name):
    """A device, its surface and the bay in it."""
    found = load_device(DEVICES / name.split()[0])
    spec = found.body
    if "bay" in name:
        spec = replace(spec, bay=BaySpec(np.zeros(3), (20.0, 10.0, 6.0)))
    part_set = load_body(spec)
    return found, part_set.surface, part_set.bay


@cache
def layout(name, seed):
    device, surface, _ = body(name)
    return random_layout(surface, layout_limits(device), seed)


@cache
def parts(name, seed):
    """What is made of a random layout, or in words why it is refused."""
    device, surface, bay = body(name)
    try:
        return fabricate(device, surface, layout(name, seed), lambda *_: None, bay=bay)
    except FabricationError as error:
        return str(error)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), LAYOUTS)
def test_a_random_layout_is_made_well_or_refused(name, seed):
    part_set = parts(name, seed)
    if isinstance(part_set, str):
        assert re.search(r"cords? 'c\d'|\d-[a-z-]+|plane", part_set)
        assert re.search(r"near \(|lies .* mm from", part_set)
        return
    for check in part_set.checks:
        assert np.isfinite(check.value)
    assert all(p.diameter >= 3 and p.length >= 4 for p in part_set.pins)
    total = 0.0
    for part in part_set.parts:
        solid = triangle_kernel.to_manifold(lay_flat(part.surface, part.down), part.name)
        total += solid.volume()
    assert total + part_set.cut_out == pytest.approx(body(name)[1].volume, rel=1e-4)


@pytest.mark.peer
@pytest.mark.parametrize(("name", "seed"), LAYOUTS)
def test_slicer_accepts_the_parts_of_a_random_layout(name, seed, tmp_path):
    part_set = parts(name, seed)
    if isinstance(part_set, str):
        pytest.skip("the layout is refused")
    for part in part_set.parts:
        write_stl(part.surface, tmp_path / f"{part.name}.stl")
    slicer.accept(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_layouts_within_the_limits_are_made(name):
    """Measured on sixteen layouts a body: 11, 5 and 10 keep the limits, and all these are made."""
    device, surface, _ = body(name)
    valid_seeds = [
        seed
        for seed in range(BODIES[name])
        if not verify(layout(name, seed), surface, layout_limits(device)).violations
    ]
    part_set = [seed for seed in valid_seeds if not isinstance(parts(name, seed), str)]
    assert len(valid_seeds) >= max(1, BODIES[name] // 4)
    assert len(part_set) >= 0.75 * len(valid_seeds)
