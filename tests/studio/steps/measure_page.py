"""The step Measure with a server that records what is published, without browsers."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np

from defsense_fab.core.errors import DefsenseError
from defsense_fab.studio.project.agreement import Agreement
from defsense_fab.studio.project.project import Project
from defsense_fab.studio.session.device_session import DeviceSession
from defsense_fab.studio.steps.measure.measure_step import MeasureStep
from tests.runtime.live_frames import wait_for

TIMEOUT_S = 600.0


class RecordingServer:
    """A server without browsers; the last event of each kind is kept."""

    def __init__(self):
        self.events, self.arrays, self._lock = {}, {}, threading.Lock()

    def publish(self, event):
        with self._lock:
            self.events[type(event)] = event

    def publish_arrays(self, arrays):
        with self._lock:
            self.arrays[arrays.name] = arrays


class Browser:
    """A browser that keeps what it is sent."""

    def __init__(self):
        self.is_open, self.posted = True, []

    def post(self, key, content):
        self.posted.append((key, content))

    def send(self, event):
        self.posted.append((None, event))


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

    def close(self):
        """Nothing runs."""


class MeasurePage:
    """The step on the device of a folder."""

    def __init__(self, folder):
        self.folder, self.server, self.browser = folder, RecordingServer(), Browser()
        self.session = DeviceSession(self.server, Project(folder), Agreement(trusted=True))
        self.session.jobs = self.jobs = InlineJobs()
        self.models_written = 0
        self.step = MeasureStep(self.session, self._count_model)

    def _count_model(self):
        self.models_written += 1

    def send(self, kind, **content):
        """Send a request, as the browser does."""
        request = kind(id=1, **content)
        return self.step.handlers[kind](self.browser, request)

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


def signals(arrays):
    """Return a frame's signals as numbers."""
    return np.asarray(arrays.arrays["signals"])
