"""`device.toml` is read, and errors name the file, line and key."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.core.storage.package_data import read_rows
from tests.support.errors import raises
from tests.support.places import BAR

MATERIAL = 'name = "ninjaflex-85a"'
HANDLE = """[[poses.handles]]
region = "tip"
rotate = { axis = [0, 1, 0], degrees = -30 }
translate = "free\""""


@pytest.fixture
def edit(tmp_path):
    """Return a function that loads the bar with one text of its file replaced."""

    def change(old, new):
        text = (BAR / "device.toml").read_text("utf-8")
        assert old in text
        (tmp_path / "device.toml").write_text(text.replace(old, new, 1))
        (tmp_path / "bar.py").write_text((BAR / "bar.py").read_text("utf-8"))
        return load_device(tmp_path)

    return change


def test_the_fixture_is_read(edit):
    device = edit("schema = 1", "schema = 1")
    assert [p.name for p in device.poses] == ["bend_up", "bend_down", "twist"]
    assert np.isnan(device.poses[0].handles[0].translation).all()
    assert device.channel_diameter == pytest.approx(2.2)
    assert all(s.free == {"path", "plane"} for s in device.sensors)


@pytest.mark.parametrize(
    ("old", "new", "code", "key"),
    [
        ("edge_length = 8.0", "edge_lenght = 8.0", "key-unknown", "mesh.edge_lenght"),
        ("edge_length = 8.0", "", "key-missing", "mesh.edge_length"),
        ("[states]\nramp", "[states]\nrampp", "key-unknown", "states.rampp"),
        ('fixed = ["base"]', 'fixed = ["bse"]', "unknown-region", "poses.1.fixed"),
        ('region = "tip"', 'region = "base"', "region-fixed-and-moved", "poses.1.handles"),
        ("edge_length = 8.0", "edge_length = -1", "out-of-range", "mesh.edge_length"),
        ("edge_length = 8.0", "edge_length = " + "9" * 400, "not-finite", "mesh.edge_length"),
        ("edge_length = 8.0", "edge_length = nan", "not-finite", "mesh.edge_length"),
        ("length = 150", "length = nan", "not-finite", "body.parameters"),
        ("ramp = [0.25", "ramp = [true", "value-type", "states.ramp"),
        ("normal = [0, 0, 1]", 'normal = ["0", 0, 1]', "value-type", "sensors.1.plane.normal"),
        ("degrees = 30", "degrees = 0", "pose-without-motion", "poses.2.handles"),
        (
            'process = "fdm-tpu"', 'process = "fdm-tpu"\nlead = 1e9',
            "out-of-range", "fabrication.lead",
        ),
        ("schema = 1", "schema = true", "value-choice", "schema"),
        ("edge_length = 8.0", 'edge_length = "six"', "value-type", "mesh.edge_length"),
        ('translate = "free"', 'translate = "fre"', "value-type", "poses.1.handles.1.translate"),
        ('name = "rubber-2mm"', 'name = "rubber"', "unknown-cord", "cord.name"),
        (
            'name = "rubber-2mm"', 'name = "rubber-2mm"\nlength = [400, 100]',
            "out-of-range", "cord.length",
        ),
        (
            "[fabrication]", "length = [0, 40]\n\n[fabrication]\npockets = false",
            "cord-too-short", "cord.length",
        ),
        ("schema = 1", "schema = 9", "value-choice", "schema"),
        (
            "axis = [0, 1, 0]", "axis = [0, 0, 0]",
            "zero-vector", "poses.1.handles.1.rotate.axis",
        ),
        ('script = "bar.py"', 'script = "no.py"', "file-not-found", "body.script"),
        ("ramp = [0.25", "ramp = [0", "out-of-range", "states.ramp"),
        ("normal = [0, 0, 1]", "normal = [0, 0, 0]", "plane-invalid", "sensors.1.plane"),
        ('free = ["path", "plane"]', 'free = ["paths"]', "value-choice", "sensors.1.free"),
        (
            'free = ["path", "plane"]', 'free = ["path", "plane", "offset"]',
            "keys-exclusive", "sensors.1.free",
        ),
        (
            "base = {", "base = { sphere = { center = [0,0,0], radius = 1 }, ",
            "region-shape", "regions.base",
        ),
        ('name = "twist"', 'name = "Bend_up"', "name-repeated", "poses.3.name"),
        ('name = "twist"', 'name = "rest"', "name-repeated", "poses.3.name"),
        ('name = "twist"', 'name = "a/b"', "name-invalid", "poses.3.name"),
        ('anchor = "base"', 'anchor = "foot"', "unknown-region", "outputs.anchor"),
        ('name = "bar"', 'name = "a\\nb"', "name-invalid", "name"),
        (MATERIAL, 'shore = "95A"\npoisson_ratio = 0.48', "hardness-invalid", "material.shore"),
        (MATERIAL, 'shore = "30A"', "key-missing", "material.poisson_ratio"),
        (
            MATERIAL, 'model = "yeoh"\nc10 = 0.1\nc30 = 0\npoisson_ratio = 0.48',
            "key-missing", "material.c20",
        ),
        (
            MATERIAL, 'model = "mooney-rivlin"\nc10 = -0.1\nc01 = 0.05\npoisson_ratio = 0.48',
            "out-of-range", "material.c10",
        ),
        (MATERIAL, 'name = "x"\nmodel = "ogden"', "value-choice", "material.model"),
        (MATERIAL, 'name = "x"', "unknown-material", "material.name"),
        (MATERIAL, f"{MATERIAL}\nc10 = 1", "key-not-applicable", "material.c10"),
        ("edge_length = 8.0", "edge_length = 8.0\naccuracy = 0.01", "keys-exclusive",
         "mesh.edge_length"),
        ("edge_length = 8.0", "accuracy = 0.9", "out-of-range", "mesh.accuracy"),
        ('translate = "free"', 'translate = ["loose", 0, 0]', "value-type",
         "poses.1.handles.1.translate"),
        ("degrees = -30 }", 'degrees = "any" }', "value-type",
         "poses.1.handles.1.rotate.degrees"),
        ("rotate = { axis = [0, 1, 0], degrees = -30 }", 'rotate = "any"', "value-type",
         "poses.1.handles.1.rotate"),
        ("degrees = -30 }", "degrees = 1e200 }", "out-of-range",
         "poses.1.handles.1.rotate.degrees"),
        ('translate = "free"', "translate = [1e9, 0, 0]", "out-of-range",
         "poses.1.handles.1.translate"),
        ('fixed = ["base"]', 'fixed = ["base"]\ngravity = [0, 0, -1e200]', "out-of-range",
         "poses.1.gravity"),
        ("0.75, 1.0]", "0.75, 0.7500001, 1.0]", "state-duplicate", "states.ramp"),
        ("0.75, 1.0]", "0.75, 1.0]\nheld_out = [{ twist = 0.5 }]", "state-duplicate",
         "states.held_out"),
        ("0.75, 1.0]", "0.75, 1.0]\nmixtures = [{ twst = 0.3 }]", "unknown-pose",
         "states.mixtures.1.twst"),
        (
            MATERIAL,
            'model = "mooney-rivlin"\nc10 = 0.1\nc01 = 0.1\npoisson_ratio = 0.4\nshore = "30A"',
            "keys-exclusive", "material.shore",
        ),
        ('name = "twist"', 'name = "' + "x" * 61 + '"', "name-invalid", "poses.3.name"),
    ],
)  # fmt: skip
def test_errors_name_the_key(edit, tmp_path, old, new, code, key):
    with raises(DeviceError, code, key=key) as caught:
        edit(old, new)
    assert len(caught.value.data["errors"]) == 1
    assert "\n" not in str(caught.value)
    text = (tmp_path / "device.toml").read_text("utf-8")
    changed = text[: text.index(new.strip("\n").split("\n")[-1])].count("\n") + 1 if new else 11
    assert abs(caught.value.data["line"] - changed) <= 9  # of the key, or of what it disagrees with


