"""Fixtures: a small bar created in Python, its simulation, layout, sessions and model."""

from dataclasses import replace

import pytest
import trimesh

import defsense_fab as df
from defsense_fab.cli.main import main


def small_bar(**changes):
    """Return a bar that is bent and twisted, with one locked cord."""
    body = trimesh.creation.box(extents=[80, 20, 20])
    body.apply_translation([40, 0, 0])
    points = [[x, 0] for x in (1, 6, 25, 55, 74, 79)]
    values = {
        "name": "small",
        "body": body,
        "material": "ninjaflex-85a",
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
    return df.Device.create(**(values | changes))


def with_record(model, **changes):
    """Return the model with changes of its record."""
    return replace(model, record=replace(model.record, **changes))


@pytest.fixture(scope="session")
def device():
    return small_bar()


@pytest.fixture(scope="session")
def simulation(device):
    return df.simulate(device)


@pytest.fixture(scope="session")
def layout(simulation):
    return df.optimize(simulation)


@pytest.fixture(scope="session")
def saved(device, tmp_path_factory):
    """Return the device's folder, built by the command line except for its report."""
    folder = tmp_path_factory.mktemp("saved") / "small"
    device.save(folder)
    assert main(["fabricate", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def sessions(saved):
    """Return the folders of two processed sessions of a minute, recorded by the twin."""
    out = saved.parent / "sessions"
    assert main(["twin", str(saved), "--minutes", "1", "--sessions", "2", "--out", str(out)]) == 0
    return [out / "session-1", out / "session-2"]


@pytest.fixture(scope="session")
def twin(layout):
    """Return a recording of a minute of the simulated device."""
    return df.record_twin(layout, minutes=1, seed=3)


@pytest.fixture(scope="session")
def model(twin, layout):
    return df.train(twin, layout, decoder="affine", is_synchronized=True)
