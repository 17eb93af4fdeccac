"""`live.toml` and outputs given as one line."""

import socket
import subprocess
import sys

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.controls.control_spec import Shaping
from defsense_fab.runtime.outputs.live_file import open_outputs, parse_output, read_live_file
from defsense_fab.runtime.outputs.settings import (
    GamepadMapping,
    GamepadSettings,
    LslSettings,
    MidiMapping,
    MidiSettings,
    OscSettings,
    WebSocketSettings,
)
from tests.runtime.live_frames import frame, wait_for
from tests.support.errors import raises

WHOLE = """
[outputs.osc]
host = "10.0.0.2"
port = 7000
send = ["controls", "quality"]
[[outputs.midi]]
file = "a.mid"
mapping = [{ control = "bend", cc = 20, low = -1 }, { control = "bend", note = 60, channel = 10 }]
[[outputs.midi]]
device = "Synth"
[outputs.websocket]
host = "0.0.0.0"
max_clients = 5
[outputs.lsl]
[outputs.gamepad]
mapping = [{ control = "bend", axis = "x" }, { control = "twist", button = "south" }]

[controls]
twist = "twist_left - twist_right"
[controls.bend]
formula = "bend_up - bend_down"
dead_zone = 0.05
minimum = -1
smoothing = 0
invert = true
"""


@pytest.fixture
def read(tmp_path):
    def make(text):
        (tmp_path / "live.toml").write_text(text, encoding="utf-8")
        return read_live_file(tmp_path / "live.toml")

    return make


def test_a_whole_file(read):
    live = read(WHOLE)
    assert live.outputs == (
        OscSettings("10.0.0.2", 7000, send=("controls", "quality")),
        MidiSettings(
            file="a.mid",
            mapping=(MidiMapping("bend", cc=20, low=-1), MidiMapping("bend", note=60, channel=10)),
        ),
        MidiSettings(device="Synth"),
        WebSocketSettings(host="0.0.0.0", max_clients=5),
        LslSettings(),
        GamepadSettings((GamepadMapping("bend", "x"), GamepadMapping("twist", button="south"))),
    )
    twist, bend = live.controls
    assert (twist.name, twist.formula, twist.shaping) == (
        "twist", "twist_left - twist_right", Shaping(),
    )  # fmt: skip
    assert bend.formula == "bend_up - bend_down"
    assert bend.shaping == Shaping(dead_zone=0.05, minimum=-1, smoothing=0, invert=True)


def test_an_empty_file(read):
    assert read("").outputs == ()
    assert read("[outputs]\n[controls]\n").controls == ()