def test_the_line_is_that_of_the_key(edit):
    with raises(DeviceError, "key-unknown", line=12, suggestion="edge_length"):
        edit("edge_length = 8.0", "edge_lenght = 8.0")
    with raises(DeviceError, "key-missing", line=11):
        edit("edge_length = 8.0", "")
    with raises(DeviceError, "unknown-region", line=20, choices=("base", "tip")):
        edit('fixed = ["base"]', 'fixed = ["bse"]')
    with raises(DeviceError, "toml-invalid"):
        edit("schema = 1", "schema = = 1")


def test_all_errors_are_reported_at_once(edit, tmp_path):
    edit("schema = 1", "schema = 1")
    text = (tmp_path / "device.toml").read_text("utf-8")
    text = text.replace('fixed = ["base"]', 'fixed = ["bse"]').replace('name = "rubber-2mm"', "")
    (tmp_path / "device.toml").write_text(text.replace("wall", "wal"))
    with raises(DeviceError, "key-missing", key="cord.name"):
        load_device(tmp_path)
    (tmp_path / "device.toml").write_text(text.replace("[cord]", '[cord]\nname = "rubber-2mm"'))
    with raises(DeviceError, "unknown-region") as caught:
        load_device(tmp_path)
    assert [e.data["key"] for e in caught.value.data["errors"]] == [
        "poses.1.fixed", "poses.2.fixed", "poses.3.fixed",
    ]  # fmt: skip


