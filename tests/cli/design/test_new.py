"""`defsense new`: what it asks, refuses and leaves."""

from __future__ import annotations

import io
import json
from functools import cache

import numpy as np
import pytest
import trimesh

from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.cli.main import main
from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.workflow.starts import dropped_body
from tests.support.places import DEVICES

BLOB = str(DEVICES / "blob" / "blob.stl")


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(scope="module", autouse=True)
def read_once():
    """Each file is read once by its content: that takes a process of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dropped_body, "load_body_content", cache(dropped_body.load_body_content))
        yield


@pytest.fixture
def typed(monkeypatch):
    def give(*lines):
        monkeypatch.setattr("sys.stdin", Terminal("".join(f"{line}\n" for line in lines)))

    return give


def test_enter_takes_the_first_device_of_the_gallery(typed, tmp_path, capsys):
    typed("", "")
    assert main(["new", str(tmp_path / "my bar")]) == 0
    device = load_device(tmp_path / "my bar")
    assert (device.name, device.cord.name) == ("my-bar", "rubber-2mm")
    assert f"defsense build '{tmp_path / 'my bar'}'" in capsys.readouterr().out


def test_a_path_may_have_commas_and_the_folder_points(typed, tmp_path, monkeypatch):
    body = tmp_path / "blob, second.stl"
    body.write_bytes((DEVICES / "blob" / "blob.stl").read_bytes())
    (tmp_path / "device" / "inner").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "device" / "inner")
    typed(str(body), "", "")
    assert main(["new", ".."]) == 0
    assert load_device(tmp_path / "device").name == "device"


def test_wrong_answers_are_told_and_asked_again(typed, tmp_path, capsys):
    typed("none.stl", BLOB, "fly", "1,3", "rope", "2")
    assert main(["new", str(tmp_path / "blob")]) == 0
    device = load_device(tmp_path / "blob")
    assert [p.name for p in device.poses] == ["bend", "twist"]
    assert device.cord.name == "rubber-1.7mm"
    assert device.propose == 3
    told = capsys.readouterr().out
    for part in ("none.stl: ", "fly", "cord rope: there is"):
        assert part in told


def test_flags_ask_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["new", str(tmp_path / "x"), "--body", BLOB, "--poses", "bend", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["poses"], told["unit"], len(told["size_mm"])) == (["bend"], "mm", 3)
    assert load_device(tmp_path / "x").fabrication.process == told["process"]


def test_there_are_as_many_cords_as_poses_and_three_at_least(tmp_path, capsys):
    for poses, cords in (("bend", 3), ("bend,bend_side,twist,pull", 4)):
        words = ["new", str(tmp_path / poses), "--body", BLOB, "--poses", poses, "--json"]
        assert main(words) == 0
        assert json.loads(capsys.readouterr().out)["cords"] == cords
        assert load_device(tmp_path / poses).propose == cords


def test_a_terminal_that_closes_leaves_nothing(typed, tmp_path, capsys):
    typed(BLOB)
    assert main(["new", str(tmp_path / "x")]) == STOPPED
    assert "stopped; nothing was written" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "--body: give one of bar"),
        (["--body", "none"], "none: is no file, and none of bar"),
        (["--body", "none.stl"], "none.stl: "),
        (["--body", str(DEVICES)], "is a folder"),
        (["--body", BLOB, "--units", "mile"], "mile"),
        (["--body", BLOB, "--units", "m"], "metres"),
        (["--body", BLOB, "--units", "um"], "micrometres"),
        (["--body", BLOB, "--units", "inch", "--cords", "0"], "--cords 0"),
        (["--body", BLOB, "--poses", "fly"], "fly"),
        (["--body", BLOB, "--process", "stone"], "process stone"),
        (["--body", BLOB, "--edge-length", "nan"], "nan mm"),
        (["--body", BLOB, "--edge-length", "500"], "500 mm"),
        (["--body", BLOB, "--edge-length", "0.01"], "(a million elements)"),
        (["--body", BLOB, "--material", "stone"], "material stone: there is"),
        (["--body", BLOB, "--cords", "17"], "--cords 17: give a number from 1 to 16"),
        (["--body", BLOB, "--name", " "], "--name ' ': give one line of letters"),
        (["--body", BLOB, "--cord", ""], "cord : there is"),
        (["--body", BLOB, "--material", ""], "material : there is"),
        (["--body", BLOB, "--process", ""], "process : there is"),
        (["--body", ""], "--body: give one of bar"),
        (["--body", "bar", "--name", "a\nb"], "one line of letters"),
        (["--body", "bar", "--poses", "bend"], "comes with its own"),
        (["--body", "bar", "--cord", "rope"], "cord rope"),
    ],
)
def test_what_cannot_be_is_one_line(words, told, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["new", str(tmp_path / "x"), *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert told in error
    assert not list(tmp_path.iterdir())


def box(path, size):
    made = trimesh.creation.box(np.array(size))
    path.write_bytes(made.export(file_type=path.suffix[1:]))
    return str(path)


def test_answers_that_do_not_suit_the_body_are_asked_again(typed, tmp_path, capsys):
    body = box(tmp_path / "a small.stl", (30, 6, 4.6))
    # Neither metres nor a cord that is too thick, and the path as a terminal pastes it.
    typed(body.replace(" ", r"\ "), "m", "mm")
    assert main(["new", str(tmp_path / "größe")]) == STOPPED
    told = capsys.readouterr().out
    for part in ("30,", "4.6 mm", "rubber-2mm", "4.8 mm"):
        assert part in told
    body = box(tmp_path / "thin.stl", (60, 12, 4.6))
    typed(body, "", "rubber-2mm", "")
    assert main(["new", str(tmp_path / "größe")]) == 0
    assert "cord rubber-2mm with its walls takes 4.8 mm" in capsys.readouterr().out
    assert load_device(tmp_path / "größe").cord.name == "rubber-1.7mm"


@pytest.mark.parametrize(
    ("says", "meant", "size"),
    [("inch", "inch", 4.0), ("meter", "m", 0.1), ("meter", "mm", 100), ("millimeter", "cm", 10)],
)
def test_3mf_files_are_in_the_unit_that_they_say_or_another(says, meant, size, tmp_path):
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.SetUnit(
        getattr(lib3mf.ModelUnit, {"inch": "Inch", "meter": "Meter"}.get(says, "MilliMeter"))
    )
    made = trimesh.creation.box((size, size / 4, size / 4))
    mesh = model.AddMeshObject()
    mesh.SetGeometry(
        [lib3mf.Position(tuple(map(float, v))) for v in made.vertices],
        [lib3mf.Triangle(tuple(map(int, f))) for f in made.faces],
    )
    model.AddBuildItem(mesh, lib3mf.get_wrapper().GetIdentityTransform())
    model.QueryWriter("3mf").WriteToFile(str(tmp_path / "body.3mf"))
    words = ["new", str(tmp_path / "x"), "--body", str(tmp_path / "body.3mf"), "--units", meant]
    assert main(words) == 0
    made = load_body(load_device(tmp_path / "x").body).surface
    assert np.ptp(made.vertices, axis=0)[0] == pytest.approx(100, rel=0.02)


def test_a_quoted_path_is_taken(typed, tmp_path):
    body = box(tmp_path / "it's a body.stl", (60, 20, 20))
    typed("'" + body.replace("'", "'\\''") + "'", "", "")
    assert main(["new", str(tmp_path / "x")]) == 0


def test_a_given_edge_length_is_written_as_it_is(tmp_path, capsys):
    words = ["new", str(tmp_path / "x"), "--body", BLOB, "--edge-length", "7.123", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["edge_length"] == 7.123
    assert load_device(tmp_path / "x").mesh.edge_length == 7.123


def test_a_device_is_called_as_its_folder(tmp_path):
    assert main(["new", str(tmp_path / "größe 2"), "--body", "bar"]) == 0
    assert load_device(tmp_path / "größe 2").name == "größe-2"


@pytest.mark.slow
def test_a_file_in_another_unit_than_its_format_says_is_asked_about(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    body = box(tmp_path / "mm.glb", (150, 40, 40))
    words = ["new", str(tmp_path / "x"), "--body", body]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "in metres the body would be 150,000" in told
    assert "give --units mm" in told
    assert main([*words, "--units", "mm"]) == 0
    assert load_device(tmp_path / "x").body.scale == 0.001
    told = capsys.readouterr().out
    assert "took metres with y upwards, as GLB has them, to millimetres with z upwards" in told
    assert (
        main(["new", str(tmp_path / "y"), "--body", box(tmp_path / "m.glb", (0.15, 0.04, 0.04))])
        == 0
    )
    assert load_device(tmp_path / "y").body.scale == 1


def test_a_device_that_is_there_stays(tmp_path, capsys):
    (tmp_path / "device.toml").write_text("mine", encoding="utf-8")
    assert main(["new", str(tmp_path), "--body", "bar"]) == 2
    assert "there is a device already" in capsys.readouterr().err
    assert (tmp_path / "device.toml").read_text(encoding="utf-8") == "mine"
