"""A bar made in Python, simulated and given its cords once."""

import pytest
import trimesh

import defsense_fab as df


def small_bar(**changes):
    """Bent and twisted, with one cord that stays where it is."""
    body = trimesh.creation.box(extents=[80, 20, 20])
    body.apply_translation([40, 0, 0])
    points = [[x, 0] for x in (1, 6, 25, 55, 74, 79)]
    given = {
        "name": "small",
        "body": body,
        "material": "tango-black-plus",
        "regions": {
            "base": df.half_space([5, 0, 0], [-1, 0, 0]),
            "tip": df.box([74, -11, -11], [81, 11, 11]),
        },
        "poses": [
            df.Pose("bend", ["base"], [df.Handle("tip", (0, 1, 0), 20.0, "free")]),
            df.Pose("twist", ["base"], [df.Handle("tip", (1, 0, 0), 30.0, "free")]),
        ],
        "cords": [df.DrawnCord("top", points, [0, 0, 6], [0, 0, 1], [1, 0, 0], free=())],
        "edge_length": 12.0,
        "values": {"states.ramp": [0.5, 1.0], "outputs.markers": 10, "design.decoder": "affine"},
    }
    return df.Device.create(**(given | changes))


@pytest.fixture(scope="session")
def device():
    return small_bar()


@pytest.fixture(scope="session")
def poses(device):
    return df.simulate(device)


@pytest.fixture(scope="session")
def layout(poses):
    return df.optimise(poses)
