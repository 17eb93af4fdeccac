"""Test the Python interface from values to a live run, and compare it with the command line."""

import ast
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
from defsense_fab.workflow.train import training
from tests.support.errors import raises
from tests.support.places import ROOT
from tests.workflow.conftest import small_bar, with_record

pytestmark = pytest.mark.slow


def test_results_equal_those_of_the_command_line(device, simulation, layout, saved):
    build = saved / "build"
    fields, record, prediction = load_fields(build), load_layout(build), load_prediction(build)
    assert simulation.names == fields.names
    np.testing.assert_array_equal(simulation.displacements, fields.displacements)
    assert layout.prediction == record.prediction
    np.testing.assert_array_equal(layout.signals, prediction.signals)
    np.testing.assert_array_equal(layout.errors, prediction.errors)
    parts = df.fabricate(layout)
    assert parts.prediction == load_manifest(build).prediction
    assert sum(s.volume for s in parts.surfaces.values()) < simulation.surface.volume
    assert df.Device.load(saved).text == device.text


def test_only_build_writes_into_the_device_folder(device, tmp_path):
    loaded = device.save(tmp_path / "small")
    before = sorted((tmp_path / "small").rglob("*"))
    folder = loaded.record.source
    loaded.results("body")
    assert (folder / "build").is_dir()
    assert sorted((tmp_path / "small").rglob("*")) == before
    assert loaded.build("mesh") == tmp_path / "small" / "build"
    surface, mesh = load_surface(loaded.build("mesh")), load_mesh(loaded.build("mesh"))
    assert sum(mesh.volumes) == pytest.approx(surface.volume, rel=1e-3)
    with raises(df.DefsenseError, "unknown-stage"):
        loaded.build("meshes")
    del loaded
    assert not folder.exists()


def test_build_of_an_unsaved_device_is_refused(device):
    with raises(df.DefsenseError, "device-unsaved"):
        device.build()


def test_prediction_depends_on_noise(layout):
    assert df.predict(layout) == layout.prediction
    noisy = df.predict(layout, noise=0.05)
    assert noisy.unseen > 1.5 * layout.prediction.unseen
    assert noisy.unseen_noise_free != noisy.unseen


def test_prediction_of_other_poses(layout, device):
    turned = device.changed({"poses.twist.handles.1.rotate.degrees": 15.0})
    states = df.simulate(turned)
    assert device.record.poses[1].handles[0].rotation[0] == pytest.approx(np.deg2rad(30))
    assert df.predict(layout, states).per_state != layout.prediction.per_state


def test_prediction_for_another_body_is_refused(layout, simulation):
    surface = simulation.surface
    other_body = replace(simulation, surface=Surface(surface.vertices + 1, surface.faces))
    with raises(df.DefsenseError, "other-body"):
        df.predict(layout, other_body)


def test_displaced_nodes_have_their_displacements(simulation):
    moved = simulation.displaced(simulation.nodes)
    np.testing.assert_allclose(moved - simulation.nodes, simulation.displacements, atol=1e-6)
    tip = simulation.displaced([[80.0, 0, 0]])[simulation.index("bend@1"), 0]
    assert tip[2] < -5  # 20 degrees about +y turn the tip downwards


def test_model_of_a_twin_decodes_its_recording(twin, model):
    run = twin.recordings[0]
    assert 0 < model.test_rmse < 10
    positions = model.predict(run.sample_time, run.ohm, run.rest)
    assert positions.shape == (len(run.sample_time), 10, 3)
    with raises(df.DefsenseError, "wrong-shape", channels=("top",)):
        model.predict(run.sample_time, run.ohm[:, [0, 0]], run.rest)


def test_model_is_evaluated_on_frames_that_it_was_not_trained_on(twin, model, layout):
    result = df.evaluate(model, twin, layout, against=[with_record(model, kind="other")])
    assert isinstance(result, df.SessionEvaluation)
    assert [m.name for m in result.models] == ["model", "against[0]"]
    total = result.models[0].evaluation.total
    assert total.rmse == pytest.approx(model.test_rmse, rel=0.05)
    assert total.frames < twin.frame_count
    all_frames = df.evaluate(model, twin, last_share=1.0)
    assert all_frames.models[0].evaluation.total.frames > total.frames


def test_exported_dataset_is_loaded_again(twin, layout, tmp_path):
    exported = df.export_dataset(twin, layout, out=tmp_path / "data")
    assert exported.dataset.frame_count == twin.frame_count
    loaded = df.load_sessions(tmp_path / "data")
    np.testing.assert_array_equal(loaded.recordings[0].ohm, twin.recordings[0].ohm)
    with raises(df.DefsenseError, "output-missing"):
        df.export_dataset(twin)


def test_model_of_sessions_equals_that_of_the_command(
    layout, saved, sessions, tmp_path, monkeypatch
):
    class Clock:
        """All models are written at the same time."""

        @staticmethod
        def now(zone):
            return datetime(2026, 1, 1, tzinfo=zone)

    monkeypatch.setattr(training, "datetime", Clock)
    command, python = tmp_path / "command.json", tmp_path / "python.json"
    arguments = ["train", *map(str, sessions), "--device", str(saved), "--decoder", "quadratic"]
    assert main([*arguments, "--shift", "auto", "--out", str(command)]) == 0
    data = df.load_sessions(*sessions)
    model = df.train(data, layout, decoder="quadratic", time_shift="auto")
    model.save(python)
    assert python.read_bytes() == command.read_bytes()
    assert len(data.recordings) == 2
    assert df.Model.load(python).record.layout == layout_hash(layout.record)


