"""A studio's page on the smallest built device; browsers are not part of it."""

from __future__ import annotations

import shutil
import socket

import pytest

from defsense_fab.runtime.view.local_page import end_page, local_page
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from tests.pipeline.live.conftest import live_bar as live_bar_fixture
from tests.pipeline.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(autouse=True)
def own_settings(tmp_path, monkeypatch):
    """Tests neither see nor change to which scripts the user has agreed."""
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "settings"))


@pytest.fixture(scope="session")
def studio_server():
    pytest.importorskip("viser")
    made = local_page(free_port(), "test")
    yield made
    end_page(made)


@pytest.fixture
def studio_page(studio_server, live_bar, tmp_path):
    """The page of a copy of a built bar, which a test may change."""
    folder = tmp_path / "bar"
    shutil.copytree(live_bar.folder, folder)
    studio_server.gui.reset()
    studio_server.scene.reset()
    made = StudioPage(studio_server, Project(folder), Agreement(trusted=True))
    yield made
    made.close()
