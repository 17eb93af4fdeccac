"""What is wrong in device.toml is named by file, line and key."""

from pathlib import Path

import pytest

from defsense_fab.core.device_file import load_device
from defsense_fab.core.errors import DeviceError

BAR = Path(__file__).parents[2] / "fixtures" / "devices" / "bar"


@pytest.fixture
def edit(tmp_path):
    """Loads the bar's device.toml with one text replaced."""

    def change(old, new):
        text = (BAR / "device.toml").read_text()
        assert old in text
        (tmp_path / "device.toml").write_text(text.replace(old, new, 1))
        (tmp_path / "bar.py").write_text((BAR / "bar.py").read_text())
        return load_device(tmp_path)

    return change


def test_the_fixture_is_read(edit):
    device = edit("schema = 1", "schema = 1")
    assert [p.name for p in device.poses] == ["bend_up", "bend_down", "twist"]
    assert device.poses[0].handles[0].translation is None
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
