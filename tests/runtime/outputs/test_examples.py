"""The example programs that receive outputs run unchanged."""

import runpy
import subprocess
import sys
import threading
import uuid
import wave
from itertools import accumulate
from pathlib import Path
from types import SimpleNamespace

import mido
import numpy as np
import pytest
from msgspec.structs import replace

from defsense_fab.runtime.outputs.live_file import read_live_file
from defsense_fab.runtime.outputs.lsl_output import LslOutput
from defsense_fab.runtime.outputs.midi_output import MidiOutput
from defsense_fab.runtime.outputs.osc_output import OscOutput
from defsense_fab.runtime.outputs.settings import (
    LslSettings,
    MidiSettings,
    OscSettings,
    WebSocketSettings,
)
from defsense_fab.runtime.outputs.websocket_output import WebSocketOutput
from tests.runtime.live_frames import frame

EXAMPLES = Path(__file__).parents[3] / "examples" / "live"
ORGAN = EXAMPLES.parent / "organ-pipe"


class Run:
    """A running example; frames are sent until it prints an expected text."""

    def __init__(self, name, *args):
        self._process = subprocess.Popen(
            [sys.executable, "-I", str(EXAMPLES / name), *map(str, args)],
            stdout=subprocess.PIPE,
            text=True,
        )
        self.lines = []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self):
        self.lines.extend(iter(self._process.stdout.readline, ""))

    def prints(self, text, send=lambda: None):
        for _ in range(1000):
            send()
            if any(text in line for line in list(self.lines)):
                return True
            threading.Event().wait(0.03)
        return False

    def end(self):
        self._process.kill()
        self._process.wait()
        self._thread.join()
        self._process.stdout.close()


@pytest.fixture
def run():
    running = []

    def start(name, *args):
        running.append(Run(name, *args))
        return running[-1]

    yield start
    for one in running:
        one.end()


def test_osc_receiver(run):
    example = run("osc_receiver.py", 0)
    assert example.prints("listening on port")
    port = int(example.lines[0].split()[-1])
    output = OscOutput(OscSettings(port=port, send=("controls", "markers", "quality")))
    sent = frame(1)
    both = (sent, frame(1, device="bar-2", controls={"twist": 0.5}))
    for name, value in (("bar", "-0.50"), ("bar-2", "+0.50")):
        expected = f"{name + ' twist':20} {value} ###############...."
        assert example.prints(expected, lambda: [output.send(one) for one in both])
        assert example.prints(f"{name + ' quality':20} trusted")
    output.close()


def test_blender_markers(monkeypatch):
    """Blender is replaced by the few functions that the script uses."""
    objects, timers, namespace = {}, [], {}

    class Scene(dict):
        collection = SimpleNamespace(objects=SimpleNamespace(link=lambda o: None))

    def new(name, data):
        assert data is None  # an empty
        objects[name] = SimpleNamespace()
        return objects[name]

    blender = SimpleNamespace(
        app=SimpleNamespace(
            driver_namespace=namespace, timers=SimpleNamespace(register=timers.append)
        ),
        context=SimpleNamespace(scene=Scene()),
        data=SimpleNamespace(objects=SimpleNamespace(get=objects.get, new=new)),
    )
    monkeypatch.setitem(sys.modules, "bpy", blender)
    code = (EXAMPLES / "blender_markers.py").read_text(encoding="utf-8")
    for _ in range(2):  # run again, the first one's timer ends
        exec(code.replace("PORT = 9000", "PORT = 0"), {})
    (first, step), scene = timers, blender.context.scene
    assert first() is None
    output = OscOutput(
        OscSettings(port=namespace["defsense"].getsockname()[1], send=("controls", "markers"))
    )
    sent = frame(1)
    for _ in range(200):
        output.send(sent)
        assert step() > 0
        if objects and "bar twist" in scene:
            break
        threading.Event().wait(0.02)
    output.close()
    namespace["defsense"].close()
    assert scene["bar twist"] == pytest.approx(-0.5)
    for number, place in zip(sent.ids, sent.markers, strict=True):
        at = objects[f"bar marker {number}"].location
        assert at == pytest.approx(place / 1000, abs=1e-6)


