"""The path from Python values to predicted errors, beside what the command line makes of them."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import defsense_fab as df
from defsense_fab.cli.main import main
from defsense_fab.core.mesh import Surface
from defsense_fab.pipeline.artifacts.fields import load_fields
from defsense_fab.pipeline.artifacts.layout import load_layout, load_prediction
from defsense_fab.pipeline.artifacts.manifest import load_manifest
from tests.api.conftest import small_bar
from tests.places import BAR


def test_results_are_those_of_the_command_line_to_the_last_digit(device, poses, layout, tmp_path):
    saved = device.save(tmp_path / "small")
    assert main(["fabricate", str(tmp_path / "small")]) == 0
    build = tmp_path / "small" / "build"
    fields, made, told = load_fields(build), load_layout(build), load_prediction(build)
    assert poses.names == fields.names
    np.testing.assert_array_equal(poses.displacements, fields.displacements)
    assert layout.prediction == made.prediction
    np.testing.assert_array_equal(layout.signals, told.signals)
    np.testing.assert_array_equal(layout.errors, told.errors)
    parts = df.fabricate(layout)
    assert parts.prediction == load_manifest(build).prediction
    assert sum(s.volume for s in parts.surfaces.values()) < poses.surface.volume
    assert saved.text == device.text


def test_nothing_is_written_into_the_device_s_folder(tmp_path):
    for name in ("device.toml", "bar.py"):
        (tmp_path / name).write_bytes((BAR / name).read_bytes())
    before = sorted(tmp_path.rglob("*"))
    device = df.Device.load(tmp_path)
    folder = device.workspace.folder
    device.workspace.built(device.record, "body")
    assert (folder / "build").is_dir()
    assert sorted(tmp_path.rglob("*")) == before
    del device
    assert not folder.exists()


def test_prediction_of_given_cords(layout):
    assert df.predict(layout) == layout.prediction
    noisy = df.predict(layout, noise=0.05)
    assert noisy.unseen > 1.5 * layout.prediction.unseen
    assert noisy.unseen_noise_free != noisy.unseen


def test_prediction_of_other_poses(layout, device):
    turned = device.changed({"poses.twist.handles.1.rotate.degrees": 15.0})
    states = df.simulate(turned)
    assert device.record.poses[1].handles[0].rotation[0] == pytest.approx(np.deg2rad(30))
    assert df.predict(layout, states).per_state != layout.prediction.per_state


def test_prediction_for_another_body_is_refused(layout, device, poses):
    other = replace(poses, surface=Surface(poses.surface.vertices + 1, poses.surface.faces))
    with pytest.raises(df.DefsenseError, match="of another body"):
        df.predict(layout, other)


def test_points_follow_the_body(poses):
    moved = poses.displaced(poses.nodes)
    np.testing.assert_allclose(moved - poses.nodes, poses.displacements, atol=1e-6)
    tip = poses.displaced([[80.0, 0, 0]])[poses.index("bend@1"), 0]
    assert tip[2] < -5  # 20 degrees about +y turn the tip downwards


def test_a_cord_s_signals_are_told_by_its_model_of_a_twin(layout):
    data = df.record_twin(layout, seconds=60.0, seed=3)
    run = data.recordings[0]
    model = df.train(data, layout, in_step=True)
    assert 0 < model.test_rmse < 10
    said = model.predict(run.sample_time, run.ohm, run.rest)
    assert said.shape == (len(run.sample_time), 10, 3)
    with pytest.raises(df.DefsenseError, match="1 channels: top"):
        model.predict(run.sample_time, run.ohm[:, [0, 0]], run.rest)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"material": "foam"}, "unknown material 'foam'"),
        ({"body": 3}, "int is no body"),
        ({"edge_length": float("nan")}, "edge_length: must be a number, not nan"),
        ({"values": {"cord.noize": 1.0}}, "did you mean 'noise'"),
        ({"regions": {"base": 3}}, "regions.base: is a int"),
        ({"poses": [df.Pose("a", ["bse"], [df.Handle("tip")])]}, "did you mean 'base'"),
        ({"regions": {"base": df.box([0, 0, 0], [1, 1, 1])}, "body": "none.stl"}, "no such file"),
        ({"cords": [df.DrawnCord("a", [[1, [2]]], [0, 0, 6], [0, 0, 1], [1, 0, 0])]}, "numbers"),
        (
            {"poses": [df.Pose("a", ["base"], [df.Handle("tip", (0, 1), 3.0)])]},
            "must be 3 numbers, not of shape",
        ),
    ],
)
def test_bad_values_are_named(changes, message):
    with pytest.raises(df.DefsenseError, match=message):
        small_bar(**changes)


def test_a_body_outside_of_its_folder_is_refused(device, tmp_path):
    device.save(tmp_path / "small")
    (tmp_path / "small" / "body.stl").rename(tmp_path / "body.stl")
    path = tmp_path / "small" / "device.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"body.stl"', '"../body.stl"'), encoding="utf-8")
    with pytest.raises(df.DefsenseError, match=f"{tmp_path / 'body.stl'}: lies outside"):
        df.Device.load(tmp_path / "small")


def test_a_script_brings_what_it_imports(tmp_path):
    (tmp_path / "sizes.py").write_text("LENGTH = 80.0\n", encoding="utf-8")
    (tmp_path / "bar.py").write_text(
        "from build123d import Box\nfrom sizes import LENGTH\n"
        "def body():\n    return Box(LENGTH, 20, 20)\n",
        encoding="utf-8",
    )
    made = small_bar(body=tmp_path / "bar.py")
    assert (made.workspace.folder / "sizes.py").is_file()
    assert made.record.body.kind == "script"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda layout: layout.poses.index("bent"), "no state is called 'bent'"),
        (lambda layout: layout.poses.displaced([1, 2, 3]), r"shape \(p, 3\)"),
        (lambda layout: df.predict(layout, noise=-1.0), "must be a number above 0"),
        (lambda layout: df.predict(layout, decoder="best"), "decoder 'best'"),
        (lambda layout: layout.poses.device.build(), "is in no folder"),
        (lambda layout: layout.poses.device.changed({"cord.noise": None}), "give numbers"),
        (lambda layout: df.box([0, 0], [1, 1, 1]), "low: must be 3 finite numbers"),
        (
            lambda layout: df.dataset(
                [0, 0], [[1.0], [1]], np.zeros((2, 1, 3)), rest_resistances=[1.0],
                rest_positions=np.zeros((1, 3)), channels=["a"],
            ),
            "must increase",
        ),
    ],
)  # fmt: skip
def test_bad_calls_are_told(layout, call, message):
    with pytest.raises(df.DefsenseError, match=message):
        call(layout)


def test_the_package_is_imported_without_what_is_not_used():
    code = "import sys, defsense_fab; sys.exit('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=os.environ, check=False)
    assert done.returncode == 0
    assert {"Device", "simulate", "optimise", "predict"} <= set(dir(df))
