"""Blender add-on: show the markers and controls of a device, and record them as keyframes.

    defsense run my-device/model.json --port twin --output 'osc,send=["controls","markers"]'

Install this file in Blender (Edit, Preferences, Add-ons, Install from Disk), enable "DefSense", and
open the sidebar of the 3D view (key N), tab "DefSense": Connect, then Record. Each marker becomes
an empty, such as `bar marker 0`, each control a custom property of the empty `bar`, such as
`["bend"]`, which drivers can read. 100 mm are 0.1 units, as in recordings. A recording becomes one
action per empty; earlier actions are kept. Blender 4.2 or later; no further library is needed.
"""

import contextlib
import socket
import struct

import bpy

bl_info = {
    "name": "DefSense",
    "author": "defsense-fab",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > DefSense",
    "description": "Show and record the deformation of a soft device",
    "category": "Animation",
}

INTERVAL_S = 1 / 60  # between two readings of the port
UNITS_PER_MM = 1e-3
EMPTY_SIZE = 0.002  # of a marker, in units


def read_text(data, position):
    """Return a string that ends with one to four zeros, and the position after it."""
    end = data.index(b"\0", position)
    return data[position:end].decode("ascii"), end + 4 - end % 4


def read_messages(data):
    """Yield address and values of all messages in a datagram of OSC 1.0."""
    if data.startswith(b"#bundle\0"):
        position = 16  # after the name and the time
        while position < len(data):
            (size,) = struct.unpack_from(">i", data, position)
            yield from read_messages(data[position + 4 : position + 4 + size])
            position += 4 + size
        return
    address, position = read_text(data, 0)
    tags, position = read_text(data, position)
    values = []
    for tag in tags[1:]:
        if tag == "s":
            value, position = read_text(data, position)
        else:  # i, f, d
            (value,) = struct.unpack_from(">" + tag, data, position)
            position += struct.calcsize(">" + tag)
        values.append(value)
    yield address, values


class Take:
    """Keyframes of one device, which are collected while it is recorded.

    Times are those of the device, so that they do not depend on when Blender reads the port.
    """

    def __init__(self, first_frame, frames_per_second):
        self.first_frame, self.frames_per_second = first_frame, frames_per_second
        self.start = self.last = None
        self.keys = {}  # (name of the empty, path, index): frames and values

    def add(self, time, channels):
        """Add the values of all channels at a time in s; times that go back are left out."""
        if self.start is None:
            self.start = time
        elif time <= self.last:
            return
        self.last = time
        frame = self.first_frame + (time - self.start) * self.frames_per_second
        for channel, value in channels.items():
            self.keys.setdefault(channel, []).append((frame, value))


class Receiver:
    """Reads the messages of all devices from a port of this machine."""

    def __init__(self, port):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.socket.bind(("127.0.0.1", port))
        except OSError:
            self.socket.close()
            raise
        self.socket.setblocking(False)
        self.channels = {}  # of each device: its values by (name of the empty, path, index)
        self.takes = None  # by device, while recording
        self.scene_frame, self.frames_per_second = 1, 24.0

    def record(self, scene_frame, frames_per_second):
        """Start to collect keyframes, the first one at a frame of the scene."""
        self.scene_frame, self.frames_per_second = scene_frame, frames_per_second
        self.takes = {}

    def stop_recording(self):
        """Return the collected takes by device."""
        takes, self.takes = self.takes, None
        return takes

    def read(self):
        """Read all messages that have arrived; return the names of devices with new values."""
        changed = set()
        while True:
            try:
                data = self.socket.recv(65536)
            except (BlockingIOError, ConnectionError):
                return changed
            # Not OSC, or with texts for numbers: an error would end Blender's timer.
            with contextlib.suppress(ValueError, TypeError, struct.error, RecursionError):
                for address, values in read_messages(data):
                    changed |= self._take_in(address.split("/"), values)

    def _take_in(self, parts, values):
        """Keep the values of a message; the time is the last message of a frame."""
        if len(parts) < 4 or parts[1] != "defsense" or not values:
            return set()
        device, kind = parts[2:4]
        channels = self.channels.setdefault(device, {})
        if kind == "marker" and len(parts) == 5 and len(values) >= 3:
            for axis, value in enumerate(values[:3]):
                channels[f"{device} marker {parts[4]}", "location", axis] = (
                    float(value) * UNITS_PER_MM
                )
        elif kind == "control" and len(parts) == 5:
            channels[device, f'["{parts[4]}"]', 0] = float(values[0])
        elif kind == "time":
            if self.takes is not None:
                new = Take(self.scene_frame, self.frames_per_second)
                self.takes.setdefault(device, new).add(float(values[0]), channels)
            return {device}
        return set()


def find_empty(name):
    """Return the empty of this name; create it if it does not exist."""
    empty = bpy.data.objects.get(name)
    if empty is None:
        empty = bpy.data.objects.new(name, None)
        empty.empty_display_type = "SPHERE"
        empty.empty_display_size = EMPTY_SIZE
        bpy.context.scene.collection.objects.link(empty)
    return empty


def show(channels):
    """Set the empties to the values of a device."""
    for (name, path, index), value in channels.items():
        empty = find_empty(name)
        if path == "location":
            empty.location[index] = value
        else:
            empty[path[2:-2]] = float(value)


