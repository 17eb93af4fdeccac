"""Test that builds are repeatable, and that a mesh that is not is kept with the device."""

import json
import shutil

import pytest

from defsense_fab.cli.main import main
from defsense_fab.geometry.bodies.meshing import tetrahedra
from defsense_fab.geometry.bodies.meshing.meshers import FTETWILD
from defsense_fab.geometry.bodies.meshing.tetrahedra import plan_methods
from defsense_fab.geometry.kernels import occ
from tests.support.body_scripts import write_bar
from tests.support.places import BAR

SMALL = ("edge_length = 8.0", "edge_length = 15.0"), ("0.25, 0.5, 0.75, 1.0", "1.0")


@pytest.fixture
def device(tmp_path):
    """Return a function that writes a coarse bar into a folder with a given name."""

    def make(name, *changes):
        folder = tmp_path / name
        folder.mkdir(parents=True)
        write_bar(folder)
        text = (BAR / "device.toml").read_text("utf-8")
        for old, new in (*SMALL, *changes):
            assert old in text
            text = text.replace(old, new)
        (folder / "device.toml").write_text(
            text[: text.index("[[sensors]]")]
            + '[design]\nsensors = 1\nsearches = 2\ndecoder = "affine"\n'
        )
        return folder

    return make


def hashes(folder):
    return json.loads((folder / "build" / "mesh.json").read_text("utf-8"))["hash"]


@pytest.mark.slow
def test_two_users_get_the_same_layout(device, tmp_path, monkeypatch, capsys):
    """Each has an empty cache and a separate home; one has the solid as a STEP file."""
    made = []
    for name in ("one", "other/folder"):
        monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / f"cache-{len(made)}"))
        monkeypatch.setenv("HOME", str(tmp_path / f"home-{len(made)}"))
        folder = device(name)
        if made:
            solid = occ.read_step(made[0] / "build" / "body" / "body.step")[0]
            occ.write_step(solid, folder / "bar.step", "bar")
            text = (folder / "device.toml").read_text("utf-8")
            head, tail = text.split('script = "bar.py"\n')
            tail = tail[tail.index("\n") :]
            (folder / "device.toml").write_text(f'{head}step = "bar.step"{tail}')
        assert main(["optimize", str(folder)]) == 0
        made.append(folder)
    capsys.readouterr()
    layouts = [(f / "build" / "layout.json").read_bytes() for f in made]
    assert layouts[0] == layouts[1]
    assert not (made[0] / "device.mesh").exists()


@pytest.mark.slow
def test_mesh_that_is_not_repeatable_is_kept_with_the_device(device, tmp_path, monkeypatch, capsys):
    def last(surface, edge_length):
        return [w for w in plan_methods(surface, edge_length) if w.mesher == FTETWILD]

    monkeypatch.setattr(tetrahedra, "plan_methods", last)
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "cache"))
    first = device("first")
    assert main(["mesh", str(first)]) == 0
    assert json.loads((first / "build" / "mesh.json").read_text("utf-8"))["mesher"] == "ftetwild"
    assert (first / "device.mesh").exists()
    capsys.readouterr()
    assert main(["mesh", str(first), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["made"] == []
    # Another user gets the folder without the build.
    second = tmp_path / "second"
    shutil.copytree(first, second, ignore=shutil.ignore_patterns("build"))
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "empty"))
    before = (second / "device.mesh").read_bytes()
    assert main(["mesh", str(second)]) == 0
    assert hashes(second) == hashes(first)
    assert (second / "device.mesh").read_bytes() == before
    (second / "device.mesh").unlink()
    assert main(["mesh", str(second)]) == 0
    assert (second / "device.mesh").exists()