@pytest.mark.parametrize(
    ("text", "code", "key", "line"),
    [
        ("[outputs.osk]", "key-unknown", "outputs.osk", 1),
        ("outputs = 3", "value-type", "outputs", 1),
        ("[output.osc]", "key-unknown", "output", 1),
        ("[outputs.osc]\nprot = 1", "key-unknown", "outputs.osc.prot", 2),
        ('[outputs.osc]\nport = "9"', "value-type", "outputs.osc.port", 2),
        ("[outputs.osc]\nport = true", "value-type", "outputs.osc.port", 2),
        ("[outputs.osc]\nport = 9.5", "value-type", "outputs.osc.port", 2),
        ("[outputs.osc]\nport = 0", "out-of-range", "outputs.osc.port", 2),
        ("[outputs.osc]\nsend = 3", "value-type", "outputs.osc.send", 2),
        ('[outputs.osc]\nsend = ["all"]', "value-choice", "outputs.osc.send", 2),
        ("[outputs.osc]\nsend = []", "name-repeated", "outputs.osc.send", 2),
        ('[outputs.osc]\nsend = ["markers", "markers"]', "name-repeated", "outputs.osc.send", 2),
        ("[outputs.osc]\nrate = -1", "out-of-range", "outputs.osc.rate", 2),
        ("[outputs.osc]\npage = 0", "out-of-range", "outputs.osc.page", 2),
        ("[outputs.midi]\nchannel = 17", "out-of-range", "outputs.midi.channel", 2),
        (f'[outputs.gamepad]\nname = "{"x" * 80}"', "name-too-long", "outputs.gamepad.name", 2),
        ("[outputs.osc]\nrate = nan", "not-finite", "outputs.osc.rate", 2),
        ("[outputs.osc]\nhost = 3", "value-type", "outputs.osc.host", 2),
        ('[outputs.websocket]\ntoken = "abc"', "token-too-weak", "outputs.websocket.token", 2),
        (
            "[outputs.websocket]\nmax_clients = 0",
            "out-of-range",
            "outputs.websocket.max_clients",
            2,
        ),
        ("[outputs.websocket]\nmarkers = 1", "value-type", "outputs.websocket.markers", 2),
        ("[outputs]\nmidi = [1]", "value-type", "outputs.midi", 2),
        ('[outputs.midi]\nfile = "a"\ndevice = "b"', "keys-exclusive", "outputs.midi", 1),
        ("[outputs.midi]\nmapping = 3", "value-type", "outputs.midi.mapping", 2),
        (
            "[outputs.midi]\nmapping = [{ cc = 3 }]",
            "key-missing",
            "outputs.midi.mapping.1.control",
            2,
        ),
        (
            '[outputs.midi]\nmapping = [{ control = "a" }]',
            "keys-exclusive",
            "outputs.midi.mapping.1",
            2,
        ),
        (
            '[outputs.midi]\nmapping = [{ control = "a", cc = 1 },\n{ control = "a", cc = 120 }]',
            "out-of-range",
            "outputs.midi.mapping.2.cc",
            3,
        ),
        (
            '[outputs.midi]\nmapping = [{ control = "a", cc = 1, channel = 0 }]',
            "out-of-range",
            "outputs.midi.mapping.1.channel",
            2,
        ),
        (
            '[outputs.midi]\nmapping = [{ control = "a", cc = 1, low = 1 }]',
            "out-of-range",
            "outputs.midi.mapping.1.low",
            2,
        ),
        (
            '[outputs.midi]\nchannel = 5\nmapping = [{ control = "a", cc = 1 }]',
            "keys-exclusive",
            "outputs.midi.channel",
            2,
        ),
        (
            '[outputs.midi]\nlearn = "Knobs"\nchannel = 5',
            "keys-exclusive",
            "outputs.midi.channel",
            3,
        ),
        (
            '[outputs.gamepad]\nmapping = [{ control = "a", axis = "w" }]',
            "value-choice",
            "outputs.gamepad.mapping.1.axis",
            2,
        ),
        (
            '[outputs.gamepad]\nmapping = [{ control = "a" }]',
            "keys-exclusive",
            "outputs.gamepad.mapping.1",
            2,
        ),
        ("[controls]\nbend = 3", "value-type", "controls.bend", 2),
        ('[controls]\n"a b" = "pull"', "name-invalid", "controls.a b", 2),
        ("[controls.bend]\ncurve = 0", "out-of-range", "controls.bend.curve", 2),
        ("[controls.bend]\ndeadzone = 0", "key-unknown", "controls.bend.deadzone", 2),
    ],
)
def test_errors_name_the_line_and_the_key(read, text, code, key, line):
    with raises(OutputError, code, key=key, line=line) as caught:
        read(text)
    assert len(caught.value.data["errors"]) == 1
    assert "\n" not in str(caught.value)


def test_unknown_keys_come_with_the_closest_one(read):
    with raises(OutputError, "key-unknown", suggestion="port"):
        read("[outputs.osc]\nprot = 1")
    with raises(OutputError, "key-unknown", suggestion="dead_zone"):
        read("[controls.bend]\ndeadzone = 0")


def test_all_errors_are_reported_in_the_order_of_the_file(read):
    with raises(OutputError, "out-of-range", line=2) as caught:
        read("[outputs.osc]\nport = 0\nrate = -1\n[controls.bend]\ncurve = 0\n")
    assert [e.data["line"] for e in caught.value.data["errors"]] == [2, 3, 5]
    assert len(str(caught.value).splitlines()) == 3


def test_a_file_that_is_not_toml(read):
    with raises(OutputError, "toml-invalid"):
        read("[controls")