def test_missing_folder():
    with raises(DeviceError, "file-not-found"):
        load_device(Path("nowhere"))


@pytest.mark.parametrize(
    ("rotate", "translate", "axes", "vector", "shift"),
    [
        ('"free"', "[1, 2, 3]", 3, 0, [1, 2, 3]),
        ('{ axis = [0, 0, 2], degrees = "free" }', '["free", 0, 0]', 1, 0, [np.nan, 0, 0]),
        ("{ axis = [2, 0, 0], degrees = 270 }", '"free"', 0, 1.5 * np.pi, [np.nan] * 3),
    ],
)
def test_handles_are_free_or_prescribed_in_any_combination(
    edit, rotate, translate, axes, vector, shift
):
    gravity = "gravity = [0, 0, -1]\n"
    text = f'[[poses.handles]]\nregion = "tip"\nrotate = {rotate}\ntranslate = {translate}'
    (handle,) = edit(HANDLE, gravity + text).poses[0].handles
    assert handle.free_axes.shape == (axes, 3)
    assert np.linalg.norm(handle.free_axes, axis=1) == pytest.approx(np.ones(axes))
    assert np.linalg.norm(handle.rotation) == pytest.approx(vector)
    assert handle.translation == pytest.approx(shift, nan_ok=True)


def test_loads_are_read(edit):
    text = """gravity = [0, 0, -1]
drags = [{ at = [75, 0, 0], by = [0, 0, 9], stiffness = 0.5 }]
pressures = [{ region = "base", value = 0.01 }]
symmetry = [{ region = "base", normal = [0, 2, 0] }]
"""
    pose = edit(HANDLE, text + HANDLE).poses[0]
    assert pose.gravity == pytest.approx([0, 0, -1])
    assert pose.drags[0].stiffness == 0.5
    assert pose.pressures[0].value == 0.01
    assert pose.symmetry[0].normal == pytest.approx([0, 1, 0])


