"""A small bar with a build written by hand: all that its twin reads, without an optimization."""

import shutil

import numpy as np
import pytest

from defsense_fab.core.curve import arc_lengths
from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.meshing.region_conforming import conform_to_regions
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.store.body import BodyRecord, save_body
from defsense_fab.store.layout import (
    CordRecord,
    LayoutRecord,
    LimitsRecord,
    PlaneRecord,
    Prediction,
    PredictionRecord,
    save_layout,
)
from defsense_fab.store.mesh import MeshRecord, save_mesh
from tests.conftest import box_surface
from tests.store.layouts import BAND
from tests.support.places import BAR
from tests.support.shared_folders import fill_once

EDGE = 20.0


def make_cord(channel, y, z):
    path = np.array([[x, y, z] for x in np.linspace(8, 142, 100)])
    plane = PlaneRecord(np.array([0, y, z]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    points = path[::33, :2] - [0, y]
    tangents = np.gradient(points, axis=0)
    return CordRecord(
        f"cord_{channel + 1}", plane, points, tangents, channel, path,
        float(arc_lengths(path)[-1]), 100.0, 3.0, (1.0, 1.0), 2.0, 0.1, -0.1, path, 0.0, 0.08,
        0.002,
    )  # fmt: skip


def write_build(folder, device):
    build = folder / "build"
    (build / "body").mkdir(parents=True)
    surface = box_surface([0, -15, -15], [150, 15, 15])
    bounds = np.array([[0, -15, -15], [150, 15, 15]], float)
    save_body(build, BodyRecord(135000.0, False, (), bounds, None), surface)
    mesh = conform_to_regions(tetrahedralize(surface, EDGE).mesh, list(device.regions.values()))
    record = MeshRecord("hand", EDGE, len(mesh.tets), len(mesh.nodes), 10.0, 0.0, 0.0)
    save_mesh(build, mesh, {}, record)
    cords = (make_cord(0, 6.0, 9.0), make_cord(1, -6.0, -9.0))
    prediction = Prediction(
        "affine", (0.002, 0.002), 1.0, 1.0, 1, "held out", 1.0, 1.0, 1.0, 1.0, 1.0, {}, {}
    )
    layout = LayoutRecord(
        device.name, "hand", LimitsRecord(2.0, 5.0, 5.0), None, cords, None, (), (), prediction,
        {"affine": 1.0}, {"affine": 1.0},
        BAND, prediction, (), False, (), 1,
    )  # fmt: skip
    markers = surface.scatter(8, np.random.default_rng(0))
    save_layout(
        build, layout, PredictionRecord(markers, ("rest",), np.zeros((1, 2)), np.zeros((1, 8)), {})
    )


def make_small_bar(folder):
    """Write the device and its build into a folder."""
    shutil.copy(BAR / "bar.py", folder)
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    down, twist = text.index('[[poses]]\nname = "bend_down"'), text.index('[[poses]]\nname = "twi')
    text = text[:down] + text[twist:]
    text = text[: text.rindex("[[sensors]]")].replace("markers = 40", "markers = 8")
    (folder / "device.toml").write_text(text)
    write_build(folder, load_device(folder))


@pytest.fixture(scope="session")
def small_bar(tmp_path_factory):
    """Return the folder of a bar that is bent up and twisted, with two cords and eight markers."""
    made = fill_once(tmp_path_factory, "small-bar", make_small_bar)
    return shutil.copytree(made, tmp_path_factory.mktemp("twin") / "bar")
