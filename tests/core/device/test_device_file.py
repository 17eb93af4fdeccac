"""What is wrong in device.toml is named by file, line and key."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.core.storage.package_data import read_rows
from tests.places import BAR


@pytest.fixture
def edit(tmp_path):
    """Loads the bar's device.toml with one text replaced."""

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
    ("old", "new", "message"),
    [
        (
            "edge_length = 6.0",
            "edge_lenght = 6.0",
            r"device.toml:12: mesh.edge_lenght: unknown key; did you mean 'edge_length'",
        ),
        ("edge_length = 6.0", "", r"device.toml:11: mesh.edge_length: is missing; add it"),
        ("[states]\nramp", "[states]\nrampp", r"states.rampp: unknown key; did you mean 'ramp'"),
        ('fixed = ["base"]', 'fixed = ["bse"]', r"device.toml:20: poses.1.fixed: unknown region"),
        ('region = "tip"', 'region = "base"', r"poses.1.handles: region 'base' is fixed and moved"),
        ("edge_length = 6.0", "edge_length = -1", r"must be greater than 0"),
        ("edge_length = 6.0", "edge_length = " + "9" * 400, r"edge_length: must be a number"),
        ("edge_length = 6.0", "edge_length = nan", r"edge_length: must be a number, not nan"),
        ("length = 150", "length = nan", r"parameters: length must be a finite number"),
        ("ramp = [0.25", "ramp = [true", r"states.ramp: must be any finite numbers"),
        ("normal = [0, 0, 1]", 'normal = ["0", 0, 1]', r"normal: must be 3 finite numbers"),
        ("degrees = 30", "degrees = 0", r"poses.2.handles: nothing moves"),
        (
            'process = "fdm-tpu"',
            'process = "fdm-tpu"\nlead = 1e9',
            r"fabrication: .* more than 1000",
        ),
        ("schema = 1", "schema = true", r"reads schema 1, not True"),
        ("edge_length = 6.0", 'edge_length = "six"', r"must be a number, not 'six'"),
        ('translate = "free"', 'translate = "fre"', r'must be "free" or'),
        ('name = "rubber-2mm"', 'name = "rubber"', r"unknown cord 'rubber'"),
        (
            'name = "rubber-2mm"',
            'name = "rubber-2mm"\nlength = [400, 100]',
            r"cord.length: give the least and the greatest length",
        ),
        (
            "[fabrication]",
            "length = [0, 40]\n\n[fabrication]\npockets = false",
            r"device.toml:\d+: cord.length: a piece of 40 mm is used up by its two free ends of 20",
        ),
        ("schema = 1", "schema = 9", r"reads schema 1, not 9"),
        (
            "axis = [0, 1, 0]",
            "axis = [0, 0, 0]",
            r"poses.1.handles.1.rotate.axis: must not be zero",
        ),
        ('script = "bar.py"', 'script = "no.py"', r"body.script: no such file"),
        ("ramp = [0.25", "ramp = [0", r"states.ramp: must be fractions"),
        ("normal = [0, 0, 1]", "normal = [0, 0, 0]", r"the normal must not be zero"),
        ('free = ["path", "plane"]', 'free = ["paths"]', r"unknown freedom 'paths'"),
        (
            'free = ["path", "plane"]',
            'free = ["path", "plane", "offset"]',
            r"sensors.1.free: a plane that is free may shift, too; leave out either",
        ),
        ("schema = 1", "schema = = 1", r"not valid TOML"),
        ("base = {", "base = { sphere = { center = [0,0,0], radius = 1 }, ", r"exactly one of box"),
    ],
)
def test_mistakes_are_named(edit, old, new, message):
    with pytest.raises(DeviceError, match=message) as caught:
        edit(old, new)
    assert "\n" not in str(caught.value)


def test_missing_folder():
    with pytest.raises(DeviceError, match="no such file"):
        load_device(Path("nowhere"))


