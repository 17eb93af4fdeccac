"""Print the events of the virtual gamepad (Linux), without any library.

    defsense run my-device/model.json --port twin --output gamepad     # in one terminal
    python gamepad_receiver.py                                         # in another
    python gamepad_receiver.py "DefSense gamepad 2"                    # of the second device

Games and browsers see the same gamepad.
"""

import contextlib
import pathlib
import struct
import sys

EVENT = "llHHi"  # struct input_event: seconds, microseconds, type, code, value
AXES = {0: "x", 1: "y", 2: "z", 3: "rx", 4: "ry", 5: "rz"}


def device(gamepad):
    """Return the device file of a gamepad."""
    for name in pathlib.Path("/sys/class/input").glob("event*/device/name"):
        if name.read_text().strip() == gamepad:
            return pathlib.Path("/dev/input") / name.parts[-3]
    sys.exit(f"there is no {gamepad}; does the live loop run?")


def main():
    gamepad = sys.argv[1] if len(sys.argv) > 1 else "DefSense gamepad"
    with device(gamepad).open("rb") as events:
        while True:
            data = events.read(struct.calcsize(EVENT))
            _, _, kind, code, value = struct.unpack(EVENT, data)
            if kind == 3:
                print(f"axis {AXES.get(code, code)}: {value / 32767:+.2f}", flush=True)
            elif kind == 1:
                print(f"button {code:#x}: {'down' if value else 'up'}", flush=True)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
