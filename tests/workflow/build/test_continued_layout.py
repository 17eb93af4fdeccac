"""Layouts that are kept or improved after an edit, without a search."""

from __future__ import annotations

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.curve import sample_path
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError, LayoutError
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.optimization.prediction.design_task import layout_limits
from defsense_fab.store.layout import load_layout
from defsense_fab.studio.background.background_job import JobReporter
from defsense_fab.studio.background.build_job import run_build
from defsense_fab.workflow.build import stage_optimize
from defsense_fab.workflow.build.build import build, freshness
from defsense_fab.workflow.build.options import BuildOptions
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.places import DEVICES


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A coarse bar with two free cords, built up to its layout."""
    folder = tmp_path_factory.mktemp("continued") / "bar"
    folder.mkdir()
    text = (DEVICES / "bar" / "device.toml").read_text("utf-8")
    script = text[text.index("script =") : text.index("\n\n[material]")]
    text = text.replace(script, 'mesh = "bar.stl"').replace("edge_length = 8.0", "edge_length = 15")
    text = text.replace("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]")
    text = text[: text.rindex("[[sensors]]")] + '[design]\nsearches = 2\ndecoder = "affine"\n'
    (folder / "device.toml").write_text(text)
    write_stl(box_surface([0, -15, -15], [150, 15, 15]), folder / "bar.stl")
    build(load_device(folder), "optimize")
    return folder


@pytest.fixture
def folder(built, tmp_path):
    shutil.copytree(built, tmp_path / "bar")
    return tmp_path / "bar"


def edit(folder, old, new):
    path = folder / "device.toml"
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1))


def optimize(folder, **options):
    result = build(load_device(folder), "optimize", options=BuildOptions(**options))
    return load_layout(folder / "build"), result.made


def paths(layout):
    return [cord.control_points.tolist() for cord in layout.sensors]


@pytest.fixture
def no_search(monkeypatch):
    def refuse(*_):
        raise AssertionError("a search was made")

    monkeypatch.setattr(stage_optimize, "_search_decoders", refuse)


def test_a_layout_that_keeps_the_new_limits_is_kept(folder, no_search):
    before = load_layout(folder / "build")
    assert before.continued == ""
    edit(folder, 'process = "fdm-tpu"', 'process = "fdm-tpu"\nclearance = 0.25')
    after, made = optimize(folder)
    assert (after.continued, made) == ("kept", ("optimize",))
    assert paths(after) == paths(before)
    assert after.limits != before.limits


def test_a_change_of_stiffness_alone_keeps_fields_and_layout(folder, no_search):
    before = load_layout(folder / "build")
    edit(folder, 'name = "ninjaflex-85a"', 'name = "ninjaflex-85a"\nyoung_modulus = 1.2')
    after, made = optimize(folder)
    assert (after.continued, made) == ("kept", ("optimize",))
    assert paths(after) == paths(before)


@pytest.mark.parametrize(
    "load", ["gravity = [0, 0, -3]", 'pressures = [{ region = "top", value = 0.002 }]']
)
def test_under_loads_the_stiffness_counts(folder, load):
    edit(folder, 'name = "bend_up"', f'name = "bend_up"\n{load}')
    edit(folder, "[regions]", "[regions]\ntop = { box = [[20, -16, 14], [130, 16, 16]] }")
    edit(folder, 'name = "ninjaflex-85a"', 'name = "ninjaflex-85a"\nyoung_modulus = 2.4')
    sagged = []
    for young_modulus in (2.4, 0.6):
        edit(folder, "young_modulus = 2.4", f"young_modulus = {young_modulus}")
        fields = build(load_device(folder), "simulate").results.fields
        sagged.append(fields.displacements[0, :, 2].min())
        edit(folder, f"young_modulus = {young_modulus}", "young_modulus = 2.4")
    assert abs(sagged[1] - sagged[0]) > 0.01


def test_a_layout_that_breaks_the_new_limits_is_improved(folder, no_search):
    before = load_layout(folder / "build")
    walls = [cord.min_wall for cord in before.sensors]
    wall = 0.3 + min(walls)
    edit(folder, 'process = "fdm-tpu"', f'process = "fdm-tpu"\nwall = {wall:.2f}')
    after, _ = optimize(folder)
    assert after.continued == "improved"
    assert min(cord.min_wall for cord in after.sensors) >= wall - 0.01


def outside_by(folder, distance):
    """Move the first cord until its wall is too thin by a distance, mm."""
    device = load_device(folder)
    limit = 15 - layout_limits(device).depth + distance
    edit(folder, "origin = [0, 8, 0]", f"origin = [0, {limit:.3f}, 0]")


@pytest.mark.parametrize("options", [{}, {"search": True}])
def test_a_drawn_cord_outside_a_limit_is_repaired_first(folder, options):
    outside_by(folder, 0.01)
    layout, _ = optimize(folder, **options)
    assert any("'A'" in warning for warning in layout.warnings)
    drawn = load_device(folder).sensors[0]
    np.testing.assert_allclose(layout.drawn[0], sample_path(drawn), atol=1e-9)
    assert layout.repaired == ("A",)
    assert layout.initial_label == "as drawn, repaired"
    assert all(cord.min_wall >= layout.limits.wall - 0.01 for cord in layout.sensors)


def test_a_locked_cord_outside_a_limit_is_refused(folder):
    outside_by(folder, 0.01)
    edit(folder, 'free = ["path", "plane"]', "free = []")
    with raises(LayoutError, "wall-too-thin", cord="A"):
        optimize(folder)


def test_the_plane_of_a_cord_whose_path_alone_is_free_stays(folder):
    outside_by(folder, 0.01)
    edit(folder, 'free = ["path", "plane"]', 'free = ["path"]')
    with raises(LayoutError, "wall-too-thin", cord="A"):
        optimize(folder)


def test_a_device_without_cords_is_simulated(folder):
    text = (folder / "device.toml").read_text("utf-8")
    before, after = text[: text.index("[[sensors]]")], text[text.index("[design]") :]
    (folder / "device.toml").write_text(before + after)
    with raises(DeviceError, "sensors-missing"):
        load_device(folder)
    edit(folder, "degrees = -30", "degrees = -20")
    run_build(
        JobReporter(SimpleNamespace(poll=lambda: False, send=lambda _: None)), folder, "simulate"
    )
    assert freshness(load_device(folder, cords=False))["simulate"] == "current"


def test_a_moved_cord_is_improved_from_where_it_is_drawn(folder, no_search):
    before = load_layout(folder / "build")
    edit(folder, "origin = [0, 8, 0]", "origin = [0, 6, 1]")
    after, _ = optimize(folder)
    assert after.continued == "improved"
    assert after.prediction.unseen < 1.5 * before.prediction.unseen


@pytest.mark.slow
def test_an_added_pose_solves_only_its_states_and_searches_again(folder):
    pose = """[[poses]]
