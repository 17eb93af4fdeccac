"""Devices begun, from those of the package and from files of bodies."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import DeviceFile, load_device
from defsense_fab.core.device.states import default_states
from defsense_fab.core.errors import BodyError, DeviceError, StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.core.schema.reference import commented
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.workflow.starts import starting_devices
from defsense_fab.workflow.starts.body_ends import find_ends
from defsense_fab.workflow.starts.dropped_body import DroppedBody, load_body_file, load_body_content
from defsense_fab.workflow.starts.first_device import FirstDevice, create_first_device, default_material
from defsense_fab.workflow.starts.starting_devices import STARTING_DEVICES, create_starting_device
from defsense_fab.workflow.starts.units import UNITS, guess_unit
from tests.conftest import box_surface
from tests.support.places import DEVICES


def dropped(unit="mm", suffix=".stl"):
    scale = UNITS[unit]
    surface = box_surface(np.array([0, -15, -15]) / scale, np.array([150, 15, 15]) / scale)
    return DroppedBody(b"content", "my-bar", suffix, surface, unit, unit != "mm", ())


def unexplained(text):
    """Keys and tables that have no comment where they first stand."""
    seen = {}
    lines = text.splitlines()
    for before, line in zip(["", *lines], lines, strict=False):
        if match := re.match(r"(\w+) =|(\[\[?(?:regions|poses|sensors)\]\]?)", line):
            seen.setdefault(match[1] or match[2], before.startswith("# "))
    return {key for key, told in seen.items() if not told}


@pytest.mark.parametrize("start", STARTING_DEVICES, ids=[s.name for s in STARTING_DEVICES])
def test_a_start_is_the_fixture_under_another_name(start, tmp_path):
    create_starting_device(start, tmp_path / "new" / "grip", "grip")
    device = load_device(tmp_path / "new" / "grip")
    assert device.name == "grip"
    first = load_device(DEVICES / start.name)
    assert device.body.path.read_bytes() == first.body.path.read_bytes()
    text = (DEVICES / start.name / "device.toml").read_text(encoding="utf-8")
    told = (device.source / "device.toml").read_text(encoding="utf-8")
    renamed = text.replace(f'name = "{start.name}"', 'name = "grip"', 1)
    assert told == commented(renamed, DeviceFile)
    assert tomllib.loads(told) == tomllib.loads(text) | {"name": "grip"}
    assert not unexplained(told) - set(device.regions)
    assert len(list(device.source.iterdir())) == 2
    assert start.picture.startswith(b"\x89PNG")


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "bar.py").write_text("mine")
    with pytest.raises(StorageError, match="is there already"):
        create_starting_device(STARTING_DEVICES[0], tmp_path, "grip")
    assert (tmp_path / "bar.py").read_text("utf-8") == "mine"
    assert not (tmp_path / "device.toml").exists()


def test_a_folder_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    def full(path, text):
        raise StorageError(f"{path}: the disk is full; free some space and run again")

    monkeypatch.setattr(starting_devices, "write_text", full)
    (tmp_path / "mine").mkdir()
    for folder in (tmp_path / "x" / "y", tmp_path / "mine"):
        with pytest.raises(StorageError, match="the disk is full"):
            create_starting_device(STARTING_DEVICES[0], folder, "grip")
    assert [p.name for p in tmp_path.rglob("*")] == ["mine"]  # nothing half-written
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="Not a directory"):
        create_starting_device(STARTING_DEVICES[0], tmp_path / "file" / "x", "grip")


@pytest.mark.parametrize("unit", ["mm", "inch", "m"])
def test_a_dropped_mesh_becomes_a_device_in_mm_held_at_one_end(unit, tmp_path):
    body = dropped(unit)
    assert body.edge_length(unit) == pytest.approx(6.0)
    create_first_device(body, tmp_path, FirstDevice('a "grip"', unit, "tango-plus", 6.0))
    device = load_device(tmp_path, complete=False)
    assert device.name == 'a "grip"'
    assert device.body.path.read_bytes() == b"content"
    assert device.body.scale == pytest.approx(UNITS[unit])
    assert device.material.name == "tango-plus"
    assert set(device.regions) == {"base", "tip"}
    points = np.array([[0, 0, 0], [9, 0, 0], [75, 0, 0], [141, 0, 0], [150, 0, 0]], float)
    assert device.regions["base"].contains(points).tolist() == [True, True, False, False, False]
    assert device.regions["tip"].contains(points).tolist() == [False, False, False, True, True]


def test_a_dropped_step_has_its_own_unit(tmp_path):
    create_first_device(dropped(suffix=".step"), tmp_path, FirstDevice("grip", "mm", "tango-plus", 6.0))
    spec = load_device(tmp_path, complete=False).body
    assert (spec.kind, spec.path.name) == ("step", "my-bar.step")


def test_a_dropped_body_whose_cavity_is_filled_says_so_in_its_device(tmp_path):
    filled = replace(dropped(), repaired=("filled a closed cavity of 120 mm3 around (1, 2, 3)",))
    create_first_device(filled, tmp_path / "a", FirstDevice("grip", "mm", "tango-plus", 6.0))
    assert load_device(tmp_path / "a", complete=False).body.fill_cavities
    create_first_device(dropped(), tmp_path / "b", FirstDevice("grip", "mm", "tango-plus", 6.0))
    assert not load_device(tmp_path / "b", complete=False).body.fill_cavities


def test_what_is_no_device_is_not_written(tmp_path):
    for values, error in (
        (("", "mm", "tango-plus", 6.0), DeviceError),
        (("x", "mm", "tango-plus", 0.0), DeviceError),
        (("x", "mm", "none-such", 6.0), DeviceError),
        (("x", "m", "tango-plus", 6.0), BodyError),  # 150 m
        (("x", "mile", "tango-plus", 6.0), DeviceError),
        (("x", "um", "tango-plus", 6.0), BodyError),
        (("x\ny", "mm", "tango-plus", 6.0), DeviceError),
        (("x", "mm", "tango-plus", 31.0), DeviceError),  # thicker than the body
        (("x", "mm", "tango-plus", 6.0, ("bend", "bend")), DeviceError),
        (("x", "mm", "tango-plus", 6.0, ("modes", "bend")), DeviceError),
    ):
        with pytest.raises(error):
            create_first_device(dropped(), tmp_path / "new", FirstDevice(*values))
    assert not (tmp_path / "new").exists()


def test_units_are_asked_for_where_they_are_doubtful():
    assert guess_unit(150.0) == ("mm", False)
    assert guess_unit(6.0) == ("inch", True)
    assert guess_unit(1.0) == ("inch", True)
    assert guess_unit(0.15) == ("m", True)
    assert guess_unit(15.0) == ("inch", True)  # too small for a cord, if it were mm
    assert guess_unit(900.0) == ("mm", True)
    assert guess_unit(0.15, "m") == ("m", False)
    assert guess_unit(150.0, "m") == ("mm", True)
    assert guess_unit(180_000.0) == ("um", True)
    assert guess_unit(1e7) == ("mm", True)


def test_an_upload_that_is_no_body_is_told_by_its_content():
    with pytest.raises(BodyError, match=r"^x: is neither STEP nor a mesh"):
        load_body_content("x.stl", b"import os")


def test_a_chosen_device_is_whole_and_says_its_states(tmp_path):
    first = FirstDevice("wand", "mm", "ninjaflex-85a", 6.0, ("bend", "twist", "pull"), cords=3)
    assert create_first_device(dropped(), tmp_path, first) == ("bend", "twist", "pull")
    device = load_device(tmp_path)
    assert device.propose == 3
    text = (tmp_path / "device.toml").read_text(encoding="utf-8")
    spec, given = default_states(device.poses), device.states
    assert "states" in tomllib.loads(text)
    assert (spec.ramp, spec.mixtures, spec.held_out) == (given.ramp, given.mixtures, given.held_out)
    bend, twist, pull = (pose.handles[0] for pose in device.poses)
    assert bend.rotation @ [1, 0, 0] == 0 != np.linalg.norm(bend.rotation)
    assert twist.rotation[1:].tolist() == [0, 0]
    assert pull.translation.tolist() == [15, 0, 0]
    assert not unexplained(text) - {"base", "tip"}


def test_a_slanted_tapered_body_is_held_at_its_thick_end_along_its_own_axis():
    surface = box_surface(np.array([0.0, -15, -10]), np.array([150.0, 15, 10]))
    x = surface.vertices
    x = x * np.where(x[:, :1] > 75, [1, 0.5, 0.5], 1.0)
    c = np.sqrt(0.5)
    turn = np.array([[c, c, 0], [-c, c, 0], [0, 0, 1]])  # the length to (1, 1, 0)
    for sign in (1, -1):
        ends = find_ends(Surface(sign * x @ turn, surface.faces[:, ::sign]))
        assert np.degrees(np.arccos(ends.axes[0] @ [sign * c, sign * c, 0])) < 3
        assert ends.size == pytest.approx([150, 30, 20], rel=0.05)
    high = find_ends(Surface(np.roll(x, 2, axis=1) * [1, 1, -1], surface.faces[:, ::-1]))
    assert high.axes[0].tolist() == [0, 0, 1]  # what stands is held at its foot


def test_every_process_has_a_material():
    assert {default_material(p) for p in read_rows("printers.csv")} <= set(read_rows("materials.csv"))


def test_a_scripts_own_files_come_along(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sizes.py").write_text("RADIUS = 15\n", encoding="utf-8")
    (tmp_path / "grip.py").write_text(
        "from build123d import Cylinder\nfrom sizes import RADIUS\n"
        "def body(length=110, *, more=None):\n    return Cylinder(RADIUS, length)\n",
        encoding="utf-8",
    )
    found = load_body_file(tmp_path / "grip.py")
    assert (found.parameters, list(found.others)) == ({"length": 110}, ["sizes.py"])
    create_first_device(found, tmp_path / "new", FirstDevice("grip", "mm", "tango-plus", 6.0))
    device = load_device(tmp_path / "new", complete=False)
    assert device.body.parameters == {"length": 110}
    assert (tmp_path / "new" / "sizes.py").read_text(encoding="utf-8") == "RADIUS = 15\n"


def test_a_process_of_ones_own_needs_its_material_told():
    with pytest.raises(DeviceError, match="say which material"):
        default_material("my-printer")


def test_only_parameters_that_can_be_given_by_name_are_written(tmp_path):
    script = tmp_path / "bar.py"
    script.write_text(
        "from build123d import Box\n"
        "def body(length=60.0, /, width=20.0):\n    return Box(length, width, 20)\n",
        encoding="utf-8",
    )
    assert load_body_file(script).parameters == {"width": 20.0}


def test_a_cord_that_is_the_starts_own_keeps_its_noise(tmp_path):
    for name, cord in (("same", "rubber-2mm"), ("none", None)):
        create_starting_device(STARTING_DEVICES[0], tmp_path / name, "bar", cord)
    told = [(tmp_path / n / "device.toml").read_text(encoding="utf-8") for n in ("same", "none")]
    assert told[0] == told[1]
