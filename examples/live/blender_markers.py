"""Show the markers and controls of a device in Blender; run this in Blender's text editor.

    defsense run my-device/model.json --port twin --output 'osc,send=["controls","markers"]'

Each marker becomes an empty, `bar marker 0` and so on; 100 mm are 0.1 units, as in recordings. Each
control becomes a custom property of the scene, such as `bar bend`, which drivers can read. Run the
script again to restart it; it ends with Blender. No further library is needed.
"""

import socket
import struct

import bpy

PORT = 9000
EVERY = 1 / 60  # s


def text_at(data, position):
    """Return a string that ends with one to four zeros, and the position after it."""
    end = data.index(b"\0", position)
    return data[position:end].decode("ascii"), end + 4 - end % 4


def messages(data):
    """Yield address and values of all messages in a datagram of OSC 1.0."""
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


def empty(name):
    """Return the empty of this name; create it if it does not exist."""
    empty_object = bpy.data.objects.get(name)
    if empty_object is None:
        empty_object = bpy.data.objects.new(name, None)
        empty_object.empty_display_type = "SPHERE"
        empty_object.empty_display_size = 0.002
        bpy.context.scene.collection.objects.link(empty_object)
    return empty_object


def show(address, values):
    """Show one message in the scene."""
    parts = address.split("/")
    if len(parts) != 5 or parts[1] != "defsense":
        return
    _, _, device, kind, name = parts
    if kind == "marker":
        empty(f"{device} marker {name}").location = [v / 1000 for v in values[:3]]
    elif kind == "control":
        bpy.context.scene[f"{device} {name}"] = values[0]


def start():
    """Listen, and let Blender call `step` between its frames."""
    before = bpy.app.driver_namespace.get("defsense")
    if before is not None:
        before.close()
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", PORT))
    receiver.setblocking(False)
    bpy.app.driver_namespace["defsense"] = receiver

    def step():
        if receiver.fileno() < 0:
            return None  # the script was run again: this timer ends
        while True:
            try:
                for address, values in messages(receiver.recv(65536)):
                    show(address, values)
            except BlockingIOError:
                break
            except (ValueError, struct.error, UnicodeDecodeError, RecursionError):
                continue  # not OSC
        return EVERY

    bpy.app.timers.register(step)


start()
