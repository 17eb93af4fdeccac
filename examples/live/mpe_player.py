"""Play the poses of a device as expressive notes (MPE) on a synthesizer or into a file.

    defsense run my-device/model.json --port twin --output websocket     # in one terminal
    python mpe_player.py --port Synth                                    # in another
    python mpe_player.py --file take.mid --seconds 20

Each control is a voice: it sounds while the device is in that pose. The stroke's speed sets the
velocity, the amplitude the pressure, the confidence the timbre (CC 74), and `--bend CONTROL` bends
the pitch of all voices. Each note has its own member channel, as MIDI Polyphonic Expression wants
(MPE 1.1, the lower zone). Needs `pip install 'defsense-fab[live,midi]'`.
"""

import argparse
import contextlib
import json
import sys
import time
from pathlib import Path

import mido
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

NOTES = (48, 55, 60, 64, 67, 72, 76, 79)  # of the controls in their order: C major from C3 up
START, END = 0.15, 0.08  # amplitudes at which a note starts and ends
FULL_SPEED = 4.0  # amplitudes per second of the loudest stroke
BEND_RANGE = 48  # semitones, the default of MPE's member channels
MASTER, FIRST_MEMBER = 0, 1  # channels from 0: the lower zone
TIMBRE = 74  # control change


def configuration(count):
    """Return the messages that make the lower zone with so many member channels (RPN 6)."""
    numbers = ((101, 0), (100, 6), (6, count))
    return [mido.Message("control_change", channel=MASTER, control=c, value=v) for c, v in numbers]


def seven_bits(share):
    """Return a share of 0 to 1 as a MIDI value."""
    return round(127 * min(max(share, 0.0), 1.0))


class Voice:
    """One control and its member channel."""

    def __init__(self, note, channel):
        self.note, self.channel = note, channel
        self.is_sounding, self.last = False, (0.0, 0.0)  # time in s, amplitude
        self.sent = {}  # latest value of each dimension

    def update(self, now, amplitude, confidence, semitones):
        """Yield the messages of a new amplitude at a time in s."""
        before, previous = self.last
        self.last = (now, amplitude)
        if not self.is_sounding and amplitude > START:
            self.is_sounding, self.sent = True, {}
            # MPE wants the dimensions of a note before it starts.
            yield from self._dimensions(amplitude, confidence, semitones)
            speed = (amplitude - previous) / max(now - before, 1e-3)
            velocity = max(1, seven_bits((speed / FULL_SPEED) ** 0.5 if speed > 0 else 0.0))
            yield self._message("note_on", note=self.note, velocity=velocity)
        elif self.is_sounding and amplitude < END:
            yield from self.end()
        elif self.is_sounding:
            yield from self._dimensions(amplitude, confidence, semitones)

    def end(self):
        """Yield the end of the note if it sounds."""
        if self.is_sounding:
            self.is_sounding = False
            yield self._message("note_off", note=self.note, velocity=64)

    def _dimensions(self, amplitude, confidence, semitones):
        """Yield pitch bend, timbre and pressure where they changed."""
        pitch = round(8191 * min(max(semitones / BEND_RANGE, -1.0), 1.0))
        values = {
            "pitchwheel": {"pitch": pitch},
            "control_change": {"control": TIMBRE, "value": seven_bits(confidence)},
            "aftertouch": {"value": seven_bits(amplitude)},
        }
        for kind, value in values.items():
            if self.sent.get(kind) != value:
                self.sent[kind] = value
                yield self._message(kind, **value)

    def _message(self, kind, **values):
        return mido.Message(kind, channel=self.channel, **values)


class Player:
    """The voices of a device."""

    def __init__(self, bend, semitones):
        self.bend, self.semitones, self.voices = bend, semitones, {}

    def play(self, frame):
        """Yield the messages of a frame, as the WebSocket sends it."""
        controls = dict(frame["controls"])
        semitones = self.semitones * (controls.pop(self.bend, None) or 0.0)
        if controls and not self.voices:
            names = list(controls)[: len(NOTES)]
            yield from configuration(len(names))
            for number, name in enumerate(names):
                self.voices[name] = Voice(NOTES[number], FIRST_MEMBER + number)
        if frame["level"] == 0:  # the device is lost
            yield from self.end()
            return
        for name, voice in self.voices.items():
            confidence = frame["confidence"].get(name) or 0.0
            amplitude = abs(controls.get(name) or 0.0)
            yield from voice.update(frame["time"], amplitude, confidence, semitones)

    def end(self):
        """Yield the ends of all notes."""
        for voice in self.voices.values():
            yield from voice.end()


def record(path):
    """Return a function that adds messages, and one that writes the file if there are any."""
    file, start = mido.MidiFile(type=0), time.monotonic()
    track = mido.MidiTrack([mido.MetaMessage("track_name", name="DefSense MPE")])
    file.tracks.append(track)
    ticks = 0

    def send(message):
        nonlocal ticks
        now = round((time.monotonic() - start) * 2 * file.ticks_per_beat)  # 120 beats a minute
        track.append(message.copy(time=now - ticks))
        ticks = now

    return send, lambda: file.save(path) if len(track) > 1 else None


def open_port(name):
    """Open the port whose name contains `name`; create a virtual port `DefSense` without one."""
    if name is None:
        return mido.open_output("DefSense MPE", virtual=True)
    names = mido.get_output_names()
    found = next((n for n in names if name.lower() in n.lower()), None)
    if found is None:
        sys.exit(f"no MIDI port is named {name!r}; ports: {', '.join(names) or 'none'}")
    return mido.open_output(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--url", default="ws://127.0.0.1:8765/", help="address of the WebSocket")
    parser.add_argument("--port", help="part of the name of a MIDI port (default: a virtual one)")
    parser.add_argument("--file", help="write a MIDI file instead")
    parser.add_argument("--bend", default="", help="control that bends the pitch")
    parser.add_argument("--semitones", type=float, default=2.0, help="bend at amplitude 1")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after this time")
    words = parser.parse_args()
    player, end = Player(words.bend, words.semitones), time.monotonic() + words.seconds
    if words.file:
        if not Path(words.file).parent.is_dir():
            sys.exit(f"{words.file}: there is no such folder. Create it, or choose another file")
        send, finish = record(words.file)
    else:
        try:
            port = open_port(words.port)
        except (ImportError, OSError) as error:
            sys.exit(f"MIDI ports cannot be used ({error}); write a file with --file")
        send, finish = port.send, port.close
    try:
        with connect(words.url) as socket:
            while (left := end - time.monotonic()) > 0:
                text = socket.recv(timeout=left if words.seconds < float("inf") else None)
                for message in player.play(json.loads(text)):
                    send(message)
    except TimeoutError:
        pass  # the time is over
    except (OSError, WebSocketException) as error:
        print(
            f"{words.url}: {error}. Is `defsense run --output websocket` running?", file=sys.stderr
        )
        return 1
    finally:
        for message in player.end():
            send(message)
        finish()
    return 0


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(main())