def test_websocket_client(run):
    output = WebSocketOutput(WebSocketSettings(port=0, token="a-token-of-my-own"))
    port = output.port
    example = run("websocket_client.py", "127.0.0.1", port, "a-token-of-my-own")
    sent = frame(100, count=2000)  # a long one: its length takes eight bytes
    expected = "     1.00 s  trusted    bend +0.25  twist -0.50"
    assert example.prints(expected, lambda: output.send(sent))
    output.close()


def test_lsl_receiver(run):
    name = f"bar {uuid.uuid4().hex[:8]}"
    output = LslOutput(LslSettings(stream=name))
    output.send(frame(1))
    example = run("lsl_receiver.py", name)
    assert example.prints("bend (normalized), twist (normalized), quality (level)")
    number = iter(range(2, 5000))
    expected = "bend +0.25  twist -0.50  quality +3.00"
    assert example.prints(expected, lambda: output.send(frame(next(number))))
    output.close()


def test_organ_pipe(tmp_path):
    """At a fifth of the full pull one pipe sounds: the C of 130.8 Hz."""
    live = read_live_file(ORGAN / "live.toml")
    assert [c.name for c in live.controls] == ["wind", "middle_pipe", "high_pipe", "swell"]
    (settings,) = live.outputs
    output = MidiOutput(replace(settings, file=str(tmp_path / "x.mid")))
    for n in range(100):
        controls = {"wind": min(0.2, n / 100), "middle_pipe": 0.1, "high_pipe": 0.0, "swell": 1.0}
        output.send(frame(n, controls=controls, confidence={}))
    output.close()
    subprocess.run(
        [sys.executable, "-I", str(ORGAN / "midi_to_sound.py"), "x.mid", "x.wav"],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    with wave.open(str(tmp_path / "x.wav")) as file:
        rate, data = file.getframerate(), file.readframes(file.getnframes())
    sound = np.frombuffer(data, "<i2") / 32768
    assert not sound[: rate // 20].any()  # not yet
    assert np.abs(sound).max() == pytest.approx(0.5, abs=0.001)  # -6 dB
    part = sound[rate // 2 : rate // 2 + rate // 4]
    loudest = np.argmax(np.abs(np.fft.rfft(part * np.hanning(len(part)), 10 * rate))) / 10
    assert loudest == pytest.approx(130.8, abs=0.5)


def test_organ_pipe_reads_files_like_mido(tmp_path):
    """Messages have two bytes, as a program change, or three."""
    path, file, track = tmp_path / "x.mid", mido.MidiFile(type=0), mido.MidiTrack()
    track.append(mido.MetaMessage("track_name", name="t"))
    track.append(mido.Message("program_change", program=19))
    track.append(mido.Message("note_on", note=48, velocity=70, time=300))
    track.append(mido.Message("aftertouch", value=9, time=200))
    track.append(mido.Message("note_off", note=48, velocity=0, time=1000))
    file.tracks.append(track)
    file.save(path)
    read = runpy.run_path(str(ORGAN / "midi_to_sound.py"))["events"]
    theirs = [message for message in mido.MidiFile(path) if not message.is_meta]
    ours = list(read(path.read_bytes()))
    assert [list(message) for _, message in ours] == [message.bytes() for message in theirs]
    times = accumulate(message.time for message in theirs)
    assert [time for time, _ in ours] == pytest.approx(list(times))


def test_organ_pipe_of_an_empty_file(tmp_path):
    MidiOutput(MidiSettings(file=str(tmp_path / "x.mid"))).close()
    made = tmp_path / "x.wav"
    program = ORGAN / "midi_to_sound.py"
    subprocess.run([sys.executable, "-I", program, tmp_path / "x.mid", made], check=True)
    with wave.open(str(made)) as file:
        assert not any(file.readframes(file.getnframes()))
