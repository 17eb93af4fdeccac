"""Tests of up-to-date stages, recorded options, and building the body alone."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.materials import find_silicone
from defsense_fab.core.errors import StorageError
from defsense_fab.core.storage.files import write_json
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.store.body import load_surface
from defsense_fab.workflow.build import body_sources, stages
from defsense_fab.workflow.build.build import build, build_body, first_outdated, freshness
from defsense_fab.workflow.build.export import export
from defsense_fab.workflow.build.options import BuildOptions
from defsense_fab.workflow.build.recorded_options import recorded_options
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.places import DEVICES


@pytest.fixture
def folder(tmp_path):
    """A bar that is an STL file, so that no CAD kernel is needed."""
    text = (DEVICES / "bar" / "device.toml").read_text("utf-8")
    script = text[text.index("script =") : text.index("\n\n[material]")]
    text = text.replace(script, 'mesh = "bar.stl"')
    (tmp_path / "device.toml").write_text(text.replace("edge_length = 8.0", "edge_length = 15.0"))
    write_stl(box_surface([0, -15, -15], [150, 15, 15]), tmp_path / "bar.stl")
    return tmp_path


def states(folder):
    found = freshness(load_device(folder))
    return [found[name] for name in ("body", "mesh", "simulate")]


@pytest.mark.slow
def test_a_change_outdates_the_stages_that_depend_on_it(folder):
    assert states(folder) == ["missing"] * 3
    build(load_device(folder), "mesh")
    assert states(folder) == ["current", "current", "missing"]
    text = (folder / "device.toml").read_text("utf-8")
    (folder / "device.toml").write_text(text.replace("edge_length = 15.0", "edge_length = 12.0"))
    assert states(folder) == ["current", "old", "missing"]
    (folder / "device.toml").write_text(text)
    write_stl(box_surface([0, -15, -15], [100, 15, 15]), folder / "bar.stl")
    assert states(folder) == ["old", "old", "missing"]


@pytest.mark.parametrize(
    ("change", "old"),
    [
        ({"shrinkage": 0.01}, {"optimize", "fabricate", "report"}),
        ({"pot_life": 9.0}, {"fabricate", "report"}),
    ],
)
def test_silicone_data_affect_only_cast_devices(folder, monkeypatch, change, old):
    path = folder / "device.toml"
    text = path.read_text("utf-8")
    for process, material in (("cast-silicone", "smooth-sil-950"), ("fdm-tpu", "ninjaflex-85a")):
        path.write_text(text.replace("fdm-tpu", process).replace("ninjaflex-85a", material))
        device = load_device(folder)
        before = stages.stage_keys(device, folder / "build")
        with monkeypatch.context() as m:
            m.setattr(stages, "find_silicone", lambda name: replace(find_silicone(name), **change))
            after = stages.stage_keys(device, folder / "build")
        changed = {name for name, key in before.items() if after[name] != key}
        assert changed == (old if process == "cast-silicone" else set())


@pytest.mark.slow
def test_build_body_leaves_the_build_unchanged(folder):
    build(load_device(folder), "mesh")
    before = {p: p.stat().st_mtime_ns for p in (folder / "build").rglob("*")}
    write_stl(box_surface([0, -15, -15], [100, 15, 15]), folder / "bar.stl")
    for _ in range(2):
        build_body(load_device(folder), folder / ".studio" / "preview")
    assert np.ptp(load_surface(folder / ".studio" / "preview").vertices, axis=0)[0] == 100
    assert {p: p.stat().st_mtime_ns for p in (folder / "build").rglob("*")} == before
    shutil.rmtree(folder / ".studio")


@pytest.fixture
def quick(monkeypatch):
    """Replace the stages by ones that only leave a file each."""

    def run(stage, device, results, *_, **__):
        for name in stage.outputs:
            record = {"device": device.name, "copies": device.fabrication.copies}
            write_json(results.folder / name, record)

    monkeypatch.setattr(stages.Stage, "run", run)
    monkeypatch.setattr(body_sources, "is_unchanged", lambda *_: True)


def test_options_are_recorded_with_the_build(folder, quick):
    path, text = folder / "device.toml", (folder / "device.toml").read_text("utf-8")
    build(load_device(folder), options=BuildOptions(3, (250.0, 210.0, 200.0)))
    device = load_device(folder)
    assert first_outdated(device) is None
    assert recorded_options(device, folder / "build") == BuildOptions(3, (250.0, 210.0, 200.0))
    assert build(device, "simulate").made == ()  # the parts are not made again
    assert json.loads((folder / "build" / "parts").read_text("utf-8"))["copies"] == 3

    path.write_text(text + "\n[fabrication]\ncopies = 2\n" if "[fabrication]" not in text else
                    text.replace("[fabrication]", "[fabrication]\ncopies = 2"))  # fmt: skip
    device = load_device(folder)
    assert first_outdated(device).name == "fabricate"
    with raises(StorageError, "build-outdated", stage="fabricate"):
        export(device, folder / "out.zip")
    path.write_text(text.replace("edge_length = 15.0", "edge_length = 12.0"))
    device = load_device(folder)
    assert build(device, "simulate").made == ("mesh", "simulate")
    assert set(freshness(device).values()) == {"current", "missing"}

    path.write_text(text)
    assert build(load_device(folder)).made[-2:] == ("fabricate", "report")
    assert not recorded_options(load_device(folder), folder / "build").overrides


def test_a_later_change_of_device_toml_overrides_a_recorded_option(folder, quick):
    path, text = folder / "device.toml", (folder / "device.toml").read_text("utf-8")
    assert "[fabrication]" in text
    build(load_device(folder), options=BuildOptions(3))
    path.write_text(text.replace("[fabrication]", "[fabrication]\ncopies = 3"))
    assert build(load_device(folder)).made == ()
    path.write_text(text)
    assert not recorded_options(load_device(folder), folder / "build").overrides
    assert first_outdated(load_device(folder)).name == "fabricate"
