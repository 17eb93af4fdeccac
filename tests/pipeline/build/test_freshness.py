"""What of a build is out of date, and the body alone."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from defsense_fab.core.device_file import load_device
from defsense_fab.geometry.kernels.export import write_stl
from defsense_fab.pipeline.artifacts.body import load_surface
from defsense_fab.pipeline.build.build import build
from defsense_fab.pipeline.build.freshness import build_body, freshness
from tests.conftest import box_surface
from tests.places import DEVICES


@pytest.fixture
def folder(tmp_path):
    """A bar that is an STL file, so that no CAD kernel is needed."""
    text = (DEVICES / "bar" / "device.toml").read_text()
    script = text[text.index("script =") : text.index("\n\n[material]")]
    text = text.replace(script, 'mesh = "bar.stl"')
    (tmp_path / "device.toml").write_text(text.replace("edge_length = 6.0", "edge_length = 15.0"))
    write_stl(box_surface([0, -15, -15], [150, 15, 15]), tmp_path / "bar.stl")
    return tmp_path


def states(folder):
    found = freshness(load_device(folder))
    return [found[name] for name in ("body", "mesh", "simulate")]


def test_each_change_makes_old_what_depends_on_it(folder):
    assert states(folder) == ["missing"] * 3
    build(load_device(folder), "mesh")
    assert states(folder) == ["current", "current", "missing"]
    text = (folder / "device.toml").read_text()
    (folder / "device.toml").write_text(text.replace("edge_length = 15.0", "edge_length = 12.0"))
    assert states(folder) == ["current", "old", "missing"]
    (folder / "device.toml").write_text(text)
    write_stl(box_surface([0, -15, -15], [100, 15, 15]), folder / "bar.stl")
    assert states(folder) == ["old", "old", "missing"]


def test_a_body_is_made_beside_the_build_which_stays(folder):
    build(load_device(folder), "mesh")
    before = {p: p.stat().st_mtime_ns for p in (folder / "build").rglob("*")}
    write_stl(box_surface([0, -15, -15], [100, 15, 15]), folder / "bar.stl")
    for _ in range(2):
        build_body(load_device(folder), folder / ".studio" / "preview")
    assert np.ptp(load_surface(folder / ".studio" / "preview").vertices, axis=0)[0] == 100
    assert {p: p.stat().st_mtime_ns for p in (folder / "build").rglob("*")} == before
    shutil.rmtree(folder / ".studio")
