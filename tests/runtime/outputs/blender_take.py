"""Use the add-on in Blender's Python module: connect, record twice, print the keyframes as JSON.

Usage: python blender_take.py ADDON.py COUNT; prints the port first, and ends after two takes of
COUNT frames each.
"""

import json
import runpy
import socket
import sys
import time

import bpy

program, count = sys.argv[1], int(sys.argv[2])
for one in list(bpy.data.objects):
    bpy.data.objects.remove(one)
addon = runpy.run_path(program, run_name="__main__")
scene = bpy.context.scene
scene.render.fps = 24
scene.frame_set(11)

other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
other.bind(("127.0.0.1", 0))
scene.defsense_port = other.getsockname()[1]
refused = ""
try:
    bpy.ops.defsense.connect()
except RuntimeError as error:
    refused = str(error)
other.close()

bpy.ops.defsense.connect()
print("port", scene.defsense_port, flush=True)
timer = addon["step"]


def run_until(condition):
    end = time.monotonic() + 60
    while not condition() and time.monotonic() < end:
        assert timer() > 0
        time.sleep(0.005)


def is_long_enough(takes):
    return "bar" in takes and all(len(keys) >= count for keys in takes["bar"].keys.values())


receiver = timer.__globals__["receiver"]
run_until(lambda: receiver.channels)
takes = []
for _ in range(2):
    bpy.ops.defsense.record()
    run_until(
        lambda: any(len(k) >= count for t in receiver.takes.values() for k in t.keys.values())
    )
    bpy.ops.defsense.record()
    curves = []
    for name in ("bar marker 1", "bar"):
        owner = bpy.data.objects[name]
        for curve in addon["find_curves"](owner):
            points = [list(p.co) for p in curve.keyframe_points]
            kinds = {p.interpolation for p in curve.keyframe_points}
            curves.append([name, curve.data_path, curve.array_index, points, sorted(kinds)])
    takes.append(curves)
bpy.ops.defsense.disconnect()
actions = sorted(a.name for a in bpy.data.actions)
print(json.dumps({"takes": takes, "actions": actions, "refused": refused, "end": scene.frame_end}))
