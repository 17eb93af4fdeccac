"""A design from an empty folder to exported parts, by mouse and keyboard only."""

from __future__ import annotations

import hashlib
import shutil
import sys
import zipfile

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.studio.page.studio import Studio
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.workflow.build.build import build
from tests.studio.browser.conftest import around_arc, drag_until, new_context, until
from tests.studio.browser.person import Person

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]
SIZE = {"width": 1000, "height": 700}
BUILD_TIMEOUT_S = 600.0  # on a loaded machine


@pytest.fixture
def page(browser):
    with new_context(browser, viewport=SIZE, accept_downloads=True) as context:
        page = context.new_page()
        page.set_default_timeout(240_000)
        yield page


@pytest.fixture
def studio(studio_server, tmp_path):
    studio = Studio(studio_server, tmp_path / "arm", Agreement())
    yield studio
    studio.close()


def build_by(person, label, studio):
    """Press a button that builds, and wait for the end without an error."""
    bench, errors = studio.page.bench, []
    bench.on_build_loaded.append(lambda: errors.append(bench.build_error))
    person.press(label)
    assert until(lambda: errors, BUILD_TIMEOUT_S), label
    assert errors == [None]


def hashes(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.glob("*.st*")}


def test_a_device_is_designed_and_exported(page, studio_server, studio, tmp_path):
    page.goto(f"http://127.0.0.1:{studio_server.get_port()}")
    person = Person(page)

    person.press("Start with the bar")
    page.get_by_text("Made by").wait_for()
    device = lambda: studio.page.bench.project.device  # noqa: E731
    person.write("Edge length, mm", "20")
    assert until(lambda: device().mesh.edge_length == 20)
    person.choose("Decoder", "affine")  # one decoder takes a quarter of the time
    assert until(lambda: device().decoder == "affine")
    person.write("Searches", "1")  # also to save time
    assert until(lambda: device().searches == 1)

    person.press("Poses")
    build_by(person, "Mesh the body", studio)
    for left in (2, 1, 0):
        person.press("Delete")
        assert until(lambda left=left: len(device().poses) == left)
    for count, axis in ((1, 1), (2, 2)):
        person.press("New")
        assert until(lambda count=count: len(device().poses) == count)
        before = device().poses[-1].handles[0].rotation.copy()

        def turn_the_tip(axis=axis):
            (client,) = studio_server.get_clients().values()
            gizmo = studio_server.scene.get_handle_by_name("/grips/tip")
            person.drag(around_arc(client, gizmo, axis))

        assert drag_until(
            page,
            turn_the_tip,
            lambda b=before: not np.allclose(device().poses[-1].handles[0].rotation, b),
        )

    person.press("Optimize")
    build_by(person, "Simulate the poses", studio)

    person.press("Cords")
    while device().sensors:
        count = len(device().sensors)
        person.choose("Cord", device().sensors[0].name)
        person.press("Delete the cord")
        assert until(lambda count=count: len(device().sensors) == count - 1)
    person.press("Draw by hand")
    for count, level in enumerate((-30, 30), start=1):
        stroke = [(40 + 30 * k, 350 + level + 8 * np.sin(k / 3)) for k in range(21)]
        assert drag_until(
            page,
            lambda stroke=stroke: person.drag(stroke),
            lambda count=count: len(device().sensors) == count,
        )
    person.press("End drawing")

    person.press("Optimize")
    build_by(person, "Optimize the cords", studio)
    person.press("Take the optimized cords")
    assert until(lambda: studio.page.bench.project.undo_name == "take the optimized cords")

    # A build continues from the layout of the build before it.
    copy = tmp_path / "elsewhere"
    shutil.copytree(tmp_path / "arm", copy)
    person.press("Make")
    build_by(person, "Build everything", studio)
    with page.expect_download() as sent:
        person.press("Export as a zip")
    zipped = tmp_path / "export.zip"
    sent.value.save_as(zipped)

    build(load_device(copy), "fabricate")
    with zipfile.ZipFile(zipped) as whole:
        whole.extractall(tmp_path / "out")
    (exported,) = (p for p in (tmp_path / "out").rglob("parts") if p.is_dir())
    assert hashes(exported) == hashes(copy / "build" / "parts") != {}
    summary = f"{person.clicks} clicks, {person.keys} keys, {person.minutes:.1f} minutes"
    sys.stdout.write(f"{summary}\n")  # with pytest -s
