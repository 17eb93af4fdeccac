"""Random requests are answered or refused, and leave a device that can be read."""

from __future__ import annotations

import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DefsenseError
from defsense_fab.studio.app.studio_app import StudioApp
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.session.job_strip import JobStrip
from defsense_fab.studio.steps.measure.guided_runs import GuidedRuns
from defsense_fab.studio.steps.measure.live_runs import LiveRuns
from tests.studio.random_requests import RandomRequests
from tests.studio.steps.browsers import FakeBrowser, FakeServer

WAIT_S = 120.0
COUNT = 150
#: Requests that leave the device or take seconds.
WITHOUT = {
    *("upload", "close-device", "create-from-gallery", "create-from-body", "propose"),
    *("follow-ramp", "state-shape", "search-next-cord", "export-device"),
}


@pytest.fixture
def studio(live_bar, tmp_path, monkeypatch):
    """Open a copy of a built bar; no process and no guided run is started."""
    for kind in (JobStrip, GuidedRuns, LiveRuns):
        monkeypatch.setattr(kind, "start", lambda *_: None)
    shutil.copytree(live_bar.folder, tmp_path / "inner" / "bar")
    studio = StudioApp(FakeServer(), tmp_path / "inner" / "bar", Agreement(trusted=True))
    yield studio
    studio.close()


def known_names(device):
    cords, regions = [s.name for s in device.sensors], list(device.regions)
    poses = [p.name for p in device.poses]
    names = {field: cords for field in ("cord", "cords", "first", "second", "replaces")}
    return {**names, "region": regions, "regions": regions, "pose": poses, "poses": poses,
            "name": cords + regions + poses + ["length"]}  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_random_requests_raise_no_unknown_error(studio, seed, tmp_path):
    browser, answered = FakeBrowser(studio), 0
    studio.connect(browser)
    before = {path.name for path in tmp_path.iterdir()}
    requests = RandomRequests(seed, known_names(studio.device.session.device), WITHOUT)
    for _ in range(COUNT):
        content = requests.next()
        content.pop("id")
        kind = content.pop("kind")
        try:
            browser.ask(kind, **content)
            answered += 1
        except DefsenseError:
            continue
        except Exception as error:  # the request belongs to the report of the test
            raise AssertionError(f"{kind}: {content}") from error
    assert 0.1 * COUNT < answered < 0.9 * COUNT
    assert studio.device.session.wait(WAIT_S)
    assert all(step.wait(WAIT_S) for step in studio.device.steps if hasattr(step, "wait"))
    device = load_device(studio.folder, complete=False)
    assert device.name == studio.device.session.device.name
    assert {path.name for path in tmp_path.iterdir()} == before
    assert {path.name for path in studio.folder.parent.iterdir()} == {"bar"}
