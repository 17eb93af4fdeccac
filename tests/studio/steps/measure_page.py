"""The step Measure with a server that records what is published, without browsers."""

from __future__ import annotations

import json
from types import SimpleNamespace

import msgspec

from defsense_fab.core.errors import DefsenseError
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.session.device_session import DeviceSession
from defsense_fab.studio.steps.measure.measure_step import MeasureStep
from tests.runtime.live_frames import wait_for
from tests.studio.steps.browsers import FakeBrowser, FakeServer

TIMEOUT_S = 600.0

SPECIMEN = {
    "length": 150.0,
    "thickness": 8.0,
    "channels": {"inner": 2.0},
    "jigs": [{"radius": r} for r in (None, 75.0, 100.0, 150.0)],
}


def write_specimen(folder):
    """Write the file of a specimen that is to be measured."""
    (folder / "specimen").mkdir()
    (folder / "specimen" / "specimen.json").write_text(json.dumps(SPECIMEN), encoding="utf-8")


def write_session(folder, layout, device="bar", *, is_processed=True):
    """Write the files of a session that are read before it is used for training."""
    folder.mkdir()
    manifest = {
        "schema": 1,
        "device": device,
        "begun": "2026-11-25",
        "channels": ["a"],
        "reference": [1.0],
        "steps": [],
        "unit": "1",
        "layout": layout,
    }
    (folder / "session.json").write_text(json.dumps(manifest), encoding="utf-8")
    if is_processed:
        (folder / "quality.json").write_text('{"frames": 90, "seconds": 3.0}', encoding="utf-8")
        (folder / "aligned.csv").write_text("", encoding="utf-8")


class WatchingBrowser(FakeBrowser):
    """A browser that keeps the binary messages that are posted to it."""

    def __init__(self, app):
        super().__init__(app)
        self.posted = []

    def post(self, key, content):
        self.posted.append((key, content))


class InlineJobs:
    """Runs jobs at once, in this process."""

    is_running = False

    def __init__(self):
        self.titles = []

    def start(self, work):
        self.titles.append(work.title)
        reporter = SimpleNamespace(stage_progress=lambda *_: None)
        try:
            result = work.job(reporter, *work.arguments)
        except DefsenseError as error:
            work.on_end(error, None)
        else:
            work.on_end(None, result)

    def forget_problem(self):
        """No problem is kept."""

    def close(self):
        """Nothing runs."""


class MeasurePage:
    """The step on the device of a folder."""

    def __init__(self, folder):
        self.folder, self.server, self.browser = folder, FakeServer(), WatchingBrowser(self)
        self.session = DeviceSession(self.server, Project(folder), Agreement(trusted=True))
        self.session.jobs = self.jobs = InlineJobs()
        self.models_written = 0
        self.step = MeasureStep(self.session, self._count_model)

    def _count_model(self):
        self.models_written += 1

    def send(self, kind, **content):
        """Send a request, as the browser does."""
        request = json.loads(msgspec.json.encode(kind(id=0, **content)))
        name = request.pop("kind")
        del request["id"]
        return self.browser.ask(name, **request)

    def handle(self, client, request):
        """Handle a request, as the application does."""
        return self.step.handlers[type(request)](client, request)

    def refusal(self, kind, **content):
        """Send a request and return the code of its refusal."""
        try:
            self.send(kind, **content)
        except DefsenseError as error:
            return error.code
        return ""

    def status(self, task):
        return self.step.board.task(task)

    @property
    def results(self):
        return self.step.board.results

    def refresh(self):
        self.step.refresh()
        assert self.step.wait(TIMEOUT_S)
        return self.step.choices

    def wait_for_screen(self):
        """Wait until a guided run shows its first state; return its screen."""
        guided = self.step.guided
        assert wait_for(lambda: guided.screen is not None or not guided.is_busy)
        screen = guided.screen
        assert screen is not None, self.step.board.status
        assert wait_for(lambda: screen.view is not None)
        return screen

    def close(self):
        self.step.close()
        self.session.close()
