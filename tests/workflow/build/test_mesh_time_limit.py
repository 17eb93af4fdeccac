"""Test that a mesh limited by time is made again once the limit is raised."""

from __future__ import annotations

from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.meshing import mesh_store
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.workflow.build import stage_mesh
from defsense_fab.workflow.build.build import build
from tests.conftest import box_surface
from tests.support.places import DEVICES


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a bar that is an STL file, with an empty cache of meshes."""
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "cache"))
    made = tmp_path / "bar"
    made.mkdir()
    text = (DEVICES / "bar" / "device.toml").read_text("utf-8")
    script = text[text.index("script =") : text.index("\n\n[material]")]
    text = text.replace(script, 'mesh = "bar.stl"').replace("= 8.0", "= 15.0\ntime_limit = 60", 1)
    (made / "device.toml").write_text(text)
    write_stl(box_surface([0, -15, -15], [150, 15, 15]), made / "bar.stl")
    return made


def limited(folder, seconds):
    path = folder / "device.toml"
    path.write_text(path.read_text("utf-8").replace("time_limit = 60", f"time_limit = {seconds}"))
    return load_device(folder)


@pytest.mark.slow
def test_mesh_is_made_again_only_if_the_limit_is_raised(folder, monkeypatch):
    real = stage_mesh.tetrahedralize

    def slow(*given):
        return replace(real(*given), stopped=True)

    with monkeypatch.context() as m:
        m.setattr(stage_mesh, "tetrahedralize", slow)
        assert build(load_device(folder), "mesh").made == ("body", "mesh")
    assert [made.time_limit for made in mesh_store.read_meshes(folder).values()] == [60.0]
    assert build(load_device(folder), "mesh").made == ()
    text = (folder / "device.toml").read_text("utf-8")
    assert build(limited(folder, 50), "mesh").made == ()
    (folder / "device.toml").write_text(text)
    assert build(limited(folder, 600), "mesh").made == ("mesh",)
    assert not (folder / "device.mesh").exists()
    assert build(load_device(folder), "mesh").made == ()