def find_curves(owner):
    """Return the F-curves of an object's action in any version of Blender."""
    data = owner.animation_data
    if hasattr(data.action, "fcurves"):  # before 5.0
        return data.action.fcurves
    from bpy_extras import anim_utils

    return anim_utils.action_get_channelbag_for_slot(data.action, data.action_slot).fcurves


def write_keyframes(take):
    """Write a take as one new action per empty; return the last frame."""
    last = take.first_frame
    owners = {}
    for (name, path, index), keys in take.keys.items():
        owner = find_empty(name)
        if name not in owners:
            data = owner.animation_data_create()
            if data.action is not None:
                data.action.use_fake_user = True  # keep the earlier take
                data.action = None
            owners[name] = owner
        frame, value = keys[0]
        if path == "location":
            owner.location[index] = value
            owner.keyframe_insert(path, index=index, frame=frame)
        else:
            owner[path[2:-2]] = float(value)
            owner.keyframe_insert(path, frame=frame)
        curve = find_curves(owner).find(path, index=index)
        curve.keyframe_points.add(len(keys) - 1)
        curve.keyframe_points.foreach_set("co", [number for key in keys for number in key])
        curve.keyframe_points.foreach_set("interpolation", [1] * len(keys))  # linear
        curve.update()
        last = max(last, keys[-1][0])
    for name, owner in owners.items():
        owner.animation_data.action.name = f"{name} take"  # Blender appends .001, .002, ...
    return last


receiver: Receiver | None = None


def step():
    """Show what has arrived; Blender calls this between its frames."""
    if receiver is None:
        return None
    for device in receiver.read():
        show(receiver.channels[device])
    return INTERVAL_S


def disconnect():
    """Close the port."""
    global receiver
    if receiver is not None:
        receiver.socket.close()
        receiver = None


class DEFSENSE_OT_connect(bpy.types.Operator):  # noqa: N801  # Blender's naming rule
    """Receive the markers and controls that `defsense run --output osc` sends"""

    bl_idname = "defsense.connect"
    bl_label = "Connect"

    def execute(self, context):
        global receiver
        disconnect()
        port = context.scene.defsense_port
        try:
            receiver = Receiver(port)
        except OSError as error:
            message = f"Port {port} cannot be opened ({error.strerror}). Choose another port"
            self.report({"ERROR"}, message)
            return {"CANCELLED"}
        if not bpy.app.timers.is_registered(step):
            bpy.app.timers.register(step, persistent=True)
        return {"FINISHED"}


class DEFSENSE_OT_disconnect(bpy.types.Operator):  # noqa: N801
    """Close the port; what was recorded until now is written"""

    bl_idname = "defsense.disconnect"
    bl_label = "Disconnect"

    def execute(self, _context):
        if receiver is not None and receiver.takes is not None:
            bpy.ops.defsense.record()
        disconnect()
        return {"FINISHED"}


class DEFSENSE_OT_record(bpy.types.Operator):  # noqa: N801
    """Start a recording at the current frame, or stop it and write its keyframes"""

    bl_idname = "defsense.record"
    bl_label = "Record"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    def execute(self, context):
        scene = context.scene
        if receiver is None:
            self.report({"ERROR"}, "Nothing is received. Press Connect first")
            return {"CANCELLED"}
        if receiver.takes is None:
            rate = scene.render.fps / scene.render.fps_base
            receiver.record(scene.frame_current, rate)
            return {"FINISHED"}
        takes = receiver.stop_recording()
        if not takes:
            self.report({"WARNING"}, f"Nothing arrived at port {scene.defsense_port}")
            return {"CANCELLED"}
        last = max(write_keyframes(take) for take in takes.values())
        scene.frame_end = max(scene.frame_end, int(last) + 1)
        return {"FINISHED"}


class DEFSENSE_PT_panel(bpy.types.Panel):  # noqa: N801
    """The tab in the sidebar"""

    bl_idname = "DEFSENSE_PT_panel"
    bl_label = "DefSense"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "DefSense"

    def draw(self, context):
        layout = self.layout
        if receiver is None:
            layout.prop(context.scene, "defsense_port")
            layout.operator("defsense.connect", icon="LINKED")
            return
        layout.operator("defsense.disconnect", icon="UNLINKED")
        is_recording = receiver.takes is not None
        text, icon = ("Stop", "PAUSE") if is_recording else ("Record", "REC")
        layout.operator("defsense.record", text=text, icon=icon)
        for device in sorted(receiver.channels) or ["nothing received yet"]:
            layout.label(text=device)


CLASSES = (DEFSENSE_OT_connect, DEFSENSE_OT_disconnect, DEFSENSE_OT_record, DEFSENSE_PT_panel)


def register():
    """Add the panel and its operators; Blender calls this when the add-on is enabled."""
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.defsense_port = bpy.props.IntProperty(
        name="Port", description="Port of defsense run --output osc", default=9000, min=1, max=65535
    )


def unregister():
    """Remove what `register` added."""
    disconnect()
    del bpy.types.Scene.defsense_port
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)


if __name__ == "__main__":
    register()
