"""Test `defsense new`: its questions, errors and the created folder."""

from __future__ import annotations

import io
import json
from functools import cache

import numpy as np
import pytest
import trimesh

from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DefsenseError, StorageError
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.workflow.starts import body_file
from tests.support.errors import raises
from tests.support.places import DEVICES

BLOB = str(DEVICES / "blob" / "blob.stl")


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(scope="module", autouse=True)
def read_once():
    """Each file is read once by its content: that takes a process of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(body_file, "load_body_content", cache(body_file.load_body_content))
        yield


@pytest.fixture
def type_lines(monkeypatch):
    """Return a function that types lines into the terminal."""

    def replace_input(*lines):
        monkeypatch.setattr("sys.stdin", Terminal("".join(f"{line}\n" for line in lines)))

    return replace_input


def test_enter_chooses_the_first_example(type_lines, tmp_path, capsys):
    type_lines("", "")
    assert main(["new", str(tmp_path / "my bar")]) == 0
    device = load_device(tmp_path / "my bar")
    assert (device.name, device.cord.name) == ("my-bar", "rubber-2mm")
    assert f"defsense build '{tmp_path / 'my bar'}'" in capsys.readouterr().out


@pytest.mark.slow
def test_path_with_commas_and_folder_given_as_dots(type_lines, tmp_path, monkeypatch):
    body = tmp_path / "blob, second.stl"
    body.write_bytes((DEVICES / "blob" / "blob.stl").read_bytes())
    (tmp_path / "device" / "inner").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "device" / "inner")
    type_lines(str(body), "", "")
    assert main(["new", ".."]) == 0
    assert load_device(tmp_path / "device").name == "device"


@pytest.mark.slow
def test_invalid_answers_repeat_the_question(type_lines, tmp_path, capsys):
    type_lines("none.stl", BLOB, "fly", "1,3", "rope", "2")
    assert main(["new", str(tmp_path / "blob")]) == 0
    device = load_device(tmp_path / "blob")
    assert [p.name for p in device.poses] == ["bend", "twist"]
    assert device.cord.name == "rubber-1.7mm"
    assert device.propose == 3
    printed = capsys.readouterr().out
    for wrong in ("none.stl: ", "fly", "rope"):
        assert wrong in printed


def test_no_questions_with_json(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["new", str(tmp_path / "x"), "--body", BLOB, "--poses", "bend", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["poses"], data["unit"], len(data["size_mm"])) == (["bend"], "mm", 3)
    assert load_device(tmp_path / "x").fabrication.process == data["process"]


def test_one_cord_per_pose_but_at_least_three(tmp_path, capsys):
    for poses, cords in (("bend", 3), ("bend,bend_side,twist,pull", 4)):
        words = ["new", str(tmp_path / poses), "--body", BLOB, "--poses", poses, "--json"]
        assert main(words) == 0
        assert json.loads(capsys.readouterr().out)["cords"] == cords
        assert load_device(tmp_path / poses).propose == cords


def test_closed_terminal_creates_nothing(type_lines, tmp_path, capsys):
    type_lines(BLOB)
    assert main(["new", str(tmp_path / "x")]) == STOPPED
    assert capsys.readouterr().err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], "body-missing"),
        (["--body", ""], "body-missing"),
        (["--body", "none"], "body-not-found"),
        (["--body", "none.stl"], "file-not-found"),
        (["--body", str(DEVICES)], "file-is-folder"),
        (["--body", BLOB, "--units", "mile"], "unknown-unit"),
        (["--body", BLOB, "--units", "m"], "body-size-impossible"),
        (["--body", BLOB, "--units", "um"], "body-size-impossible"),
        (["--body", BLOB, "--units", "inch", "--cords", "0"], "out-of-range"),
        (["--body", BLOB, "--cords", "17"], "out-of-range"),
        (["--body", BLOB, "--size", "0.5"], "out-of-range"),
        (["--body", BLOB, "--size", "100", "--units", "mm"], "options-conflict"),
        (["--body", BLOB, "--size", "20"], "no-room-for-cord"),
        (["--body", "bar", "--size", "100"], "options-conflict"),
        (["--body", BLOB, "--poses", "fly"], "unknown-pose"),
        (["--body", BLOB, "--edge-length", "nan"], "out-of-range"),
        (["--body", BLOB, "--edge-length", "500"], "out-of-range"),
        (["--body", BLOB, "--edge-length", "0.01"], "out-of-range"),
        (["--body", BLOB, "--process", "stone"], "unknown-process"),
        (["--body", BLOB, "--process", ""], "unknown-process"),
        (["--body", BLOB, "--material", "stone"], "unknown-material"),
        (["--body", BLOB, "--material", ""], "unknown-material"),
        (["--body", BLOB, "--cord", ""], "unknown-cord"),
        (["--body", "bar", "--cord", "rope"], "unknown-cord"),
        (["--body", BLOB, "--name", " "], "name-invalid"),
        (["--body", "bar", "--name", "a\nb"], "name-invalid"),
        (["--body", "bar", "--poses", "bend"], "options-conflict"),
    ],
)
def test_invalid_options_create_nothing(words, code, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with raises(DefsenseError, code):
        run_command(["new", str(tmp_path / "x"), *words])
    assert not list(tmp_path.iterdir())


def test_an_error_is_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["new", str(tmp_path / "x"), "--body", BLOB, "--edge-length", "500"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: --edge-length: ")
    assert error.count("\n") == 1


def box(path, size):
    mesh = trimesh.creation.box(np.array(size))
    path.write_bytes(mesh.export(file_type=path.suffix[1:]))
    return str(path)


@pytest.mark.slow
def test_answers_that_do_not_fit_the_body_repeat_the_question(type_lines, tmp_path, capsys):
    body = box(tmp_path / "a small.stl", (30, 6, 4.6))
    # Neither metres nor a cord that is too thick, and the path as a terminal pastes it.
    type_lines(body.replace(" ", r"\ "), "m", "mm")
    assert main(["new", str(tmp_path / "größe")]) == STOPPED
    printed = capsys.readouterr().out
    for fact in ("4.6 mm", "rubber-2mm", "4.8 mm"):
        assert fact in printed
    body = box(tmp_path / "thin.stl", (60, 12, 4.6))
    type_lines(body, "", "rubber-2mm", "")
    assert main(["new", str(tmp_path / "größe")]) == 0
    assert "4.8 mm" in capsys.readouterr().out
    assert load_device(tmp_path / "größe").cord.name == "rubber-1.7mm"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file_unit", "given_unit", "size"),
    [("inch", "inch", 4.0), ("meter", "m", 0.1), ("meter", "mm", 100), ("millimeter", "cm", 10)],
)
def test_unit_of_3mf_file_is_used_or_overridden(file_unit, given_unit, size, tmp_path):
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.SetUnit(
        getattr(lib3mf.ModelUnit, {"inch": "Inch", "meter": "Meter"}.get(file_unit, "MilliMeter"))
    )
    box_mesh = trimesh.creation.box((size, size / 4, size / 4))
    mesh = model.AddMeshObject()
    mesh.SetGeometry(
        [lib3mf.Position(tuple(map(float, v))) for v in box_mesh.vertices],
        [lib3mf.Triangle(tuple(map(int, f))) for f in box_mesh.faces],
    )
    model.AddBuildItem(mesh, lib3mf.get_wrapper().GetIdentityTransform())
    model.QueryWriter("3mf").WriteToFile(str(tmp_path / "body.3mf"))
    body = str(tmp_path / "body.3mf")
    assert main(["new", str(tmp_path / "x"), "--body", body, "--units", given_unit]) == 0
    surface = load_body(load_device(tmp_path / "x").body).surface
    assert np.ptp(surface.vertices, axis=0)[0] == pytest.approx(100, rel=0.02)


@pytest.mark.slow
def test_file_of_unknown_unit_is_scaled_to_a_size(type_lines, tmp_path, capsys, monkeypatch):
    body = box(tmp_path / "hand.ply", (1.57, 0.5, 0.4))
    monkeypatch.setattr("sys.stdin", io.StringIO())
    words = ["new", str(tmp_path / "x"), "--body", body]
    with raises(DefsenseError, "unit-doubtful"):
        run_command(words)
    assert main([*words, "--size", "170", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["size_mm"], data["unit"]) == ([170.0, 54.14, 43.31], None)
    assert data["scale"] == pytest.approx(170 / 1.57)
    assert load_device(tmp_path / "x").body.scale == pytest.approx(data["scale"])
    type_lines("5000000", "170", "", "")  # the answer to the question for the unit
    assert main(["new", str(tmp_path / "y"), "--body", body]) == 0
    assert load_device(tmp_path / "y").body.scale == pytest.approx(data["scale"])
    assert load_body(load_device(tmp_path / "y").body).surface.bounds[1, 0] == pytest.approx(85)


def test_quoted_path(type_lines, tmp_path):
    body = box(tmp_path / "it's a body.stl", (60, 20, 20))
    type_lines("'" + body.replace("'", "'\\''") + "'", "", "")
    assert main(["new", str(tmp_path / "x")]) == 0


def test_edge_length_is_written_unchanged(tmp_path, capsys):
    words = ["new", str(tmp_path / "x"), "--body", BLOB, "--edge-length", "7.123", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["edge_length"] == 7.123
    assert load_device(tmp_path / "x").mesh.edge_length == 7.123


def test_device_has_the_name_of_its_folder(tmp_path):
    assert main(["new", str(tmp_path / "größe 2"), "--body", "bar"]) == 0
    assert load_device(tmp_path / "größe 2").name == "größe-2"


@pytest.mark.slow
def test_file_in_another_unit_than_its_format(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    body = box(tmp_path / "mm.glb", (150, 40, 40))
    words = ["new", str(tmp_path / "x"), "--body", body]
    with raises(DefsenseError, "unit-doubtful"):
        run_command(words)
    assert main([*words, "--units", "mm"]) == 0
    assert load_device(tmp_path / "x").body.scale == 0.001
    surface = load_body(load_device(tmp_path / "x").body).surface
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([150, 40, 40])
    body = box(tmp_path / "m.glb", (0.15, 0.04, 0.04))
    assert main(["new", str(tmp_path / "y"), "--body", body]) == 0
    assert load_device(tmp_path / "y").body.scale == 1


def test_existing_device_is_unchanged(tmp_path):
    (tmp_path / "device.toml").write_text("mine", encoding="utf-8")
    with raises(StorageError, "device-exists"):
        run_command(["new", str(tmp_path), "--body", "bar"])
    assert (tmp_path / "device.toml").read_text(encoding="utf-8") == "mine"