HANDLE = """[[poses.handles]]
region = "tip"
rotate = { axis = [0, 1, 0], degrees = -30 }
translate = "free\""""


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
        ('model = "stable-neo-hookean"\nname = "ecoflex-00-30"', 0.12, "stable-neo-hookean"),
        ("young_modulus = 2.0\npoisson_ratio = 0.4", 2.0, "neo-hookean"),
    ],
)
def test_materials_by_hardness_constants_or_name(edit, text, young, model):
    material = edit('name = "tango-black-plus"', text).material
    assert material.young_modulus == pytest.approx(young, rel=1e-3)
    assert material.model == (model or "mooney-rivlin")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "tango-black-plus"', 'shore = "95A"\npoisson_ratio = 0.48', "outside 20A to 80A"),
        ('name = "tango-black-plus"', 'shore = "30A"', "poisson_ratio: is missing"),
        (
            'name = "tango-black-plus"',
            'model = "yeoh"\nc10 = 0.1\npoisson_ratio = 0.48',
            "c20: is missing",
        ),
        (
            'name = "tango-black-plus"',
            'model = "mooney-rivlin"\nc10 = -0.1\nc01 = 0.05\npoisson_ratio = 0.48',
            "shear modulus",
        ),
        ('name = "tango-black-plus"', 'name = "x"\nmodel = "ogden"', "unknown material model"),
        ("edge_length = 6.0", "edge_length = 6.0\naccuracy = 0.01", "give either edge_length"),
        ("edge_length = 6.0", "accuracy = 0.9", "must lie between 0.0001 and 0.2"),
        ('translate = "free"', 'translate = ["loose", 0, 0]', 'each may be "free"'),
        ("degrees = -30 }", 'degrees = "any" }', "degrees: must be a number"),
        ("rotate = { axis = [0, 1, 0], degrees = -30 }", 'rotate = "any"', "rotate: must be"),
        ("degrees = -30 }", "degrees = 1e200 }", "degrees: must be within 3600"),
        ('translate = "free"', "translate = [1e9, 0, 0]", "beyond 100000"),
        ('fixed = ["base"]', 'fixed = ["base"]\ngravity = [0, 0, -1e200]', "gravity: .* beyond"),
        ("0.75, 1.0]", "0.75, 0.7500001, 1.0]", "nearly the same"),
        ("0.75, 1.0]", "0.75, 1.0]\nheld_out = [{ twist = 0.5 }]", "there already"),
        (
            'name = "tango-black-plus"',
            'model = "mooney-rivlin"\nc10 = 0.1\nc01 = 0.1\npoisson_ratio = 0.4\nshore = "30A"',
            "shore: follows from",
        ),
    ],
)
def test_mistakes_in_materials_meshes_and_handles_are_named(edit, old, new, message):
    with pytest.raises(DeviceError, match=message):
        edit(old, new)


def test_a_device_without_poses_is_told_of_modes(edit, tmp_path):
    edit("schema = 1", "schema = 1")
    text = (tmp_path / "device.toml").read_text("utf-8")
    start, end = text.index("[[poses]]"), text.index("[outputs]")
    (tmp_path / "device.toml").write_text(text[:start] + text[end:])
    with pytest.raises(DeviceError, match="`defsense modes` proposes some"):
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
    """Loads the bar with lines added to the tables named by their headers."""

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


def test_a_material_for_casting_whose_name_is_no_text_is_refused(tmp_path):
    text = (BAR / "device.toml").read_text("utf-8")
    text = text.replace('"tango-black-plus"', '["x"]').replace('"fdm-tpu"', '"cast-silicone"')
    (tmp_path / "device.toml").write_text(text)
    shutil.copy(BAR / "bar.py", tmp_path)
    with pytest.raises(DeviceError, match=r"device.toml:\d+: material.name: must be"):
        load_device(tmp_path)


def test_how_cords_are_built_in_and_read(changed):
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
    ("tables", "message"),
    [
        ({"fabrication": 'assembly = "glued"'}, "fabrication.assembly: unknown assembly 'glued'"),
        (
            {"fabrication": 'assembly = "bonded"\nprestretch = 0.1'},
            "fabrication.prestretch: a bonded cord is glued as it lies",
        ),
        (
            {"fabrication": "prestretch = 0.6"},
            "fabrication.prestretch: the cord 'rubber-2mm' takes",
        ),
        ({"cord": 'compression = "double"'}, "cord.compression: unknown behaviour under"),
        ({"cord": "contact = -1"}, "cord.contact: must not be negative, and is -1"),
        ({"fabrication": "prestretch = -0.1"}, "fabrication.prestretch: must not be negative"),
        ({"readout": 'converter = "hx711"'}, "readout.converter: unknown converter 'hx711'"),
    ],
)
def test_what_cannot_be_built_in_is_refused(changed, tables, message):
    with pytest.raises(DeviceError, match=r"device.toml:\d+: " + message):
        changed(**tables)


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
    with pytest.raises(DeviceError, match=r"device.toml:\d+: cord.response: .*cannot be read"):
        load_device(folder)
    spec = ResponseSpec("quadratic", {"k": 1.8, "q": 5.0}, (-0.06, 0.07))
    (folder / "response.json").write_text(json.dumps({"schema": 1, **spec.to_json()}))
    cord = load_device(folder).cord
    assert (cord.response, cord.measured) == (spec, None)
    told = {"k_res": 1.8, "interval": [1.7, 1.9], "doubt": {"spread_assumed": 0.03}}
    pieces = [{"gain": g} for g in (0.9, 1.1, 0.9, 1.1)]
    (folder / "response.json").write_text(
        json.dumps({"schema": 1, **spec.to_json(), **told, "pieces": pieces})
    )
    measured = load_device(folder).cord.measured
    assert (measured.file, measured.k_res, measured.interval) == ("response.json", 1.8, (1.7, 1.9))
    assert measured.spread == pytest.approx(((4 * 0.03**2 + 4 * 0.1**2) / 7) ** 0.5)
    (folder / "response.json").write_text('{"schema": 1, "model": "line"}')
    with pytest.raises(DeviceError, match=r"device.toml:\d+: cord.response: .*not a response"):
        load_device(folder)
