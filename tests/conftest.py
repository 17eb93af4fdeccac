"""Shared bodies and meshes, made once, and the distribution's Chromium."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.mesh import Surface, TetMesh
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from tests.support.grid import grid_of_tets
from tests.support.shared_folders import fill_once, shared_root

#: Tests that take more than a second have the mark `slow`. Those without it may take longer at the
#: first use, which compiles.
UNMARKED_LIMIT_S = 3.0
UNMARKED = "processor time without the mark"

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


#: Files of more than 25 s, first: one that began last would leave the other worker idle.
LONG_FILES = (
    "workflow/build/test_build.py",
    "studio/browser/test_whole_design.py",
    "studio/browser/test_in_a_browser.py",
    "studio/browser/test_screens.py",
    "docs/test_guide_commands.py",
    "geometry/parts/test_random_layouts.py",
    "capture/sessions/test_long_sessions.py",
    "studio/steps/test_optimize.py",
    "workflow/build/test_fabricate.py",
    "capture/tags/test_edge_fit.py",
    "workflow/reproduce/test_run.py",
    "capture/sessions/test_session.py",
    "geometry/parts/test_parts.py",
    "workflow/test_interface.py",
)


def pytest_collection_modifyitems(items):
    """Long files first, then those with slow tests."""
    tests = Path(__file__).parent
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    order = {tests / name: index for index, name in enumerate(LONG_FILES)}
    items.sort(key=lambda item: (order.get(item.path, len(order)), item.path not in slow))


def processor_time():
    """Return the processor time of this process and its ended children, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Measure tests without the mark `slow`; those above the limit are listed at the end."""
    started_at = processor_time()
    result = yield
    used = processor_time() - started_at
    if used > UNMARKED_LIMIT_S and not item.get_closest_marker("slow"):
        item.user_properties.append((UNMARKED, used))
    return result


def pytest_terminal_summary(terminalreporter):
    rows = {
        report.nodeid: value
        for report in terminalreporter.stats.get("passed", [])
        for name, value in getattr(report, "user_properties", [])
        if name == UNMARKED
    }
    if rows:
        terminalreporter.section("without the mark `slow`, processor time")
    for test, used in sorted(rows.items(), key=lambda row: -row[1]):
        terminalreporter.write_line(f"{used:5.1f} s {test}")


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Tests neither see nor fill the user's cache; workers share theirs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEFSENSE_CACHE", str(shared_root(tmp_path_factory) / "cache"))
        yield


@pytest.fixture(scope="session")
def bar():
    return box_surface([0, -15, -15], [150, 15, 15])


@pytest.fixture(scope="session")
def bar_mesh(bar, tmp_path_factory):
    def write(folder):
        mesh = tetrahedralize(bar, 10.0).mesh
        np.savez(folder / "mesh.npz", nodes=mesh.nodes, tets=mesh.tets)

    with np.load(fill_once(tmp_path_factory, "bar-mesh", write) / "mesh.npz") as arrays:
        return TetMesh(arrays["nodes"], arrays["tets"])


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
