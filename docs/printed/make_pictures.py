"""Draw traces in a transparent body and all kinds of pads, for the pages on printed sensors.

python docs/printed/make_pictures.py
"""

from pathlib import Path

import numpy as np
from PIL import Image

from defsense_fab.core.curve import REST_FRAME, Hermite, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.pads import PADS
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.channels.cord_channels import make_trace_lines
from defsense_fab.geometry.parts.printed_traces import TraceShape, make_printed
from defsense_fab.geometry.parts.records import PartRules
from defsense_fab.report.guide.pad_drawing import draw_pad
from defsense_fab.report.pictures.scene import Scene
from defsense_fab.report.pictures.sheet import COLORS
from defsense_fab.report.pictures.views import looking

HERE = Path(__file__).parent
BAR = HERE.parents[1] / "fixtures" / "devices" / "bar"
VIEW = looking(np.array([-0.75, -1.0, 0.7]), np.array([0, 0, 1.0]))
SIZE = (1000, 520)  # pixels
WIDTH, HEIGHT = 1.2, 0.8  # of a trace, mm
LOOPS = ((100.0, 9.0, -9.0, -5.0), (124.0, 9.5, 0.0, 8.0), (60.0, 7.0, 9.0, 9.0))


def loop_points(length, radius, first, last):
    """Return points (p, 3) mm of a loop from x = 0 to a length and back.

    It has a half circle of a radius, and rises from the height `first` to `last` on its way.
    """
    angles = np.radians(np.arange(-90, 91, 30))
    turn = np.stack([length + radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    out = np.stack([np.linspace(4, length - 8, 8), np.full(8, -radius)], axis=1)
    level = np.concatenate([out, turn, (out * [1, -1])[::-1]])
    heights = first + (last - first) * np.clip((level[:, 0] - 20) / (length - 20), 0, 1)
    return np.column_stack([level, heights])


def draw_traces():
    """Return an image of the solids of traces in a body."""
    surface = load_body(load_device(BAR).body).surface
    pad = PADS["screw"]
    curves = [Hermite(p, catmull_rom(p)) for p in (loop_points(*loop) for loop in LOOPS)]
    sensors = [Sensor(f"trace-{k}", REST_FRAME, curve) for k, curve in enumerate(curves, 1)]
    diameter = float(np.hypot(WIDTH, HEIGHT))
    rules = PartRules(cord=diameter, channel=diameter, clearance=0.2, wall=1.2)
    shape = TraceShape(WIDTH, HEIGHT, np.array([0.0, 0.0, 1.0]), pad)
    lines = make_trace_lines(sensors, surface, WIDTH, pad.depth)
    parts = make_printed(surface, lines, rules, shape)
    with Scene() as scene:
        scene.outline(surface, opacity=0.25)
        for k, trace in enumerate(parts.traces):
            scene.solid(trace.surface, COLORS[k], edges=False)
        return Image.fromarray(scene.shot(VIEW, *SIZE).image)


if __name__ == "__main__":
    draw_traces().quantize(128).save(HERE / "traces.png", optimize=True)
    for kind in PADS.values():
        (HERE / f"pad-{kind.name}.svg").write_text(draw_pad(kind), encoding="utf-8")
