"""The example programs that receive outputs run unchanged."""

import json
import os
import runpy
import socket
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
from tests.runtime.live_frames import frame, wait_for

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


@pytest.mark.peer
def test_blender_addon_records_keyframes():
    """In Blender's own Python module (`pip install bpy`), which PEER_PYTHON has."""
    python = os.environ.get("PEER_PYTHON", sys.executable)
    if subprocess.run([python, "-c", "import bpy"], capture_output=True).returncode:
        pytest.skip("PEER_PYTHON has no bpy")
    here = Path(__file__).parent
    words = [here / "blender_take.py", EXAMPLES / "blender_addon.py", 20]
    blender = subprocess.Popen([python, *map(str, words)], stdout=subprocess.PIPE, text=True)
    port = next(int(line.split()[1]) for line in blender.stdout if line.startswith("port "))
    output = OscOutput(OscSettings(port=port, send=("controls", "markers")))
    number = 0
    while blender.poll() is None and number < 5000:
        number += 1
        bend = 0.5 * np.sin(0.1 * number)
        output.send(frame(number, controls={"bend": bend}, markers=frame().markers + number))
        threading.Event().wait(0.01)
    output.close()
    result = json.loads(blender.stdout.read().splitlines()[-1])
    blender.stdout.close()
    assert "cannot be opened" in result["refused"]
    assert len(result["actions"]) == 8  # two takes of three markers and the controls
    assert result["end"] >= 11
    for curves in result["takes"]:
        by_path = {(name, path, axis): keys for name, path, axis, keys, _ in curves}
        assert set(by_path) == {
            *(("bar marker 1", "location", axis) for axis in range(3)),
            ("bar", '["bend"]', 0),
        }
        assert {kind for *_, kinds in curves for kind in kinds} == {"LINEAR"}
        for keys in by_path.values():
            assert len(keys) >= 20
            assert keys[0][0] == 11
        # Keyframes keep the device's time: 0.01 s from frame to frame are 0.24 frames of Blender.
        frames, x = np.array(by_path["bar marker 1", "location", 0]).T
        numbers = x / 1e-3 - frame().markers[1, 0]
        assert frames - 11 == pytest.approx(0.24 * (numbers - numbers[0]), abs=1e-3)
        assert np.array(by_path["bar", '["bend"]', 0])[:, 1] == pytest.approx(
            0.5 * np.sin(0.1 * numbers), abs=1e-3
        )


@pytest.fixture
def receiver(monkeypatch):
    """The part of the add-on that reads the port, without Blender."""
    types = SimpleNamespace(Operator=object, Panel=object)
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(types=types))
    receiver = runpy.run_path(str(EXAMPLES / "blender_addon.py"))["Receiver"](0)
    yield receiver
    receiver.socket.close()


def test_blender_addon_ignores_texts_for_numbers(receiver):
    def text(value):
        return value + bytes(4 - len(value) % 4)

    receiver.record(1, 24.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for address in (
            b"/defsense/bar/marker/0",
            b"/defsense/bar/control/x",
            b"/defsense/bar/time",
        ):
            data = text(address) + text(b",sss") + 3 * text(b"one")
            sender.sendto(data, receiver.socket.getsockname())
    output = OscOutput(OscSettings(port=receiver.socket.getsockname()[1], send=("controls",)))
    output.send(frame(1))
    output.close()
    assert wait_for(lambda: "bar" in receiver.read())
    assert all(isinstance(value, float) for value in receiver.channels["bar"].values())


def test_blender_addon_collects_keyframes_at_the_times_of_the_device(receiver):
    port = receiver.socket.getsockname()[1]
    output = OscOutput(OscSettings(port=port, send=("controls", "markers")))
    receiver.record(11, 24.0)
    for number in (1, 2, 2, 5, 4):  # one twice, and one too late
        output.send(frame(number))
    output.close()
    last = 11 + 4 * 0.24

    def has_last():
        receiver.read()
        keys = receiver.takes["bar"].keys if receiver.takes else {}
        return any(at == pytest.approx(last) for at, _ in keys.get(("bar", '["twist"]', 0), ()))

    assert wait_for(has_last)
    keys = receiver.stop_recording()["bar"].keys
    frames = [11, 11 + 0.24, last]
    assert [at for at, _ in keys["bar", '["twist"]', 0]] == pytest.approx(frames)
    x = [value for _, value in keys["bar marker 1", "location", 0]]
    assert x == pytest.approx([frame().markers[1, 0] / 1000] * 3)


def test_mpe_player(tmp_path):
    """Each note has a channel of its own, which knows its dimensions before the note starts."""
    output = WebSocketOutput(WebSocketSettings(port=0))
    path = tmp_path / "take.mid"
    words = ["--url", f"ws://127.0.0.1:{output.port}/", "--file", path, "--seconds", 3]
    player = subprocess.Popen(
        [sys.executable, str(EXAMPLES / "mpe_player.py"), *map(str, words), "--bend", "twist"]
    )
    number = 0
    while player.poll() is None and number < 10_000:
        number += 1
        bend = abs(np.sin(0.05 * number))
        controls = {"bend": bend, "pull": 1 - bend, "twist": 0.5}
        output.send(frame(number, controls=controls, confidence=dict.fromkeys(controls, 0.9)))
        threading.Event().wait(0.01)
    output.close()
    assert player.returncode == 0
    messages = [m for m in mido.MidiFile(path) if not m.is_meta]
    zone = [(m.control, m.value) for m in messages[:3]]
    assert zone == [(101, 0), (100, 6), (6, 2)]
    known, sounding, played = {}, {}, set()
    for message in messages[3:]:
        assert message.channel in (1, 2)
        if message.type == "note_on":
            assert message.channel not in sounding
            assert known[message.channel] == {"pitchwheel", "control_change", "aftertouch"}
            sounding[message.channel] = message.note
            played.add((message.channel, message.note))
        elif message.type == "note_off":
            assert sounding.pop(message.channel) == message.note
        else:
            known.setdefault(message.channel, set()).add(message.type)
    assert not sounding
    assert played == {(1, 48), (2, 55)}
    pitches = {m.pitch for m in messages if m.type == "pitchwheel"}
    assert pitches == {round(8191 / 48)}  # half of two semitones
    assert max(m.value for m in messages if m.type == "aftertouch") > 120


def test_mpe_player_without_a_device_keeps_an_earlier_file(tmp_path):
    path = tmp_path / "take.mid"
    path.write_bytes(b"an earlier take")
    with socket.socket() as silent:  # bound, but nothing listens
        silent.bind(("127.0.0.1", 0))
        url = f"ws://127.0.0.1:{silent.getsockname()[1]}/"
        for file in (path, tmp_path / "missing" / "take.mid"):
            words = [EXAMPLES / "mpe_player.py", "--url", url, "--file", file]
            player = subprocess.run([sys.executable, *words], capture_output=True, text=True)
            assert player.returncode == 1
            assert "Traceback" not in player.stderr
    assert path.read_bytes() == b"an earlier take"


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
