"""The path from Python values to predicted errors, beside what the command line makes of them."""

import os
import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from threading import Timer

import numpy as np
import pytest
import tomlkit

import defsense_fab as df
from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import parse_device
from defsense_fab.core.mesh import Surface
from defsense_fab.store.body import load_surface
from defsense_fab.store.fields import load_fields
from defsense_fab.store.layout import layout_hash, load_layout, load_prediction
from defsense_fab.store.manifest import load_manifest
from defsense_fab.store.mesh import load_mesh
from defsense_fab.training.models import train_device
from tests.support.places import ROOT
from tests.workflow.conftest import small_bar


def test_results_are_those_of_the_command_line_to_the_last_digit(device, poses, layout, saved):
    build = saved / "build"
    fields, made, told = load_fields(build), load_layout(build), load_prediction(build)
    assert poses.names == fields.names
    np.testing.assert_array_equal(poses.displacements, fields.displacements)
    assert layout.prediction == made.prediction
    np.testing.assert_array_equal(layout.signals, told.signals)
    np.testing.assert_array_equal(layout.errors, told.errors)
    parts = df.fabricate(layout)
    assert parts.prediction == load_manifest(build).prediction
    assert sum(s.volume for s in parts.surfaces.values()) < poses.surface.volume
    assert df.Device.load(saved).text == device.text


def test_only_build_writes_into_the_device_s_folder(device, tmp_path):
    loaded = device.save(tmp_path / "small")
    before = sorted((tmp_path / "small").rglob("*"))
    folder = loaded.record.source
    loaded.results("body")
    assert (folder / "build").is_dir()
    assert sorted((tmp_path / "small").rglob("*")) == before
    assert loaded.build("mesh") == tmp_path / "small" / "build"
    surface, mesh = load_surface(loaded.build("mesh")), load_mesh(loaded.build("mesh"))
    assert sum(mesh.volumes) == pytest.approx(surface.volume, rel=1e-3)
    with pytest.raises(df.DefsenseError, match="until 'meshes': there is no such stage"):
        loaded.build("meshes")
    del loaded
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


def test_a_cord_s_signals_are_told_by_its_model_of_a_twin(twin, model):
    run = twin.recordings[0]
    assert 0 < model.test_rmse < 10
    said = model.predict(run.sample_time, run.ohm, run.rest)
    assert said.shape == (len(run.sample_time), 10, 3)
    with pytest.raises(df.DefsenseError, match="1 channels: top"):
        model.predict(run.sample_time, run.ohm[:, [0, 0]], run.rest)


def test_a_model_of_sessions_is_byte_for_byte_that_of_the_command(
    layout, saved, sessions, tmp_path, monkeypatch
):
    class Clock:
        """All models are written at the same time."""

        @staticmethod
        def now(zone):
            return datetime(2026, 1, 1, tzinfo=zone)

    monkeypatch.setattr(train_device, "datetime", Clock)
    command, python = tmp_path / "command.json", tmp_path / "python.json"
    words = ["train", *map(str, sessions), "--device", str(saved), "--decoder", "quadratic"]
    assert main([*words, "--shift", "auto", "--out", str(command)]) == 0
    data = df.load_sessions(*sessions)
    model = df.train(data, layout, decoder="quadratic", shift="auto")
    model.save(python)
    assert python.read_bytes() == command.read_bytes()
    assert len(data.recordings) == 2
    assert df.Model.load(python).record.layout == layout_hash(layout.record)


def test_a_surface_follows_its_markers(poses, layout, model):
    vertices, faces = poses.displaced(model.rest_positions), poses.surface.faces
    pictures = np.concatenate([vertices, np.full_like(vertices[:1], np.nan)])
    pictures[0, 3] = np.nan  # one marker that is not seen
    made = model.surface(pictures, layout)
    assert made.vertices.shape == (len(pictures), *made.rest.shape)
    assert made.faces.max() == len(made.rest) - 1
    assert len(made.faces) >= len(faces)
    true = poses.displaced(made.rest)
    moved = np.sqrt(np.mean((true - made.rest) ** 2))
    assert np.sqrt(np.mean((made.vertices[:-1] - true) ** 2)) < 0.1 * moved
    assert np.isnan(made.vertices[-1]).all()


def test_a_model_runs_live_until_its_loop_is_left_and_its_readings_play_again(
    layout, model, tmp_path
):
    before, kept, frames = threading.active_count(), tmp_path / "kept", []
    run = df.live(model, layout, port="twin:minutes=1,seed=3", record=kept)
    for frame in run:
        frames.append(frame)
        if frame.time > 2.5 and frame.vertices is not None:
            break
    assert run.closed
    assert threading.active_count() == before
    assert [f.number for f in frames] == sorted({f.number for f in frames})
    assert frames[-1].quality == "trusted"
    still = model.surface(frames[-1].markers[None], layout)
    np.testing.assert_array_equal(run.faces, still.faces)
    assert np.abs(still.vertices[0] - frames[-1].vertices).max() < 1.0
    with pytest.raises(df.DefsenseError, match="this run is closed"):
        next(iter(run))
    with df.live(model, port=f"replay:{kept / 'board.csv'}") as again:
        played = list(again)
    assert played[-1].vertices is None
    # On a busy machine readings are kept after the last frame that was taken.
    assert min(np.abs(p.markers - frames[-1].markers).max() for p in played) < 0.5
    assert threading.active_count() == before


