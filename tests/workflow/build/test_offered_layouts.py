"""Another number of parts is taken from the layouts of an earlier search, without a search."""

from __future__ import annotations

import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.optimization.prediction import choose_layout
from defsense_fab.optimization.prediction.choose_layout import offered_layouts
from defsense_fab.store.layout import load_layout, load_weighed
from defsense_fab.workflow.build import stage_optimize
from defsense_fab.workflow.build.build import build, first_outdated
from defsense_fab.workflow.build.options import BuildOptions
from defsense_fab.workflow.build.recorded_options import recorded_options
from defsense_fab.workflow.build.results import Build
from defsense_fab.workflow.fabrication.offers import find_offers
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.places import DEVICES

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A coarse bar with two free cords, all of whose layouts were made, built up to its parts."""
    folder = tmp_path_factory.mktemp("offered") / "bar"
    folder.mkdir()
    text = (DEVICES / "bar" / "device.toml").read_text("utf-8")
    script = text[text.index("script =") : text.index("\n\n[material]")]
    text = text.replace(script, 'mesh = "bar.stl"').replace("edge_length = 8.0", "edge_length = 15")
    text = text.replace("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [1.0]")
    text = text[: text.index("[[sensors]]")]
    text += '[design]\nsensors = 2\nsearches = 3\ndecoder = "affine"\n'
    (folder / "device.toml").write_text(text)
    write_stl(box_surface([0, -15, -15], [150, 15, 15]), folder / "bar.stl")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choose_layout, "FEWER_PARTS_ERROR_RATIO", 10.0)
        build(load_device(folder), "fabricate")
    return folder


@pytest.fixture
def folder(built, tmp_path, monkeypatch):
    """A copy of the built device, which must not search again."""
    shutil.copytree(built, tmp_path / "bar")
    monkeypatch.setattr(choose_layout, "FEWER_PARTS_ERROR_RATIO", 10.0)

    def refuse(*_):
        raise AssertionError("a search was made")

    monkeypatch.setattr(stage_optimize, "_search_decoders", refuse)
    return tmp_path / "bar"


def test_another_layout_is_taken_and_the_default_comes_back(folder):
    device, build_folder = load_device(folder), folder / "build"
    default, paths = load_layout(build_folder), load_weighed(build_folder)
    offers = {record.parts: record for record in offered_layouts(default.weighed, "simple")}
    assert len(offers) > 1
    chosen = next(w for w in default.weighed if w.chosen)
    assert chosen.parts == min(offers)
    other = max(offers)

    result = build(device, "fabricate", options=BuildOptions(parts=other))
    assert result.made == ("optimize", "fabricate")
    taken = load_layout(build_folder)
    index = next(k for k, w in enumerate(taken.weighed) if w.chosen)
    assert taken.weighed[index].parts == other
    assert len(result.results.manifest.parts) == other
    assert taken.prediction.unseen == pytest.approx(offers[other].built)
    stored = [p.control_points.tolist() for p in paths.layouts[index]]
    assert [c.control_points.tolist() for c in taken.sensors] == stored
    assert [w.built for w in taken.weighed] == [w.built for w in default.weighed]
    assert first_outdated(device, "fabricate") is None
    assert recorded_options(device, build_folder) == BuildOptions(parts=other)
    assert build(device, "optimize").made == ()  # the option of the parts remains

    shutil.rmtree(folder / ".build-kept")  # has the default layout, too
    assert build(device, "fabricate").made == ("optimize", "fabricate")
    back = load_layout(build_folder)
    assert [c.points.tolist() for c in back.sensors] == [c.points.tolist() for c in default.sensors]
    assert (back.weighed, back.band, back.starts) == (default.weighed, default.band, default.starts)


def test_device_toml_may_state_the_number(folder):
    device = load_device(folder)
    offers = find_offers(device, load_layout(folder / "build"))
    other = next(offer for offer in offers if not offer.is_chosen)
    assert other.hours > 1
    path = folder / "device.toml"
    path.write_text(path.read_text("utf-8") + f"parts = {other.parts}\n")
    build(load_device(folder), "optimize")
    now = find_offers(device, load_layout(folder / "build"))
    assert [(o.parts, o.error, o.hours) for o in now] == [
        (o.parts, o.error, o.hours) for o in offers
    ]
    assert [o.parts for o in now if o.is_chosen] == [other.parts]


def test_a_number_that_is_not_offered_is_refused_and_the_build_stays(folder):
    device = load_device(folder)
    before = (folder / "build" / "layout.json").read_bytes()
    offered = [o.parts for o in find_offers(device, Build(folder / "build").layout)]
    with raises(LayoutError, "parts-not-offered", parts=90, offered=offered):
        build(device, "fabricate", options=BuildOptions(parts=90))
    assert (folder / "build" / "layout.json").read_bytes() == before
    assert first_outdated(device, "fabricate") is None