@pytest.mark.parametrize(
    ("kind", "values", "code", "key"),
    [
        (OscSettings, {"page": 1000}, "out-of-range", "page"),
        (MidiMapping, {"control": "bend", "cc": 120}, "out-of-range", "cc"),
        (GamepadSettings, {"name": "x" * 80}, "name-too-long", "name"),
    ],
)
def test_settings_that_a_program_makes_are_checked(kind, values, code, key):
    with raises(OutputError, code, key=key):
        kind(**values)


def test_a_file_that_is_not_there(tmp_path):
    with raises(OutputError, "file-not-found"):
        read_live_file(tmp_path / "live.toml")


@pytest.mark.parametrize(
    ("flag", "settings"),
    [
        ("osc", OscSettings()),
        ("osc,port=9001,host=10.0.0.2", OscSettings("10.0.0.2", 9001)),
        ("osc,send=markers", OscSettings(send=("markers",))),
        (
            'osc, send = ["markers", "quality"], rate=5',
            OscSettings(send=("markers", "quality"), rate=5),
        ),
        ("websocket,markers=false", WebSocketSettings(markers=False)),
        ("midi,file=my song.mid", MidiSettings(file="my song.mid")),
        ('midi,device="a,b"', MidiSettings(device="a,b")),
        (
            'midi,mapping=[{control="bend",cc=20},{control="a",note=3}]',
            MidiSettings(mapping=(MidiMapping("bend", cc=20), MidiMapping("a", note=3))),
        ),
    ],
)  # fmt: skip
def test_flags(flag, settings):
    assert parse_output(flag) == settings


@pytest.mark.parametrize(
    ("flag", "code", "facts"),
    [
        ("", "unknown-output", {"value": ""}),
        ("ocs,port=1", "unknown-output", {"suggestion": "osc"}),
        ("osc,9000", "not-key-value", {}),
        ("osc,port=1,port=2", "key-repeated", {}),
        ("osc,prot=1", "key-unknown", {"key": "osc.prot", "suggestion": "port"}),
        ("osc,port=x", "value-type", {"key": "osc.port"}),
        ("osc,port=1\nhost=3", "value-type", {"key": "osc.port"}),
        ("midi,mapping=[{control=3}]", "value-type", {"key": "midi.mapping.1.control"}),
    ],
)
def test_errors_in_one_line(flag, code, facts):
    with raises(OutputError, code, **facts):
        parse_output(flag)


def test_outputs_are_opened(tmp_path):
    """One output works; two whose port is taken report it and are tried again."""
    with socket.socket() as taken, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20)
        busy = WebSocketSettings(port=taken.getsockname()[1])
        good = OscSettings(port=receiver.getsockname()[1], send=("controls",))
        outputs = open_outputs([busy, good, busy])
        assert [o.name for o in outputs] == ["websocket", "osc", "websocket 2"]
        assert all(o.wait_until_tried(20) for o in outputs)
        assert outputs[0].trouble.code == "port-busy"
        assert outputs[1].trouble is None
        for output in outputs:
            output.send(frame(1))
        assert receiver.recv(65536).startswith(b"#bundle")
        taken.close()
        assert wait_for(lambda: outputs[0].trouble is None or outputs[2].trouble is None)
        for output in outputs:
            output.close()


def test_reading_settings_needs_no_library():
    """Libraries are imported where an output is opened."""
    code = (
        "import sys; from defsense_fab.runtime.outputs.live_file import parse_output;"
        "parse_output('midi,file=x.mid');"
        "print({'websockets', 'mido', 'rtmidi', 'pylsl', 'evdev', 'numba'} & set(sys.modules))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout == "set()\n"


def test_a_package_that_is_not_installed(monkeypatch):
    for name in [n for n in sys.modules if n.split(".")[0] == "websockets"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "websockets", None)
    for name in [n for n in sys.modules if n.startswith("defsense_fab.runtime.outputs.websocket")]:
        monkeypatch.delitem(sys.modules, name)
    (output,) = open_outputs([WebSocketSettings()])
    assert output.wait_until_tried(20)
    assert output.trouble.code == "library-missing"
    output.close()