def test_ctrl_c_ends_a_live_run(layout, model):
    before = threading.active_count()
    run = df.live(model, layout, port="twin:minutes=1,seed=3", surface=None)
    # A shell's background processes ignore SIGINT.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        Timer(0.3, signal.raise_signal, [signal.SIGINT]).start()
        with pytest.raises(KeyboardInterrupt):
            for _ in run:
                pass
    finally:
        signal.signal(signal.SIGINT, handler)
    assert run.closed
    assert threading.active_count() == before


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"material": "foam"}, "unknown material 'foam'"),
        ({"body": 3}, "body: must be a path, .* not 3"),
        ({"edge_length": float("nan")}, "edge_length: must be a number, not nan"),
        ({"values": {"cord.noize": 1.0}}, "did you mean 'noise'"),
        ({"regions": {"base": 3}}, "regions.base: must be made by box"),
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
    assert (made.record.source / "sizes.py").is_file()
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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m, la: m.surface(np.zeros((10, 3)), la), r"must have shape \(t, 10, 3\)"),
        (lambda m, la: m.surface([["a"]], la), "array of numbers"),
        (lambda m, la: m.surface(np.full((1, 10, 3), np.inf), la), "must not be infinite"),
        (lambda m, la: m.surface(np.zeros((1, 10, 3)), la, "soft"), "mode 'soft': is unknown"),
        (
            lambda m, la: m.surface(np.zeros((1, 10, 3)), la.poses),
            "must be a Layout, not a Simulation",
        ),
        (lambda m, la: df.live(other(m, device="cube"), la, port="twin"), "of another device"),
        (lambda m, la: df.live(other(m, layout="0"), la, port="twin"), "of other cords"),
        (
            lambda m, la: df.live("model.json", la, port="twin"),
            "a Model, not 'model.json'; give that",
        ),
        (lambda m, la: df.live(m, port="twin"), "a twin needs the layout"),
        (lambda m, la: df.live(m, la, port="twin:speed=2"), "twin:speed=2: write twin:unit=1"),
        (lambda m, la: df.live(m, la, port="/dev/none"), "/dev/none: "),
        (lambda m, la: df.live(m, la, port="replay:none.csv"), "none.csv: no such recording"),
        (lambda m, la: df.live(m, la, port=3), "port 3: must be text"),
        (
            lambda m, la: df.live(m, la, port="twin", rate=5),
            "a whole number from 10 to 500, not 5",
        ),
        (lambda m, la: df.live(m, la, port="twin", surface="soft"), "surface 'soft': is unknown"),
        (
            lambda m, la: df.live(m, la, port="twin", rest_resistances=[1, 2]),
            "rest_resistances: must be 1 numbers above 0, in ohm, of top",
        ),
        (lambda m, la: df.train(3, la), "data: must be a Dataset, not 3"),
        (lambda m, la: df.load_sessions("none"), "none: there is no such file or folder"),
    ],
)
def test_bad_calls_of_models_are_told(layout, model, call, message):
    before = threading.active_count()
    with pytest.raises(df.DefsenseError, match=message):
        call(model, layout)
    assert threading.active_count() == before


def other(model, **changes):
    return replace(model, record=replace(model.record, **changes))


def test_the_blocks_of_its_page_run_in_their_order(twin, saved, sessions, tmp_path, monkeypatch):
    """With a small device in place of the bar, and a minute of its twin in place of two."""
    page = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert len(blocks) == page.count("```python") == 11
    monkeypatch.chdir(tmp_path)
    Path("fixtures/devices").mkdir(parents=True)
    for place, folder in zip(
        ("fixtures/devices/bar", "session-1", "session-2"), (saved, *sessions), strict=True
    ):
        Path(place).symlink_to(folder)
    run = twin.recordings[0]
    ohm = np.interp(run.time, run.sample_time, run.ohm[:, 0])[:, None]
    places = np.concatenate([twin.rest_points[None], run.points[1:]])
    np.savez("taken.npz", time=run.time, ohm=ohm, positions=places)
    names = {"__name__": "page"}
    for block in blocks:
        exec(block.replace("seconds=120", "seconds=60"), names)
    assert {p.name for p in tmp_path.iterdir()} >= {"parts", "block", "model.json"}
    assert names["skin"].vertices.shape == (36, 87, 3)
    assert names["live"].closed
    assert names["frame"].quality == "trusted"
    table = tomlkit.parse(names["block"].text)
    table["poses"].extend(pose.table() for pose in names["more"])
    assert len(parse_device(tomlkit.dumps(table), tmp_path / "block").poses) == 7


def test_the_package_is_imported_without_what_is_not_used():
    code = "import sys, defsense_fab; sys.exit('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=os.environ, check=False)
    assert done.returncode == 0
    assert {"Device", "simulate", "optimize", "predict"} <= set(dir(df))


def test_types_of_what_is_returned_have_names(poses, layout, twin):
    assert isinstance(poses.surface, df.Surface)
    assert isinstance(layout.prediction, df.Prediction)
    assert isinstance(twin, df.Dataset)
    assert isinstance(twin.recordings[0], df.Recording)
