"""Show the controls of devices as bars in the terminal; they are received by Open Sound Control.

    defsense run my-device/model.json --port twin --output osc,port=9000        # in one terminal
    python osc_receiver.py 9000                                                 # in another

No library is needed: `messages` reads OSC 1.0.
"""

import contextlib
import socket
import struct
import sys


def text_at(data, position):
    """Return a string that ends with one to four zeros, and the position after it."""
    end = data.index(b"\0", position)
    return data[position:end].decode("ascii"), end + 4 - end % 4


def messages(data):
    """Yield address and values of all messages in a datagram."""
    if data.startswith(b"#bundle\0"):
        position = 16  # the name and the time
        while position < len(data):
            (size,) = struct.unpack_from(">i", data, position)
            yield from messages(data[position + 4 : position + 4 + size])
            position += 4 + size
        return
    address, position = text_at(data, 0)
    tags, position = text_at(data, position)
    values = []
    for tag in tags[1:]:
        if tag == "s":
            value, position = text_at(data, position)
        else:  # i, f, d
            (value,) = struct.unpack_from(">" + tag, data, position)
            position += struct.calcsize(">" + tag)
        values.append(value)
    yield address, values


def bar(value):
    """Return a value with a bar of characters."""
    filled = round(30 * min(abs(value), 1))
    return f"{value:+.2f} " + "#" * filled + "." * (30 - filled)


def main():
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 9000
    bars, lines = {}, 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", port))
        print(f"listening on port {receiver.getsockname()[1]}", flush=True)
        while True:
            try:
                received = list(messages(receiver.recv(65536)))
            except (ValueError, struct.error, UnicodeDecodeError, RecursionError):
                continue  # not OSC
            for address, values in received:
                parts = address.split("/")
                if len(parts) == 5 and parts[1] == "defsense" and parts[3] == "control":
                    bars[f"{parts[2]} {parts[4]}"] = bar(values[0])
                elif len(parts) == 4 and parts[3] == "quality":
                    bars[f"{parts[2]} quality"] = values[1]
            if bars:
                up = f"\x1b[{lines}A" if lines else ""
                rows = "".join(f"{name:20} {row}\x1b[K\n" for name, row in bars.items())
                print(up + rows, end="", flush=True)
                lines = len(bars)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
