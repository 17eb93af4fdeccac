"""Turn a MIDI file of the live loop into sound without any library: six pipes of an organ.

    defsense run examples/organ-pipe/model.json --port twin   # writes organ-pipe.mid
    python midi_to_sound.py organ-pipe.mid organ-pipe.wav

A synthesizer on a MIDI port plays the same notes live: use `device = "..."` instead of `file`.
"""

import array
import math
import sys
import wave

RATE = 22050
STOPS = {1: 0.5, 2: 0.25, 3: 0.15, 4: 0.1}  # partials of a pipe, and how loud each is
PEAK = 0.5  # of full scale: -6 dB, whatever was played


def number(data, position):
    """Return a number in groups of seven bits (the last without the high bit), and its end."""
    value = 0
    while True:
        value = value << 7 | data[position] & 0x7F
        position += 1
        if data[position - 1] < 0x80:
            return value, position


def events(data):
    """Yield seconds and message of a file with one track and the default tempo."""
    if data[:4] != b"MThd" or data[14:18] != b"MTrk":
        sys.exit("this is no MIDI file of one track")
    ticks = int.from_bytes(data[12:14], "big")
    end, position, now = 22 + int.from_bytes(data[18:22], "big"), 22, 0
    while position < end:
        step, position = number(data, position)
        now += step
        if data[position] == 0xFF:  # a title, or the end
            size, position = number(data, position + 2)
            position += size
            continue
        size = 2 if data[position] & 0xF0 in (0xC0, 0xD0) else 3  # an instrument's choice is short
        yield now / (2 * ticks), data[position : position + size]
        position += size


def main():
    """Read the MIDI file and write the WAV file."""
    source, target = sys.argv[1], sys.argv[2]
    with open(source, "rb") as file:
        played = list(events(file.read()))
    length = played[-1][0] + 1.0 if played else 1.0
    sound, swell, pressed, started_at = [0.0] * int(length * RATE), 1.0, {}, {}
    levels = {}
    for k in range(len(sound)):
        now = k / RATE
        while played and played[0][0] <= now:
            _, (kind, number_played, *rest) = played.pop(0)
            value = rest[0] if rest else 0
            if kind & 0xF0 == 0xB0 and number_played == 11:
                swell = 0.4 + 0.6 * value / 127
            elif kind & 0xF0 == 0x90 and value:
                pressed[number_played], started_at[number_played] = (
                    0.4 + 0.6 * value / 127,
                    started_at.get(number_played, now),
                )
            elif kind & 0xF0 in (0x80, 0x90):
                pressed.pop(number_played, None)
        for note in started_at:
            # Pipes speak, and fall silent, within some hundredths of a second.
            levels[note] = levels.get(note, 0.0) + 0.0015 * (
                pressed.get(note, 0.0) - levels.get(note, 0.0)
            )
            turn = 2 * math.pi * 440 * 2 ** ((note - 69) / 12) * now
            pipe = sum(a * math.sin(n * turn) for n, a in STOPS.items())
            sound[k] += swell * levels[note] * pipe
    gain = 32767 * PEAK / (max(map(abs, sound)) or 1.0)
    samples = array.array("h", (round(gain * x) for x in sound))
    if sys.byteorder == "big":
        samples.byteswap()
    with wave.open(target, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(samples.tobytes())
    print(f"{target}: {length:.1f} s")


if __name__ == "__main__":
    main()
