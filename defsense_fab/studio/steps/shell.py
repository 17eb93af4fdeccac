"""What belongs to no step: the device's state, undo, builds, and the pipeline."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...core.errors import DeviceError
from ...workflow.train.training import MODEL
from ...workflow.view import Client, Request
from ..edits.body import rename_device
from ..messages import shell
from ..session.built_cords import can_move_cords
from ..session.cord_states import cord_states
from ..session.pipeline import LimitState, Progress, pipeline
from ..session.step import Handler, Step
from .build_request import start_build


class ShellStep(Step):
    """Publishes the device and the pipeline, and handles undo and builds.

    Attributes:
        limits: What is known of the limits of the drawn cords; set by the step Sensors.
        is_optimized: Whether the drawn cords are the optimized ones; set by the step Optimize.
        misfit: What of regions and poses is outside the body; set by BodyFitStep.
    """

    limits = LimitState()
    is_optimized = False
    misfit = ""

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        session, project, jobs = self.session, self.session.project, self.session.jobs

        def handler(action: Any) -> Handler:
            return lambda _, __: (action(), None)[1]

        return {
            shell.Undo: handler(project.undo),
            shell.Redo: handler(project.redo),
            shell.Restore: handler(project.restore),
            shell.PauseJob: handler(jobs.pause),
            shell.ResumeJob: handler(jobs.resume),
            shell.CancelJob: handler(jobs.cancel),
            shell.StartBuild: lambda _, request: start_build(session, request),
            shell.Answer: lambda _, request: session.answer(run=request.run),
            shell.RenameDevice: self._rename,
        }

    def _rename(self, _: Client, request: shell.RenameDevice) -> None:
        name = request.name.strip()
        if not name:
            raise DeviceError(
                "a device needs a name", code="name-invalid", action="Enter one", key="name"
            )
        self.session.apply(rename_device(name))

    def on_device_changed(self) -> None:
        session, device = self.session, self.session.device
        session.server.publish(
            shell.DeviceState(
                name=device.name,
                undo_name=session.project.undo_name or "",
                redo_name=session.project.redo_name or "",
                noun=device.cord.noun,
                cord_radius=device.cord.diameter / 2,
                cords=cord_states(device.sensors, session.cord_colors()),
                regions=list(device.regions),
                poses=[pose.name for pose in device.poses],
            )
        )
        self.publish_pipeline()

    def on_build_loaded(self) -> None:
        self.publish_pipeline()

    def on_freshness(self) -> None:
        self.publish_pipeline()

    def show_limits(self, limits: LimitState) -> None:
        """Follow what is known of the limits of the drawn cords."""
        if limits != self.limits:
            self.limits = limits
            self.publish_pipeline()

    def show_optimized(self, is_optimized: bool) -> None:
        """Follow whether the drawn cords are those that the last search found."""
        if is_optimized != self.is_optimized:
            self.is_optimized = is_optimized
            self.publish_pipeline()

    def show_misfit(self, misfit: str) -> None:
        """Follow what of regions and poses lies outside the body."""
        if misfit != self.misfit:
            self.misfit = misfit
            self.publish_pipeline()

    def publish_pipeline(self) -> None:
        """Publish the state of the steps, and what to do next."""
        session, device = self.session, self.session.device
        session.server.publish(
            pipeline(
                Progress(
                    freshness=session.freshness,
                    has_body=session.surface is not None,
                    poses=len(device.poses),
                    cords=len(device.sensors),
                    proposed=device.propose,
                    can_move=can_move_cords(device),
                    limits=self.limits,
                    misfit=self.misfit,
                    is_optimized=self.is_optimized,
                    noun=device.cord.noun,
                    has_model=(session.project.folder / MODEL).exists(),
                )
            )
        )