@pytest.mark.parametrize(
    ("text", "young", "model"),
    [
        ('shore = "50A"\npoisson_ratio = 0.48', 2.456, "neo-hookean"),
        ('model = "mooney-rivlin"\nc10 = 0.1\nc01 = 0.05\npoisson_ratio = 0.48', 0.888, None),
        ('model = "stable-neo-hookean"\nname = "tpu-95a"', 26, "stable-neo-hookean"),
        ("young_modulus = 2.0\npoisson_ratio = 0.4", 2.0, "neo-hookean"),
    ],
)
def test_materials_by_hardness_constants_or_name(edit, text, young, model):
    material = edit('name = "ninjaflex-85a"', text).material
    assert material.young_modulus == pytest.approx(young, rel=1e-3)
    assert material.model == (model or "mooney-rivlin")


def test_a_device_without_poses_is_incomplete(edit, tmp_path):
    edit("schema = 1", "schema = 1")
    text = (tmp_path / "device.toml").read_text("utf-8")
    start, end = text.index("[[poses]]"), text.index("[outputs]")
    (tmp_path / "device.toml").write_text(text[:start] + text[end:])
    with raises(DeviceError, "poses-missing"):
        load_device(tmp_path)
    assert load_device(tmp_path, complete=False).poses == ()


def test_every_material_row_is_usable_and_names_its_source():
    rows = read_rows("materials.csv")
    assert len(rows) >= 12
    for name, row in rows.items():
        assert 0 < float(row["young_modulus"]) < 100, name
        assert 0.4 < float(row["poisson_ratio"]) < 0.5, name
        assert 0.9 < float(row["density"]) < 1.4, name
        assert row["basis"] in ("measured", "secant", "shore"), name
        assert row["checked"] in ("test data", "secondary source", "conversion", "no"), name
        assert row["shore"], name
        assert len(row["source"]) > 40, name


@pytest.fixture
def changed(tmp_path):
    """Return a function that loads the bar with lines added to tables, by their headers."""

    def load(**tables):
        shutil.copy(BAR / "bar.py", tmp_path)
        text = (BAR / "device.toml").read_text("utf-8")
        for name, lines in tables.items():
            head = f"[{name}]\n"
            text = text.replace(head, head + lines + "\n") if head in text else text
            text = text if head in text else text.replace("[cord]", f"{head}{lines}\n\n[cord]")
        (tmp_path / "device.toml").write_text(text)
        return load_device(tmp_path)

    return load


def test_a_material_for_casting_whose_name_is_not_a_text_is_refused(tmp_path):
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace('"ninjaflex-85a"', '["x"]').replace('"fdm-tpu"', '"cast-silicone"')
    (tmp_path / "device.toml").write_text(text)
    shutil.copy(BAR / "bar.py", tmp_path)
    with raises(DeviceError, "value-type", key="material.name"):
        load_device(tmp_path)


def test_settings_of_assembly_and_readout(changed):
    device = changed()
    assert (device.fabrication.assembly, device.fabrication.prestretch) == ("held", None)
    assert (device.cord.contact, device.cord.min_stretch, device.converter) == (1, 20, "arduino")
    assert device.cord.compression == "same"
    device = changed(
        cord='contact = 0\nmin_stretch = 0\ncompression = "half"',
        fabrication='assembly = "bonded"',
        readout='converter = "ads1115"',
    )
    assert (device.cord.contact, device.cord.min_stretch, device.converter) == (0, 0, "ads1115")
    assert device.fabrication.assembly == "bonded"
    assert device.cord.response == ResponseSpec("two-slopes", {"tension": 2.0, "compression": 1.0})
    assert changed(fabrication="prestretch = 0.1").fabrication.prestretch == 0.1


