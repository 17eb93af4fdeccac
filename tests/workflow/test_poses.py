"""Test that Python values can express all that a device's file can."""

import numpy as np
import pytest
import trimesh

import defsense_fab as df
from defsense_fab.core.device.device_file import parse_device
from tests.support.errors import raises

_FILE = """
schema = 1
name = "all"

[body]
mesh = "body.stl"
scale = 2.0

[material]
name = "own"
model = "yeoh"
c10 = 0.1
c20 = 0.02
c30 = 0.003
poisson_ratio = 0.49

[mesh]
edge_length = 8.0

[regions]
base = { half_space = { origin = [5, 0, 0], normal = [-1, 0, 0] } }
tip = { cylinder = { start = [74, 0, 0], end = [81, 0, 0], radius = 15 } }
side = { box = [[20, 9, -11], [60, 11, 11]] }

[[poses]]
name = "hinged"
fixed = ["base"]
handles = [
    { region = "tip", translate = [0, "free", 4], rotate = { axis = [0, 2, 0], degrees = "free" } },
    { region = "side", rotate = "free", translate = "free" },
]

[[poses]]
name = "turned"
fixed = ["base"]

[[poses.handles]]
region = "tip"
rotate = { axis = [1, 0, 0], degrees = 270, about = [80, 1, 0] }
translate = [1, 2, 3]

[[poses]]
name = "loaded"
symmetry = [{ region = "base", normal = [1, 0, 0] }]
drags = [{ at = [80, 0, 10], by = [0, 0, 6], stiffness = 0.5 }]
pressures = [{ region = "side", value = 0.01 }]
gravity = [0, 0, -1]

[states]
ramp = [0.5, 1.0]
mixtures = [{ hinged = 0.5, turned = 0.5 }]
held_out = [{ hinged = 1.0, loaded = 0.25 }]

[outputs]
markers = [[80, 0, 10], [40, 0, 10]]
anchor = "base"

[cord]
name = "rubber-2mm"
length = [20, 200]

[fabrication]
process = "fdm-tpu"

[design]
sensors = 2

[[sensors]]
name = "top"
plane = { origin = [0, 0, 6], normal = [0, 0, 1], x_axis = [1, 0, 0] }
control_points = [[1, 0], [25, 0], [55, 1], [79, 0]]
tangents = [[20, 0], [20, 1], [20, 0], [20, 0]]
free = ["path", "offset"]
"""


def same(one, other):
    """Whether two records are equal, with the arrays that they contain."""
    if hasattr(one, "__dataclass_fields__"):
        return type(one) is type(other) and same(vars(one), vars(other))
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other


def test_device_from_python_equals_the_one_from_its_file():
    box = trimesh.creation.box(extents=[40, 10, 10])
    box.apply_translation([20, 0, 0])
    device = df.Device.create(
        "all", box, "own",
        regions={
            "base": df.half_space([5, 0, 0], [-1, 0, 0]),
            "tip": df.cylinder([74, 0, 0], [81, 0, 0], 15),
            "side": df.box([20, 9, -11], [60, 11, 11]),
        },
        poses=[
            df.Pose("hinged", ["base"], [
                df.Handle("tip", np.array([0, 2, 0]), "free", (0, "free", 4)),
                df.Handle("side", "free", translate="free"),
            ]),
            df.Pose("turned", ["base"], [
                df.Handle("tip", (1, 0, 0), 270, np.array([1, 2, 3]), about=(80, 1, 0)),
            ]),
            df.Pose(
                "loaded", symmetry=[df.Symmetry("base", (1, 0, 0))],
                drags=[df.Drag((80, 0, 10), (0, 0, 6), 0.5)],
                pressures=[df.Pressure("side", np.float64(0.01))], gravity=(0, 0, -1),
            ),
        ],
        cords=[df.DrawnCord(
            "top", [[1, 0], [25, 0], [55, 1], [79, 0]], [0, 0, 6], [0, 0, 1], [1, 0, 0],
            free=["path", "offset"], tangents=np.array([[20, 0], [20, 1], [20, 0], [20, 0]]),
        )],
        sensors=2, edge_length=8.0, anchor="base",
        values={
            "body.scale": 2.0, "material.model": "yeoh", "material.c10": 0.1, "material.c20": 0.02,
            "material.c30": 0.003, "material.poisson_ratio": 0.49, "states.ramp": [0.5, 1.0],
            "states.mixtures": [{"hinged": 0.5, "turned": 0.5}],
            "states.held_out": [{"hinged": 1.0, "loaded": np.float32(0.25)}],
            "outputs.markers": [[80, 0, 10], [40, 0, 10]], "cord.length": np.array([20, 200]),
        },
    )  # fmt: skip
    read = parse_device(_FILE, device.record.source)
    assert same(device.record, read)


def test_handle_with_a_free_axis_and_degrees_is_refused():
    with raises(df.DefsenseError, "axis-contradictory", region="tip"):
        df.Handle("tip", "free", 20.0).table()


@pytest.mark.parametrize(
    ("handle", "key"),
    [
        (df.Handle("tip", "fre"), "rotate"),
        (df.Handle("tip", translate=(0, "fre", 0)), "translate"),
        (df.Handle("tip", (0, 0, 1), "fre"), "rotate.degrees"),
    ],
)
def test_invalid_handle_is_refused(device, handle, key):
    with raises(df.DefsenseError, "value-type", key=f"poses.1.handles.1.{key}"):
        device.changed({"poses.bend.handles": [handle.table()]})
