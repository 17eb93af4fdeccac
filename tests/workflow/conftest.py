"""A bar made in Python, simulated and given its cords once."""

import pytest
import trimesh

import defsense_fab as df
from defsense_fab.cli.main import main


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
    return df.optimize(poses)


@pytest.fixture(scope="session")
def saved(device, tmp_path_factory):
    """The device's folder, built by the commands but for its report."""
    folder = tmp_path_factory.mktemp("saved") / "small"
    device.save(folder)
    assert main(["fabricate", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def sessions(saved):
    """Folders of two processed sessions of a minute, as a twin writes them."""
    out = saved.parent / "sessions"
    assert main(["twin", str(saved), "--minutes", "1", "--sessions", "2", "--out", str(out)]) == 0
    return [out / "session-1", out / "session-2"]


@pytest.fixture(scope="session")
def twin(layout):
    """A minute of a simulated built device."""
    return df.record_twin(layout, seconds=60.0, seed=3)


@pytest.fixture(scope="session")
def model(twin, layout):
    return df.train(twin, layout, decoder="affine", in_step=True)