name = "side"
fixed = ["base"]
[[poses.handles]]
region = "tip"
rotate = { axis = [0, 0, 1], degrees = 10 }
translate = "free"

[states]"""
    edit(folder, "[states]", pose)
    messages = []
    build(load_device(folder), "optimize", lambda _, __, message: messages.append(message))
    assert load_layout(folder / "build").continued == ""
    assert any("paths were solved before" in message for message in messages)


def test_other_changes_search_again(folder):
    edit(folder, "searches = 2", "searches = 1")
    assert optimize(folder)[0].continued == ""


@pytest.mark.slow
def test_a_search_on_request_equals_that_of_a_fresh_build(folder, tmp_path):
    edit(folder, 'process = "fdm-tpu"', 'process = "fdm-tpu"\nclearance = 0.25')
    fresh = tmp_path / "fresh"
    shutil.copytree(folder, fresh, ignore=shutil.ignore_patterns("build"))
    assert optimize(folder)[0].continued == "kept"
    assert optimize(folder)[1] == ()
    searched, made = optimize(folder, search=True)
    assert (searched.continued, made) == ("", ("optimize",))
    assert optimize(folder, search=True)[1] == ()
    np.testing.assert_array_equal(paths(searched)[0], paths(optimize(fresh)[0])[0])


@pytest.mark.slow
def test_parts_are_those_of_the_layout_they_were_made_from(folder):
    edit(folder, 'process = "fdm-tpu"', 'process = "fdm-tpu"\nclearance = 0.25')
    device = load_device(folder)
    kept = build(device, "fabricate")
    assert kept.made == ("optimize", "fabricate")
    searched = build(device, "fabricate", options=BuildOptions(search=True))
    assert searched.made == ("optimize", "fabricate")
    assert freshness(device)["fabricate"] == "current"
