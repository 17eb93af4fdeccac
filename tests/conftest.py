"""Shared bodies and meshes, made once, and the distribution's Chromium."""

import os
import shutil

import numpy as np
import pytest
from hypothesis import settings

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from tests.support.grid import grid_of_tets

# The same examples on every run: what fails once in twenty runs says nothing of the change at hand.
# `--hypothesis-profile=random` looks for others.
settings.register_profile("same", derandomize=True)
settings.register_profile("random")
settings.load_profile("same")


def box_surface(low, high):
    """A closed box of 12 triangles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    low, high = np.array(low, float), np.array(high, float)
    return Surface(low + corners * (high - low), faces)


def structured_bar(low, high, counts):
    """A box of counts[0] x counts[1] x counts[2] cells of six tets each: the same on every run."""
    axes = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    return grid_of_tets(axes)


def pytest_collection_modifyitems(items):
    """Files with slow tests first: one that began last would leave the other worker idle."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Tests neither see nor fill the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEFSENSE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def bar():
    return box_surface([0, -15, -15], [150, 15, 15])


@pytest.fixture(scope="session")
def bar_mesh(bar):
    return tetrahedralize(bar, 10.0).mesh


@pytest.fixture
def straight():
    """A straight cord along the bar at a height, free in path and plane."""

    def make(name="cord", y=0.0, z=0.0, free=("path", "plane")):
        points = np.array([[x, 0.0] for x in (2, 10, 36, 62, 88, 114, 140, 148)])
        plane = Plane.from_normal(np.array([0, y, z]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
        return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset(free))

    return make


@pytest.fixture(scope="session")
def launch_browser():
    """Starts a Chromium with these switches; playwright runs once for all."""
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium is installed")
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
    with playwright.sync_playwright() as running:
        yield lambda *switches: running.chromium.launch(
            executable_path=chromium, args=[*switches, *sandbox]
        )


@pytest.fixture(scope="session")
def browser(launch_browser):
    """Without a graphics card: WebGL is drawn by the processor."""
    made = launch_browser(
        "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"
    )
    yield made
    made.close()
