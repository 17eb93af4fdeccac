"""First devices, from those of the package and from files of bodies."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import DeviceFile, load_device
from defsense_fab.core.device.materials import default_material
from defsense_fab.core.device.states import default_states
from defsense_fab.core.errors import BodyError, DeviceError, StorageError
from defsense_fab.core.mesh import Surface
from defsense_fab.core.schema.options import options_of
from defsense_fab.core.schema.reference import commented
from defsense_fab.workflow.starts import starting_devices
from defsense_fab.workflow.starts.body_ends import find_ends
from defsense_fab.workflow.starts.body_file import (
    BodyFile,
    guess_unit,
    load_body_content,
    load_body_file,
    scale_to_size,
)
from defsense_fab.workflow.starts.first_device import (
    create_first_device,
    fill_options,
)
from defsense_fab.workflow.starts.options import (
    DEFAULT_CORD,
    DEFAULT_PROCESS,
    EXAMPLES,
    MIN_DEFAULT_CORDS,
    UNITS,
    NewOptions,
)
from defsense_fab.workflow.starts.starting_devices import STARTING_DEVICES, create_starting_device
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.places import DEVICES

BAR_START = next(s for s in STARTING_DEVICES if s.name == "bar")


def create_draft(body, folder, name="grip", unit="mm", material="tango-plus", edge_length=6.0):
    options = NewOptions(name=name, units=unit, material=material, edge_length=edge_length)
    create_first_device(body, folder, options, is_draft=True)


def bar_file(unit="mm", suffix=".stl"):
    scale = UNITS[unit]
    surface = box_surface(np.array([0, -15, -15]) / scale, np.array([150, 15, 15]) / scale)
    return BodyFile(b"content", "my-bar", suffix, surface, unit, unit != "mm", ())


def find_uncommented(text):
    """Return keys and tables without a comment at their first occurrence."""
    commented_keys = {}
    lines = text.splitlines()
    for before, line in zip(["", *lines], lines, strict=False):
        if match := re.match(r"(\w+) =|(\[\[?(?:regions|poses|sensors)\]\]?)", line):
            commented_keys.setdefault(match[1] or match[2], before.startswith("# "))
    return {key for key, is_commented in commented_keys.items() if not is_commented}


@pytest.mark.parametrize("start", STARTING_DEVICES, ids=[s.name for s in STARTING_DEVICES])
def test_starting_device_is_copied_under_another_name(start, tmp_path):
    create_starting_device(start, tmp_path / "new" / "grip", "grip")
    device = load_device(tmp_path / "new" / "grip")
    assert device.name == "grip"
    first = load_device(DEVICES / start.name)
    assert device.body.path.read_bytes() == first.body.path.read_bytes()
    text = (DEVICES / start.name / "device.toml").read_text(encoding="utf-8")
    written = (device.source / "device.toml").read_text(encoding="utf-8")
    renamed = text.replace(f'name = "{start.name}"', 'name = "grip"', 1)
    assert written == commented(renamed, DeviceFile)
    assert tomllib.loads(written) == tomllib.loads(text) | {"name": "grip"}
    assert not find_uncommented(written) - set(device.regions)
    assert len(list(device.source.iterdir())) == 2
    assert start.picture.startswith(b"\x89PNG")


def test_existing_files_are_not_overwritten(tmp_path):
    (tmp_path / "bar.py").write_text("mine")
    with raises(StorageError, "file-exists"):
        create_starting_device(BAR_START, tmp_path, "grip")
    assert (tmp_path / "bar.py").read_text("utf-8") == "mine"
    assert not (tmp_path / "device.toml").exists()


def test_folder_that_cannot_be_written_is_left_unchanged(tmp_path, monkeypatch):
    def full(path, text):
        raise StorageError("the disk is full", code="disk-full", where=path)

    monkeypatch.setattr(starting_devices, "write_text", full)
    (tmp_path / "mine").mkdir()
    for folder in (tmp_path / "x" / "y", tmp_path / "mine"):
        with raises(StorageError, "disk-full"):
            create_starting_device(BAR_START, folder, "grip")
    assert [p.name for p in tmp_path.rglob("*")] == ["mine"]  # no partial files
    (tmp_path / "file").touch()
    with pytest.raises(StorageError):
        create_starting_device(BAR_START, tmp_path / "file" / "x", "grip")


@pytest.mark.parametrize("unit", ["mm", "inch", "m"])
def test_mesh_becomes_a_device_in_mm_that_is_held_at_one_end(unit, tmp_path):
    body = bar_file(unit)
    assert body.edge_length(unit) == pytest.approx(6.0)
    create_draft(body, tmp_path, 'a "grip"', unit)
    device = load_device(tmp_path, complete=False)
    assert device.name == 'a "grip"'
    assert device.body.path.read_bytes() == b"content"
    assert device.body.scale == pytest.approx(UNITS[unit])
    assert device.material.name == "tango-plus"
    assert set(device.regions) == {"base", "tip"}
    points = np.array([[0, 0, 0], [9, 0, 0], [75, 0, 0], [141, 0, 0], [150, 0, 0]], float)
    assert device.regions["base"].contains(points).tolist() == [True, True, False, False, False]
    assert device.regions["tip"].contains(points).tolist() == [False, False, False, True, True]


def test_step_file_has_its_own_unit(tmp_path):
    create_draft(bar_file(suffix=".step"), tmp_path)
    spec = load_device(tmp_path, complete=False).body
    assert (spec.kind, spec.path.name) == ("step", "my-bar.step")


def test_filled_cavity_is_declared_in_the_device(tmp_path):
    filled = replace(
        bar_file(), repair_notes=("filled a closed cavity of 120 mm3 around (1, 2, 3)",)
    )
    create_draft(filled, tmp_path / "a")
    assert load_device(tmp_path / "a", complete=False).body.fill_cavities
    create_draft(bar_file(), tmp_path / "b")
    assert not load_device(tmp_path / "b", complete=False).body.fill_cavities


def test_invalid_devices_are_not_written(tmp_path):
    for values, error in (
        (("", "mm", "tango-plus", 6.0), DeviceError),
        (("x", "mm", "tango-plus", 0.0), DeviceError),
        (("x", "mm", "none-such", 6.0), DeviceError),
        (("x", "m", "tango-plus", 6.0), BodyError),  # 150 m
        (("x", "mile", "tango-plus", 6.0), DeviceError),
        (("x", "um", "tango-plus", 6.0), BodyError),
        (("x\ny", "mm", "tango-plus", 6.0), DeviceError),
        (("x", "mm", "tango-plus", 31.0), DeviceError),  # thicker than the body
    ):
        with pytest.raises(error):
            create_draft(bar_file(), tmp_path / "new", *values)
    for poses in (("bend", "bend"), ("modes", "bend")):
        with raises(DeviceError, "unknown-pose"):
            NewOptions(poses=poses)
    assert not (tmp_path / "new").exists()


def test_units_are_guessed_from_the_size():
    assert guess_unit(150.0) == ("mm", False)
    assert guess_unit(6.0) == ("inch", True)
    assert guess_unit(1.0) == ("inch", True)
    assert guess_unit(0.15) == ("m", True)
    assert guess_unit(15.0) == ("inch", True)  # in mm it would be too small for a cord
    assert guess_unit(900.0) == ("mm", True)
    assert guess_unit(0.15, "m") == ("m", False)
    assert guess_unit(150.0, "m") == ("mm", True)
    assert guess_unit(180_000.0) == ("um", True)
    assert guess_unit(1e7) == ("mm", True)


@pytest.mark.parametrize("format_unit", ["mm", "inch", "m"])
def test_a_mesh_is_scaled_to_a_size(format_unit, tmp_path):
    body = replace(bar_file("m"), format_unit=format_unit)
    with raises(DeviceError, "unit-doubtful"):
        fill_options(body, NewOptions())
    create_first_device(body, tmp_path, NewOptions(size=170.0, name="x"), is_draft=True)
    scale = load_device(tmp_path, complete=False).body.scale
    assert np.ptp(body.surface.vertices, axis=0) * scale == pytest.approx([170, 34, 34])


@pytest.mark.parametrize("size", [40.0, 123.456, 9000.0])
def test_scaling_to_a_size_is_repeatable(size):
    body = bar_file("um")
    once = scale_to_size(body, size)
    assert once.size(once.unit) == pytest.approx([size, size / 5, size / 5])
    assert scale_to_size(once, size) == once
    assert scale_to_size(body, None) is body


def test_sizes_are_for_meshes_without_a_unit_only():
    with raises(DeviceError, "size-not-applicable", size=100.0):
        scale_to_size(bar_file(suffix=".step"), 100.0)
    with raises(DeviceError, "options-conflict", option="size"):
        NewOptions(units="mm", size=100.0)
    for size in (0.0, 0.9, 10_001.0, float("nan"), float("inf")):
        with raises(DeviceError, "out-of-range"):
            NewOptions(size=size)
    body = scale_to_size(bar_file(), 10_000.0)
    with raises(BodyError, "body-size-impossible"):
        fill_options(body, NewOptions())


def test_repairs_of_a_scaled_mesh_are_in_the_lengths_of_the_file():
    body = replace(bar_file("inch"), repair_notes=("closed 1 hole, 2 mm wide",))
    assert "2 inch" in body.repairs("inch")[0]
    (line,) = scale_to_size(body, 100.0).repairs("mm")
    assert "mm" not in line


def test_content_that_is_no_body_is_rejected():
    with raises(BodyError, "unknown-format"):
        load_body_content("x.stl", b"import os")


def test_device_with_poses_and_cords_is_complete(tmp_path):
    options = NewOptions(name="wand", poses=("bend", "twist", "pull"))
    device = create_first_device(bar_file(), tmp_path, options)
    assert [pose.name for pose in device.poses] == ["bend", "twist", "pull"]
    assert device.propose == 3
    text = (tmp_path / "device.toml").read_text(encoding="utf-8")
    spec, given = default_states(device.poses), device.states
    assert "states" in tomllib.loads(text)
    assert (spec.ramp, spec.mixtures, spec.held_out) == (given.ramp, given.mixtures, given.held_out)
    bend, twist, pull = (pose.handles[0] for pose in device.poses)
    assert bend.rotation @ [1, 0, 0] == 0 != np.linalg.norm(bend.rotation)
    assert twist.rotation[1:].tolist() == [0, 0]
    assert pull.translation[1:].tolist() == [0, 0]
    assert 0 < pull.translation[0] < 15  # a hand does not stretch 30 x 30 mm of TPU by 10 %
    assert not find_uncommented(text) - {"base", "tip"}


def test_slanted_tapered_body_is_held_at_its_thick_end():
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
    assert high.axes[0].tolist() == [0, 0, 1]  # a standing body is held at its foot


@pytest.mark.slow
def test_files_that_a_script_imports_are_copied(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sizes.py").write_text("RADIUS = 15\n", encoding="utf-8")
    (tmp_path / "grip.py").write_text(
        "from build123d import Cylinder\nfrom sizes import RADIUS\n"
        "def body(length=110, *, more=None):\n    return Cylinder(RADIUS, length)\n",
        encoding="utf-8",
    )
    body = load_body_file(tmp_path / "grip.py")
    assert (body.parameters, list(body.others)) == ({"length": 110}, ["sizes.py"])
    create_draft(body, tmp_path / "new")
    device = load_device(tmp_path / "new", complete=False)
    assert device.body.parameters == {"length": 110}
    assert (tmp_path / "new" / "sizes.py").read_text(encoding="utf-8") == "RADIUS = 15\n"


def test_user_defined_process_needs_a_material():
    with raises(DeviceError, "unknown-material", process="my-printer"):
        default_material("my-printer")


@pytest.mark.slow
def test_only_parameters_that_can_be_passed_by_name_are_written(tmp_path):
    script = tmp_path / "bar.py"
    script.write_text(
        "from build123d import Box\n"
        "def body(length=60.0, /, width=20.0):\n    return Box(length, width, 20)\n",
        encoding="utf-8",
    )
    assert load_body_file(script).parameters == {"width": 20.0}


def test_unchanged_cord_keeps_its_noise(tmp_path):
    for name, cord in (("same", "rubber-2mm"), ("none", None)):
        create_starting_device(BAR_START, tmp_path / name, "bar", cord)
    texts = [(tmp_path / n / "device.toml").read_text(encoding="utf-8") for n in ("same", "none")]
    assert texts[0] == texts[1]


def test_help_of_new_names_the_examples_and_defaults():
    """The help is static text, since a default of None depends on the body."""
    options = options_of(NewOptions)
    assert ", ".join(EXAMPLES) in options["body"].description
    for name, default in (("cord", DEFAULT_CORD), ("process", DEFAULT_PROCESS)):
        assert f"default: {default}" in options[name].description
    assert f"at least {MIN_DEFAULT_CORDS}" in options["cords"].description


def test_choices_of_the_user_override_defaults_that_fit_the_body():
    filled = fill_options(bar_file(), NewOptions())
    assert (filled.name, filled.units, filled.edge_length) == ("my-bar", "mm", 6.0)
    assert (filled.poses, filled.material) == (("bend", "bend_side", "twist"), "ninjaflex-85a")
    options = NewOptions(name="x", poses=("pull",), process="polyjet", edge_length=5.0, cords=4)
    filled = fill_options(bar_file(), options)
    assert replace(filled, units=None, material=None, cord=None) == options
    assert filled.material == "tango-black-plus"
    with raises(DeviceError, "unit-doubtful"):
        fill_options(bar_file("inch"), NewOptions())
