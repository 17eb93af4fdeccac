"""Pages of the studio on small built devices, without a browser."""

from __future__ import annotations

import shutil
import socket

import pytest

from defsense_fab.cli.main import main
from defsense_fab.runtime.view.page_server import close_page, serve_page
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.support.body_scripts import write_bar
from tests.support.places import BAR
from tests.support.shared_folders import fill_once
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(autouse=True)
def own_settings(tmp_path, monkeypatch):
    """Keep tests away from the agreements of the user."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))


@pytest.fixture(scope="session")
def studio_server():
    pytest.importorskip("viser")
    server = serve_page(free_port(), "test")
    yield server
    close_page(server)


def make_bar(folder):
    """Write a coarse bar with two locked cords, and build it up to the report."""
    write_bar(folder)
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    for old, new in (
        ("edge_length = 8.0", "edge_length = 15.0"),
        ("markers = 40", "markers = 8"),
        ("ramp = [0.25, 0.5, 0.75, 1.0]", "ramp = [0.5, 1.0]"),
        ('free = ["path", "plane"]\n', ""),
        ("[fabrication]", '[design]\ndecoder = "affine"\nsearches = 1\n\n[fabrication]'),
    ):
        assert old in text
        text = text.replace(old, new)
    down, twist = text.index('[[poses]]\nname = "bend_down"'), text.index('[[poses]]\nname = "twi')
    text = text[:down] + text[twist:]
    (folder / "device.toml").write_text(text[: text.rindex("[[sensors]]")], encoding="utf-8")
    assert main(["build", str(folder)]) == 0


@pytest.fixture(scope="session")
def made_bar(tmp_path_factory):
    """Return the folder of a bar that the command line has built."""
    return fill_once(tmp_path_factory, "made-bar", make_bar)


@pytest.fixture
def made_page(studio_server, made_bar, tmp_path):
    """Open the page of a copy of the built bar."""
    yield from page_of(studio_server, made_bar, tmp_path / "bar")


@pytest.fixture
def studio_page(studio_server, live_bar, tmp_path):
    """Open the page of a copy of a built bar, which a test may change."""
    yield from page_of(studio_server, live_bar.folder, tmp_path / "bar")


def page_of(studio_server, built, folder):
    shutil.copytree(built, folder)
    studio_server.gui.reset()
    studio_server.scene.reset()
    page = StudioPage(studio_server, Project(folder), Agreement(trusted=True))
    yield page
    page.close()