@pytest.mark.parametrize(
    ("tables", "code", "key"),
    [
        ({"fabrication": 'assembly = "glued"'}, "value-choice", "fabrication.assembly"),
        (
            {"fabrication": 'assembly = "bonded"\nprestretch = 0.1'},
            "prestretch-bonded", "fabrication.prestretch",
        ),
        ({"fabrication": "prestretch = 0.6"}, "prestretch-too-large", "fabrication.prestretch"),
        ({"cord": 'compression = "double"'}, "value-choice", "cord.compression"),
        ({"cord": "contact = -1"}, "out-of-range", "cord.contact"),
        ({"fabrication": "prestretch = -0.1"}, "out-of-range", "fabrication.prestretch"),
        ({"readout": 'converter = "hx711"'}, "value-choice", "readout.converter"),
        ({"fabrication": "wire_diameter = 3"}, "wire-too-thick", "fabrication.wire_diameter"),
        ({"fabrication": "shrinkage = 0.01"}, "key-not-applicable", "fabrication.shrinkage"),
        (
            {"body": "bay = { at = [0, 0, 0] }", "fabrication": "pockets = false"},
            "bay-without-pockets", "fabrication.pockets",
        ),
        ({"body": "scale = 2"}, "key-not-applicable", "body.scale"),
        ({"body": 'mesh = "bar.stl"'}, "body-kind", "body"),
        ({"design": "sensors = 1"}, "too-few-sensors", "design.sensors"),
    ],
)  # fmt: skip
def test_settings_that_exclude_each_other_are_refused(changed, tables, code, key):
    with raises(DeviceError, code, key=key) as caught:
        changed(**tables)
    assert caught.value.data["line"] is not None
    assert len(caught.value.data["errors"]) == 1


def test_a_cord_whose_ends_are_too_long_for_a_curve_is_refused(edit):
    with raises(DeviceError, "not-finite", key="sensors.1.control_points"):
        edit("control_points = [[", "control_points = [[1e200, 1e200], [")


def test_outputs_fabrication_and_design_have_defaults(tmp_path):
    shutil.copy(BAR / "bar.py", tmp_path)
    text = (BAR / "device.toml").read_text("utf-8")
    for head, following in (("[outputs]", "[cord]"), ("[fabrication]", "[[sensors]]")):
        start = text.index(head)
        text = text[:start] + text[text.index(following, start) :]
    (tmp_path / "device.toml").write_text(text)
    device = load_device(tmp_path)
    assert (device.outputs.markers, device.fabrication.process) == (40, "fdm-tpu")
    assert (device.decoder, device.prefer) == ("auto", "simple")


def test_a_calibrated_response(tmp_path):
    """In place of the data sheet's gauge factor; errors name the line of device.toml."""
    folder = tmp_path / "bar"
    shutil.copytree(BAR, folder, ignore=shutil.ignore_patterns("build"))
    assert load_device(folder).cord.response == ResponseSpec.line(2.0)
    toml = folder / "device.toml"
    toml.write_text(toml.read_text("utf-8").replace("[cord]", '[cord]\nresponse = "response.json"'))
    with raises(DeviceError, "file-not-found", key="cord.response"):
        load_device(folder)
    spec = ResponseSpec("quadratic", {"k": 1.8, "q": 5.0}, (-0.06, 0.07))
    (folder / "response.json").write_text(json.dumps({"schema": 1, **spec.to_json()}))
    cord = load_device(folder).cord
    assert (cord.response, cord.measured) == (spec, None)
    slope = {"k_res": 1.8, "interval": [1.7, 1.9], "doubt": {"spread_assumed": 0.03}}
    pieces = [{"gain": g} for g in (0.9, 1.1, 0.9, 1.1)]
    (folder / "response.json").write_text(
        json.dumps({"schema": 1, **spec.to_json(), **slope, "pieces": pieces})
    )
    measured = load_device(folder).cord.measured
    assert (measured.file, measured.k_res, measured.interval) == ("response.json", 1.8, (1.7, 1.9))
    assert measured.spread == pytest.approx(((4 * 0.03**2 + 4 * 0.1**2) / 7) ** 0.5)
    (folder / "response.json").write_text('{"schema": 1, "model": "line"}')
    with pytest.raises(DeviceError) as caught:
        load_device(folder)
    assert caught.value.data["key"] == "cord.response"