def test_surface_follows_its_markers(simulation, layout, model):
    markers, faces = simulation.displaced(model.rest_positions), simulation.surface.faces
    frames = np.concatenate([markers, np.full_like(markers[:1], np.nan)])
    frames[0, 3] = np.nan  # one marker is not visible
    surface = model.surface(frames, layout)
    assert surface.vertices.shape == (len(frames), *surface.rest.shape)
    assert surface.faces.max() == len(surface.rest) - 1
    assert len(surface.faces) >= len(faces)
    true = simulation.displaced(surface.rest)
    moved = np.sqrt(np.mean((true - surface.rest) ** 2))
    assert np.sqrt(np.mean((surface.vertices[:-1] - true) ** 2)) < 0.1 * moved
    assert np.isnan(surface.vertices[-1]).all()


def test_live_run_ends_with_its_loop_and_its_recording_can_be_replayed(layout, model, tmp_path):
    before, recording, frames = threading.active_count(), tmp_path / "recording", []
    run = df.live(model, layout, port="twin:minutes=1,seed=3", record=recording)
    for frame in run:
        frames.append(frame)
        if frame.time > 2.5 and frame.vertices is not None:
            break
    assert run.closed
    assert threading.active_count() == before
    assert [f.number for f in frames] == sorted({f.number for f in frames})
    assert frames[-1].quality == "trusted"
    surface = model.surface(frames[-1].markers[None], layout)
    np.testing.assert_array_equal(run.faces, surface.faces)
    assert np.abs(surface.vertices[0] - frames[-1].vertices).max() < 1.0
    with raises(df.DefsenseError, "run-closed"):
        next(iter(run))
    with df.live(model, port=f"replay:{recording / 'board.csv'}") as replay:
        replayed = list(replay)
    assert replayed[-1].vertices is None
    # On a busy machine, readings are recorded after the last frame that was taken.
    assert min(np.abs(f.markers - frames[-1].markers).max() for f in replayed) < 0.5
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


def test_body_outside_of_its_folder_is_refused(device, tmp_path):
    device.save(tmp_path / "small")
    (tmp_path / "small" / "body.stl").rename(tmp_path / "body.stl")
    path = tmp_path / "small" / "device.toml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"body.stl"', '"../body.stl"'), encoding="utf-8")
    with raises(df.DefsenseError, "file-outside-folder"):
        df.Device.load(tmp_path / "small")


def test_script_is_saved_with_its_imports(tmp_path):
    (tmp_path / "sizes.py").write_text("LENGTH = 80.0\n", encoding="utf-8")
    (tmp_path / "bar.py").write_text(
        "from build123d import Box\nfrom sizes import LENGTH\n"
        "def body():\n    return Box(LENGTH, 20, 20)\n",
        encoding="utf-8",
    )
    device = small_bar(body=tmp_path / "bar.py")
    assert (device.record.source / "sizes.py").is_file()
    assert device.record.body.kind == "script"


def test_code_blocks_of_the_page_run_in_order(twin, saved, sessions, tmp_path, monkeypatch):
    """A small device replaces the bar, and a minute of its twin replaces two."""
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
        exec(block.replace("minutes=2", "minutes=1"), names)
    assert {p.name for p in tmp_path.iterdir()} >= {"parts", "block", "model.json"}
    frames, vertices, axes = names["skin"].vertices.shape
    assert (frames, axes) == (36, 3)
    assert vertices > 8
    assert names["live"].closed
    assert names["frame"].quality == "trusted"
    table = tomlkit.parse(names["block"].text)
    table["poses"].extend(pose.table() for pose in names["more"])
    assert len(parse_device(tomlkit.dumps(table), tmp_path / "block").poses) == 7


def test_import_of_the_package_is_light():
    code = "import sys, defsense_fab; sys.exit('numpy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], env=os.environ, check=False)
    assert result.returncode == 0
    assert {"Device", "simulate", "optimize", "predict"} <= set(dir(df))


def test_all_names_of_the_interface_can_be_loaded_and_have_types():
    tree = ast.parse((ROOT / "defsense_fab" / "__init__.py").read_text(encoding="utf-8"))
    (typed,) = [n for n in tree.body if ast.unparse(n).startswith("if TYPE_CHECKING")]
    names = {alias.asname for node in typed.body for alias in node.names}
    assert names <= set(dir(df))
    assert names == {name for name in dir(df) if public_object(getattr(df, name))}


def public_object(value):
    """Return whether a value is a class or function of the package."""
    return getattr(value, "__module__", "").startswith("defsense_fab.")


def test_results_are_of_public_types(simulation, layout, twin):
    assert isinstance(simulation.surface, df.Surface)
    assert isinstance(layout.prediction, df.Prediction)
    assert isinstance(twin, df.Dataset)
    assert isinstance(twin.recordings[0], df.Recording)
