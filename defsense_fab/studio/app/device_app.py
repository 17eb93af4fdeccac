"""The page of a device: its steps, and the requests that they handle."""

from __future__ import annotations

from typing import Any

from ...core.errors import DefsenseError
from ...workflow.view import Client, Download, Problem, Request, WebServer
from ..project.agreement import Agreement
from ..project.project import Project
from ..session.cord_check import CordCheck
from ..session.device_session import DeviceSession
from ..session.step import Handler, Step
from ..steps.body.step import BodyStep
from ..steps.body_fit import BodyFitStep
from ..steps.inside.inside_step import InsideStep
from ..steps.make.step import MakeStep
from ..steps.measure.measure_step import MeasureStep
from ..steps.optimize.step import OptimizeStep
from ..steps.poses.poses_step import PosesStep
from ..steps.propose import ProposeStep
from ..steps.sensors import SensorsStep
from ..steps.shell import ShellStep


class DeviceApp:
    """The steps of one device; all browsers see the same device.

    Args:
        server: Sends events and arrays to the browsers.
        project: The folder of the device.
        agreement: The scripts that the user has agreed to run.

    Attributes:
        session: The device, its build and the work in the background.
        steps: The steps.
        check: Makes the drawn cords on trial.
    """

    def __init__(
        self, server: WebServer, project: Project, agreement: Agreement | None = None
    ) -> None:
        self.session = DeviceSession(server, project, agreement)
        shell = ShellStep(self.session)
        self.check = check = CordCheck(self.session)
        self.steps: tuple[Step, ...] = (
            shell,
            BodyStep(self.session),
            BodyFitStep(self.session, shell.show_misfit),
            PosesStep(self.session),
            SensorsStep(self.session, check, shell.show_limits),
            ProposeStep(self.session, check),
            InsideStep(self.session),
            OptimizeStep(self.session, check, shell.show_optimized),
            MakeStep(self.session),
            MeasureStep(self.session, shell.publish_pipeline),
        )
        self._handlers: dict[type[Request], Handler] = {}
        for step in self.steps:
            self._handlers.update(step.handlers)
            self.session.on_device_changed.append(step.on_device_changed)
            self.session.on_build_loaded.append(step.on_build_loaded)
            self.session.on_body_changed.append(step.on_body_changed)
            self.session.on_freshness.append(step.on_freshness)
        self.session.load()
        for step in self.steps:
            step.on_device_changed()

    def poll(self) -> Problem | None:
        """Follow changes by other programs; return the problem of a file that cannot be read."""
        problem = None
        try:
            self.session.project.refresh()
        except DefsenseError as error:
            problem = Problem.of(error)
        for step in self.steps:
            try:
                step.poll()
            except Exception as error:  # shown on the page: the studio continues
                self.session.show_error(error)
        return problem

    def connect(self, client: Client) -> None:
        """Greet a browser."""
        for step in self.steps:
            step.connect(client)

    def disconnect(self, client: Client) -> None:
        """Forget a browser."""
        for step in self.steps:
            step.disconnect(client)

    def handle(self, client: Client, request: Request) -> Any:
        """Handle a request. Raises DefsenseError."""
        handler = self._handlers.get(type(request))
        if handler is None:
            raise DefsenseError(f"{type(request).__name__} is not expected", code="not-expected")
        return handler(client, request)

    def download(self, path: str) -> Download | None:
        """Return the file at a path below `/files/`, or None."""
        for step in self.steps:
            found = step.download(path)
            if found is not None:
                return found
        return None

    def close(self) -> None:
        """End all running work."""
        self.check.close()
        for step in self.steps:
            step.close()
        self.session.close()
