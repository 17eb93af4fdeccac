"""Test builds of a small device by the command line, and the state after errors."""

import errno
import json
import os
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import defsense_fab as df
from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.curve import Plane
from defsense_fab.core.device import device_file
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import CaptureError, DeviceError, StorageError
from defsense_fab.core.markers import read_markers
from defsense_fab.core.response import ResponseSpec
from defsense_fab.core.storage.files import storage_errors
from defsense_fab.geometry.kernels import occ, triangle_kernel
from defsense_fab.optimization.prediction.design_task import load_task
from defsense_fab.optimization.refinement.refine import OptimizedLayout
from defsense_fab.sensing.voltage_divider import choose_reference
from defsense_fab.store.build import Build
from defsense_fab.store.layout import load_layout
from defsense_fab.store.manifest import load_manifest, load_part
from defsense_fab.training.fitting.model_file import load_model, write_model
from defsense_fab.workflow.build import stage_fabricate, stage_report
from defsense_fab.workflow.build.stage_optimize import as_stored, warn_uncalibrated_strains
from tests.support.errors import raises
from tests.support.places import BAR


def snapshot(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    """Return a coarse bar with two cords, built once."""
    folder = tmp_path_factory.mktemp("device") / "bar"
    folder.mkdir()
    shutil.copy(BAR / "bar.py", folder)
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace("edge_length = 8.0", "edge_length = 15.0")
    text = text.replace("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]")
    text = text[: text.rindex("[[sensors]]")] + "[design]\nsearches = 1\n"
    (folder / "device.toml").write_text(text)
    assert main(["build", str(folder)]) == 0
    return folder


@pytest.fixture
def copy(device, tmp_path):
    shutil.copytree(device, tmp_path / "bar")
    return tmp_path / "bar"


def change(folder, old, new):
    path = folder / "device.toml"
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.slow
def test_cadquery_body_gives_the_same_surface_mesh_and_solid(device, tmp_path):
    """All later stages depend on these alone."""
    folder = tmp_path / "other"
    folder.mkdir()
    shutil.copy(device / "device.toml", folder)
    shutil.copy(BAR.parent / "bar-cadquery" / "bar.py", folder)
    assert main(["mesh", str(folder)]) == 0
    one, other = (Build(f / "build") for f in (device, folder))
    np.testing.assert_allclose(one.surface.vertices, other.surface.vertices, atol=1e-9)
    np.testing.assert_array_equal(one.surface.faces, other.surface.faces)
    assert one.mesh_record.hash == other.mesh_record.hash
    solids = one.solid, other.solid
    assert occ.volume(solids[0]) == pytest.approx(occ.volume(solids[1]), rel=1e-9)
    assert occ.centroid(solids[0]) == pytest.approx(occ.centroid(solids[1]), abs=1e-6)


@pytest.mark.slow
def test_terminal_shows_the_range_of_errors_of_unseen_states(copy, capsys):
    capsys.readouterr()
    assert main(["optimize", str(copy)]) == 0
    errors = json.loads((copy / "build" / "layout.json").read_text("utf-8"))["prediction"][
        "held_out"
    ]
    error_range = f"{min(errors.values()):.2f} to {max(errors.values()):.2f}"
    row = next(x for x in capsys.readouterr().out.splitlines() if "best state to worst" in x)
    assert error_range in row


@pytest.mark.slow
def test_layout_and_manifest_are_consistent(device):
    layout = json.loads((device / "build" / "layout.json").read_text("utf-8"))
    assert layout["prediction"]["rmse"] < layout["initial"]["rmse"] / 5
    assert layout["prediction"]["unseen_noise_free"] < layout["prediction"]["unseen"]
    assert layout["prediction"]["how"] == "held out"
    assert layout["prediction"]["tested"] == len(layout["prediction"]["held_out"]) == 4
    assert set(layout["cross_validated"]) == {"affine", "quadratic", "kernel"}
    unseen, decoder = layout["unseen"], layout["prediction"]["decoder"]
    assert unseen[decoder] == pytest.approx(layout["prediction"]["unseen"]) == min(unseen.values())
    assert 0 < layout["band"]["low"] < layout["band"]["median"] < layout["band"]["high"]
    # Each device is trained on states that are not quite those of the design.
    assert 0.8 < layout["band"]["median"] / layout["prediction"]["unseen"] < 2.5
    trained = layout["band"]["trained"]
    assert layout["band"]["median"] < trained["median"]
    assert trained["low"] < trained["median"] < trained["high"]
    families = layout["band"]["families"]
    assert families["viscoelastic"]["median"] < trained["median"] < families["hysteretic"]["median"]
    assert layout["mesh"] == json.loads((device / "build" / "mesh.json").read_text("utf-8"))["hash"]
    for s in layout["sensors"]:
        assert len(s["points"]) >= 100
        assert s["min_radius"] >= layout["limits"]["min_radius"]
        assert s["min_wall"] >= layout["limits"]["wall"]
    assert layout["min_clearance"] >= layout["limits"]["clearance"]
    manifest = json.loads((device / "build" / "parts" / "manifest.json").read_text("utf-8"))
    (tried,) = (w for w in layout["weighed"] if w["chosen"])
    assert tried["parts"] == len(manifest["parts"])
    assert tried["smallest"] == pytest.approx(min(p["volume"] for p in manifest["parts"]), rel=1e-3)
    total = 0.0
    for p in manifest["parts"]:
        surface = load_part(device / "build" / "parts" / p["stl"])
        total += triangle_kernel.to_manifold(surface, p["name"]).volume()
        assert (device / "build" / "parts" / p["step"]).exists()
    assert total + manifest["removed_volume"] == pytest.approx(manifest["body_volume"], rel=1e-3)
    for c in manifest["cords"]:
        loose = c["cut_length"] - c["slack"] - 7.0
        assert c["resistance_before"] == pytest.approx(14.5 * loose)
        assert c["prestretch"] >= 0.02
        gained = 14.5 * 2.0 * c["prestretch"] * c["sensing_length"] / (1 + c["prestretch"])
        assert c["resistance"] == pytest.approx(c["resistance_before"] + gained)
        assert c["range"][0] <= c["resistance"] <= c["range"][1]
    page = (device / "build" / "report.html").read_text("utf-8")
    # Three poses, two mixtures and the worst unseen state; cords, parts, and error against planes.
    assert page.count("data:image/png;base64,") == 3 + 2 * 6
    assert 'alt="error against planes"' in page
    least, most = (100 * layout["sensors"][0][k] for k in ("least_strain", "peak_strain"))
    assert f"<td>{least:.1f} to {most:.1f} %</td>" in page
    unseen = layout["prediction"]["held_out"].items()
    name, error = max(unseen, key=lambda item: item[1])
    assert len(unseen) > 1
    solved = json.loads((device / "build" / "fields" / "index.json").read_text("utf-8"))["states"]
    (weights,) = (s["weights"] for s in solved if s["state"] == name)
    words = " + ".join(p if w == 1 else f"{p} {100 * w:g} %" for p, w in weights.items())
    assert f"{error:.2f} mm in {words}" in page
    rows = re.findall(
        r"<tr><td>([^<]*)</td><td class=\"text\">([^<]*)</td><td[^>]*>([^<]*)</td>", page
    )
    uses = {name: use for name, _, use in rows}
    assert uses == {"rest": "fitted"} | {
        s["state"]: ("held out" if s["held_out"] else "fitted")
        + (" (proposed)" if len(s["weights"]) > 1 else "")
        for s in solved
    }
    assert ("1*bend_down+0.5*twist", "bend_down 100 %, twist 50 %") in {row[:2] for row in rows}
    # Nothing asks the network (this is a name, not an address); base64 holds no colon.
    assert set(re.findall(r"\w+://[\w./]*", page)) == {"http://www.w3.org/1999/xhtml"}
    for each in (page, (device / "build" / "guide.html").read_text("utf-8")):
        assert each.count("data-view3d-scene>") == each.count("data-view3d-numbers>") == 1
        assert len(each) < 6e6


@pytest.mark.slow
def test_layouts_are_tried_in_the_frames_of_the_file(straight):
    turn = Rotation.from_rotvec([0.3, -0.2, 0.7]).as_matrix()
    cord = straight("c", z=1.0)
    turned = replace(cord, plane=Plane(cord.plane.origin, turn @ cord.plane.axes))
    (kept,) = as_stored(OptimizedLayout((turned,), 1.0, False, (), (turned,))).sensors
    again = json.loads(json.dumps([kept.plane.normal.tolist(), kept.plane.axes[:, 0].tolist()]))
    read = Plane.from_normal(kept.plane.origin, *map(np.array, again))
    assert (read.axes == kept.plane.axes).all()
    assert kept.plane.axes == pytest.approx(turned.plane.axes, abs=1e-15)


@pytest.mark.slow
def test_resistance_in_the_cut_list_is_that_of_the_cord_as_built(device):
    """Compare with a sum over the points of the cord between its ferrules, in every state."""
    built = load_device(device)
    problem = load_task(built, Build(device / "build")).everything
    layout, manifest = load_layout(device / "build"), load_manifest(device / "build")
    for row, drawn in zip(manifest.cords, layout.sensors, strict=True):
        pockets = [e.pocket for e in row.ends]
        assert max(pockets) > 0
        sensor = drawn.sensor()
        path = sensor.plane.to_world(sensor.curve.sample(3000))
        moved = np.concatenate([path[None], problem.deform(path)])
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        strain = np.linalg.norm(np.diff(moved, axis=1), axis=2) / steps - 1
        start, end = drawn.inlets
        depth = start + np.cumsum(steps) - steps / 2  # from the first mouth
        mouth = start + steps.sum() + end
        cord = (depth > pockets[0]) & (depth < mouth - pockets[1])
        lead = sum(e.lead for e in row.ends)
        straight = sum(max(0, i - p) for i, p in zip((start, end), pockets, strict=True))
        # Unstretched length; the cord is then stretched during assembly and by the body.
        loose = steps[cord].sum() / (1 + row.prestretch)
        cord_strain = (steps[cord] * (1 + strain[:, cord])).sum(axis=1) / loose - 1
        assert cord_strain.min() > 0
        ohm = built.cord.ohm_per_mm * (loose * (1 + 2.0 * cord_strain) + straight + lead)
        assert row.resistance == pytest.approx(ohm[0], rel=2e-3, abs=2.0)  # 0.14 mm of cord
        low, high = np.array([ohm.min(), ohm.max()]) - ohm[0]
        assert row.range[0] - row.resistance == pytest.approx(low, rel=5e-3, abs=0.1)
        assert row.range[1] - row.resistance == pytest.approx(high, rel=5e-3, abs=0.1)
        assert row.reference_resistor == choose_reference(*row.range)


@pytest.mark.slow
def test_a_build_names_a_model_of_other_cords(copy, capsys):
    assert main(["train", "--device", str(copy)]) == 0
    path = copy / "model.json"
    for layout, named in ((load_model(path).layout, None), ("0" * 16, str(path))):
        write_model(path, replace(load_model(path), layout=layout))
        capsys.readouterr()
        assert main(["build", str(copy), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["model_of_other_cords"] == named
        assert main(["build", str(copy)]) == 0
        printed = " ".join(capsys.readouterr().out.split())
        assert ("on other cords" in printed) == (named is not None)


@pytest.mark.slow
def test_second_build_runs_no_stage(copy, capsys):
    before = snapshot(copy / "build")
    assert main(["build", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == []
    assert snapshot(copy / "build") == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "fact"),
    [
        ("[mesh]\n", "[mesh]\nsize = 3\n", "mesh.size"),
        ('region = "tip"', 'region = "top"', "'top'"),
        (
            "tip = { box = [[140, -16, -16], [151, 16, 16]] }",
            "tip = { box = [[240, -16, -16], [251, 16, 16]] }",
            "regions.tip",
        ),
        ("[140, -16, -16]", "[5, -16, -16]", "overlap"),
        ("[36, 0]", "[36, 17]", "leaves the body"),
        ("[36, 0]", "[36, 0], [37, 2], [38, 0]", "bends to a radius of"),
        ("origin = [0, 8, 0]", "origin = [0, 1, 0]", "come within 1.00 mm"),
        ('script = "bar.py"', 'script = "broken.py"', "broken.py:2: the script raised"),
    ],
)
def test_invalid_input_is_one_line_and_leaves_the_build(copy, capsys, old, new, fact):
    (copy / "broken.py").write_text("def body(length, width, height):\n    return 1 / 0\n")
    before = snapshot(copy / "build")
    for _ in range(2):  # cords that are locked, which a build does not repair
        change(copy, 'free = ["path", "plane"]', "free = []")
    change(copy, old, new)
    assert main(["build", str(copy)]) == 2
    lines = [x for x in capsys.readouterr().err.splitlines() if x.startswith("error: ")]
    assert len(lines) == 1
    assert fact in lines[0]
    assert snapshot(copy / "build") == before


@pytest.mark.slow
def test_pose_that_does_not_converge_is_one_line(copy, capsys):
    """Base and tip meet and are pushed into each other, so that elements between them invert."""
    before = snapshot(copy / "build")
    change(copy, "[[140, -16, -16], [151", "[[10.000001, -16, -16], [151")
    change(copy, 'translate = "free"', "translate = [-60, 0, 0]")
    assert main(["build", str(copy)]) == 2
    assert "'bend_up@1'" in capsys.readouterr().err
    assert snapshot(copy / "build") == before


@pytest.mark.slow
def test_interrupted_build_leaves_the_last_one_and_resumes(copy, capsys, monkeypatch):
    before = snapshot(copy / "build")
    change(copy, 'name = "bar"', 'name = "other"')

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as m:
        m.setattr(stage_report, "run", interrupt)
        assert main(["build", str(copy)]) == STOPPED
    assert capsys.readouterr().err.splitlines()[-1].startswith("Interrupted. ")
    assert snapshot(copy / "build") == before
    assert main(["build", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == ["report"]


@pytest.mark.slow
def test_full_disk_is_one_line(copy, capsys, monkeypatch):
    before = snapshot(copy / "build")
    change(copy, 'name = "bar"', 'name = "other"')

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(stage_fabricate, "run", full)
    assert main(["build", str(copy)]) == 2
    assert "the disk is full" in capsys.readouterr().err
    assert snapshot(copy / "build") == before


@pytest.mark.slow
def test_missing_part_is_made_again_and_other_files_are_ignored(copy, capsys):
    (copy / "notes.txt").write_text("glue on Monday")
    assert main(["build", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == []
    part = next((copy / "build" / "parts").glob("1-*.stl"))
    part.unlink()
    assert main(["build", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == ["fabricate"]
    assert part.exists()


@pytest.mark.slow
def test_other_board_changes_only_the_report(copy, capsys):
    files = [copy / "build" / name for name in ("wiring.svg", "wireviz.yml", "guide.html")]
    assert all("Arduino Nano" in file.read_text("utf-8") for file in files)
    change(copy, "[design]", '[readout]\nboard = "uno"\n\n[design]')
    assert main(["build", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == ["report"]
    assert all("Arduino Uno" in file.read_text("utf-8") for file in files)


@pytest.mark.slow
def test_recorded_session_outdates_no_stage(copy, capsys):
    run = copy / "session" / "run-1"
    run.mkdir(parents=True)
    (copy / "session" / "session.json").write_text("{}\n")
    (run / "frames.csv").write_text("frame,time\n0,0\n")
    (copy / "tracks.csv").write_text("frame,time,id\n")
    assert main(["build", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == []


@pytest.mark.slow
def test_ctrl_c_works_after_meshing(bar):
    import signal

    from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize

    # Background jobs of a shell start with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        tetrahedralize(bar, 12.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_build_folder_that_is_a_link_is_refused(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(BAR / name, tmp_path)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "build").symlink_to(tmp_path / "elsewhere")
    with raises(StorageError, "build-is-link"):
        run_command(["mesh", str(tmp_path)])


def test_error_after_ctrl_c_counts_as_an_interrupt(capsys, monkeypatch):
    """Native modules turn a KeyboardInterrupt during their import into an ImportError."""
    import signal

    def interrupt_import(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    monkeypatch.setattr(device_file, "load_device", interrupt_import)
    assert main(["build", str(BAR)]) == STOPPED
    assert capsys.readouterr().err.startswith("Interrupted. ")


def test_storage_errors_name_the_path(tmp_path):
    path = tmp_path / "nothing"
    with raises(StorageError, "file-not-found", path=path), storage_errors(tmp_path):
        path.read_bytes()


def test_set_needs_a_name_and_a_value():
    with raises(DeviceError, "override-invalid", value="length"):
        run_command(["build", str(BAR), "--set", "length"])


def test_parameters_from_the_command_line():
    from defsense_fab.core.device.device_file import load_device

    device = load_device(BAR, {"length": 180})
    assert device.body.parameters["length"] == 180
    assert np.isclose(device.mesh.edge_length, 8)


def test_strains_outside_of_the_calibrated_range_are_warnings():
    """The response of a data sheet has no range."""
    device = load_device(BAR)
    sensors = [
        SimpleNamespace(name="a", least_strain=-0.03, peak_strain=0.09),
        SimpleNamespace(name="b", least_strain=-0.05, peak_strain=0.05),
    ]
    assert warn_uncalibrated_strains(device, sensors) == {}
    spec = ResponseSpec("line", {"k": 2.0}, (-0.067, 0.067))
    device = replace(device, cord=replace(device.cord, response=spec))
    (warning,) = warn_uncalibrated_strains(device, sensors)
    assert all(fact in warning for fact in ("'a'", "-3.0%", "9.0%", "-6.7%", "6.7%"))


@pytest.mark.slow
def test_built_device_is_recorded_by_its_twin_and_processed(copy, capsys):
    """Positions and signals follow the poses of the twin."""
    markers = ["capture", "markers", str(copy), "--side", "0,-1,1", "--count", "8"]
    assert main(markers) == 0
    record = ["capture", "record", str(copy), "--cameras", "twin", "--port", "twin", "--auto"]
    record += ["--rounds", "1", "--seconds", "2", "--free", "0", "--rest", "1.5"]
    assert main(record) == 0
    with raises(CaptureError, "session-finished"):
        df.record(copy, ["twin"], "twin", rounds=1)
    capsys.readouterr()
    assert main(["capture", "process", str(copy / "session"), "--align", "all", "--json"]) == 0
    quality = json.loads(capsys.readouterr().out)
    assert quality["runs"][0]["ended"] == "all steps were shown"
    assert df.process(copy / "session", align="all").quality["runs"] == quality["runs"]
    assert quality["aligned_frames"] > 0.7
    assert not quality["skipped"]
    tracks = read_tracks(copy / "session" / "aligned.csv")
    assert len(tracks.ids) == 8
    design = read_markers(copy / "markers").centers
    moved = np.linalg.norm(tracks.points - design, axis=2)
    # Bends of 30 degrees, by what remains after alignment by all: up to 9 mm, of which a busy
    # machine's few pictures may miss the ends.
    assert np.nanmax(moved) > 3
    at_rest = tracks.time < 1.2
    assert np.nanmedian(moved[at_rest]) < 1
    rows = (copy / "session" / "signals.csv").read_text("utf-8").splitlines()
    signals = np.array([[float(c) if c else np.nan for c in r.split(",")[2:-1]] for r in rows[1:]])
    assert signals.shape[1] == 2
    # A busy machine's picture may show no tag: its frame has a row of signals and none of tracks.
    assert len(tracks.time) <= len(signals) <= len(tracks.time) + 10
    assert np.nanmax(np.abs(signals)) > 0.02
