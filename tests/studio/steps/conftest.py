"""Devices that are open in the studio, without a network and without a browser."""

from __future__ import annotations

import shutil

import pytest

from defsense_fab.studio.app.device_app import DeviceApp
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from tests.studio.steps.browsers import FakeBrowser, FakeServer


def open_app(folder, trusted=True):
    """Open the device in a folder."""
    app = DeviceApp(FakeServer(), Project(folder), Agreement(trusted=trusted))
    app.server = app.session.server
    app.browser = FakeBrowser(app)
    app.connect(app.browser)
    return app


@pytest.fixture
def app(live_bar, tmp_path):
    """Open a copy of a built bar, which a test may change."""
    shutil.copytree(live_bar.folder, tmp_path / "bar")
    app = open_app(tmp_path / "bar")
    yield app
    app.close()


@pytest.fixture
def made_app(made_bar, tmp_path):
    """Open a copy of a bar with parts, guide and report."""
    shutil.copytree(made_bar, tmp_path / "bar")
    app = open_app(tmp_path / "bar")
    yield app
    app.close()
