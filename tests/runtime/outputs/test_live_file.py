"""live.toml and flags: what they say, and everything that they may not."""

import socket
import subprocess
import sys

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.controls.shaping import Shaping
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
    ("text", "message"),
    [
        ("[outputs.osk]", "live.toml:1: outputs.osk: unknown output 'osk'; did you mean 'osc'?"),
        ("outputs = 3", "live.toml:1: outputs: must be a table, not 3"),
        ("[output.osc]", "live.toml: output: unknown key; did you mean 'outputs'?"),
        (
            "[outputs.osc]\nprot = 1",
            "live.toml:2: outputs.osc.prot: unknown key; did you mean 'port'? (known: host, page,",
        ),
        ('[outputs.osc]\nport = "9"', "live.toml:2: outputs.osc.port: must be a whole number"),
        ("[outputs.osc]\nport = true", "must be a whole number, not True"),
        ("[outputs.osc]\nport = 9.5", "must be a whole number, not 9.5"),
        ("[outputs.osc]\nport = 0", "live.toml:2: outputs.osc.port: port must lie between 1 and"),
        ("[outputs.osc]\nsend = 3", "send: must be a list of texts"),
        ('[outputs.osc]\nsend = ["all"]', "send has 'all'; there is: controls, confidence, mark"),
        ("[outputs.osc]\nsend = []", "send must name at least one of"),
        ("[outputs.osc]\nrate = -1", "rate must lie between 0"),
        ("[outputs.osc]\npage = 0", "live.toml:2: outputs.osc.page: page must lie between 1 and"),
        ("[outputs.midi]\nchannel = 17", "outputs.midi.channel: channel must lie between 1 and 16"),
        (f'[outputs.gamepad]\nname = "{"x" * 80}"', "outputs.gamepad.name: name must have from 1"),
        ("[outputs.osc]\nrate = nan", "rate: must be a number, not nan"),
        ("[outputs.osc]\nhost = 3", "host: must be a text in quotes, not 3"),
        ('[outputs.websocket]\ntoken = "abc"', "token needs at least 16 plain characters"),
        ("[outputs.websocket]\nmax_clients = 0", "max_clients must lie between 1 and 1000"),
        ("[outputs.websocket]\nmarkers = 1", "markers: must be true or false, not 1"),
        ("[outputs]\nmidi = [1]", "outputs.midi: must be a list of tables"),
        ('[outputs.midi]\nfile = "a"\ndevice = "b"', "give one of device, virtual and file"),
        ("[outputs.midi]\nmapping = 3", "mapping: must be a list of tables"),
        ("[outputs.midi]\nmapping = [{ cc = 3 }]", "mapping.1.control: is missing; add it"),
        ('[outputs.midi]\nmapping = [{ control = "a" }]', "control 'a' needs either cc or note"),
        (
            '[outputs.midi]\nmapping = [{ control = "a", cc = 1 }, { control = "a", cc = 120 }]',
            "outputs.midi.mapping.2.cc: cc must lie between 0 and 119",
        ),
        (
            '[outputs.midi]\nmapping = [{ control = "a", cc = 1, channel = 0 }]',
            "channel must lie between 1 and 16, not 0",
        ),
        ('[outputs.midi]\nmapping = [{ control = "a", cc = 1, low = 1 }]', "low and high must"),
        (
            '[outputs.gamepad]\nmapping = [{ control = "a", axis = "w" }]',
            "axis has 'w'; there is: x, y, z",
        ),
        ('[outputs.gamepad]\nmapping = [{ control = "a" }]', "needs either axis or button"),
        ("[controls]\nbend = 3", "live.toml:2: controls.bend: must be a table, not 3"),
        ('[controls]\n"a b" = "pull"', "controls.a b: 'a b' cannot name a control"),
        ("[controls.bend]\ncurve = 0", "controls.bend.curve: curve must lie between 0.1 and 10"),
        ("[controls.bend]\ndeadzone = 0", "controls.bend.deadzone: unknown key; did you mean"),
        ("[controls", "not valid TOML"),
    ],
)
def test_what_a_file_may_not_say(read, text, message):
    with pytest.raises(OutputError) as error:
        read(text)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(OutputError, match=r"live\.toml: no such file"):
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
    ("flag", "message"),
    [
        ("", "no output ''; there is: osc, websocket, midi, lsl, gamepad"),
        ("ocs,port=1", "no output 'ocs'; did you mean 'osc'?"),
        ("osc,9000", "'9000' is no key=value"),
        ("osc,port=1,port=2", "port is given twice"),
        ("osc,prot=1", "osc.prot: unknown key; did you mean 'port'?"),
        ("osc,port=x", "osc.port: must be a whole number, not 'x'"),
        ("osc,port=1\nhost=3", "osc.port: must be a whole number"),
        ("midi,mapping=[{control=3}]", "midi.mapping.1.control: must be a text"),
    ],
)
def test_what_flags_may_not_say(flag, message):
    with pytest.raises(OutputError) as error:
        parse_output(flag)
    assert message in str(error.value)
    assert str(error.value).startswith("--output")


def test_outputs_are_opened(tmp_path):
    """One that works, two whose port is taken: they say so, and the loop goes on."""
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
        assert "is in use by another program" in outputs[0].trouble
        assert outputs[1].trouble is None
        for output in outputs:
            output.send(frame(1))
        assert receiver.recv(65536).startswith(b"#bundle")
        taken.close()
        assert wait_for(lambda: outputs[0].trouble is None or outputs[2].trouble is None)
        for output in outputs:
            output.close()


def test_reading_settings_needs_no_library():
    """Those of outputs are imported where an output is opened."""
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
    assert "websocket: needs the package websockets" in output.trouble
    assert 'pip install "defsense-fab[live]"' in output.trouble
    output.close()
