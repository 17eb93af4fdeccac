"""The step Body: the body follows its parameters, and the device its fields."""

from __future__ import annotations

import threading
import tomllib
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from ....core.device.device import Device
from ....core.errors import BodyError, DefsenseError
from ....core.mesh import Surface
from ....workflow.build.results import Build
from ....workflow.view import Client, Problem, Request
from ...background.background_job import CANCELLED
from ...edits.body import reset_parameter, set_parameter
from ...messages import body as messages
from ...session.device_session import DeviceSession
from ...session.job_strip import Work
from ...session.step import Handler, Step
from .body_preview import body_key, make_body, preview_folder
from .catalogues import catalogue_choices, catalogues, row_edit
from .fields import device_fields, field_edit, reset_edit
from .parameters import body_parameters, checked_value

_JOB = "body"
_State = Literal["idle", "making", "waiting", "stopped", "not-agreed", "failed"]


class BodyStep(Step):
    """Edits what the device is made of, and makes its body without a build.

    Args:
        session: The device.

    Attributes:
        status: What was published last of the body, or None.
    """

    def __init__(self, session: DeviceSession) -> None:
        super().__init__(session)
        self.status: messages.BodyStatus | None = None
        self._lock = threading.RLock()
        self._state: _State = "idle"
        self._problem: Problem | None = None
        self._body_key: object = None  # settings of the last body that was made or requested
        self._script_stamp: object = _file_stamp(session.device)
        self._has_tried = self._is_outdated = False
        self._should_restart = self._is_closed = False
        session.server.publish(catalogues())

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {
            messages.MakeBody: lambda _, __: self.make(),
            messages.StopBody: lambda _, __: self.stop(),
            messages.SetParameter: self._set_parameter,
            messages.ResetParameter: lambda _, r: self.session.apply(reset_parameter(r.name)),
            messages.ChooseRow: lambda _, r: self.session.apply(row_edit(r.catalogue, r.name)),
            messages.SetField: lambda _, r: self.session.apply(
                field_edit(r.key, r.value, self.session.device, self.session.newest_surface)
            ),
            messages.ResetField: lambda _, r: self.session.apply(reset_edit(r.key)),
        }

    def on_device_changed(self) -> None:
        device = self.session.device
        self._publish_fields()
        with self._lock:
            before, self._body_key = self._body_key, body_key(device)
            self._is_outdated |= before is not None and before != self._body_key

    def on_build_loaded(self) -> None:
        self._publish_status()

    def on_freshness(self) -> None:
        """Remove the preview of a body that is built, or make the body that has changed."""
        if self.session.freshness.get("body") == "current":
            with self._lock:
                self._is_outdated = self._should_restart = False
                is_making = self._state == "making"
                self._state, self._problem = "idle", None
            if is_making:
                self._cancel()
            self._show_preview(None)
        elif self._is_outdated:
            self._follow()

    def connect(self, client: Client) -> None:  # noqa: ARG002 - the same for all browsers
        """Make the first body, unless its script needs an agreement."""
        is_first = self.session.surface is None and not self._has_tried
        if is_first and not self._must_ask():
            self.make()

    def poll(self) -> None:
        """Follow changes of the script by another program, and the end of another job."""
        before, self._script_stamp = self._script_stamp, _file_stamp(self.session.device)
        if before != self._script_stamp:
            self._publish_fields()
            self._is_outdated = True
            self.session.check_freshness()
        if self._state == "waiting" and not self.session.jobs.is_running:
            self._follow()

    def close(self) -> None:
        self._is_closed = True

    def make(self, has_changed: bool = False) -> None:
        """Make the body in the background, after asking whether its script may run.

        Args:
            has_changed: Whether a body that is being made now is outdated, and made again.

        Raises:
            BodyError: The script cannot be read.
        """
        with self._lock:
            self._has_tried, self._is_outdated = True, False
            if not self.session.may_run_script(self.make):
                self._set_state("not-agreed")
                return
            if self._state == "making":
                if has_changed:
                    self._should_restart = True
                    self._cancel()
            elif self.session.jobs.is_running:
                self._set_state("waiting")
            else:
                self._start()

    def stop(self) -> None:
        """Stop the script, which may run forever."""
        with self._lock:
            self._should_restart = False
            if self._state == "making":
                self._cancel()
            elif self._state == "waiting":
                self._set_state("stopped")

    def _start(self) -> None:
        self._set_state("making")
        try:
            self.session.jobs.start(
                Work(
                    name=_JOB,
                    title="Make the body",
                    job=make_body,
                    arguments=(self.session.project.folder,),
                    on_end=self._end,
                    gives_way=True,
                )
            )
        except DefsenseError as error:
            if error.code == "job-running":  # another thread was faster
                self._set_state("waiting")
            else:
                self._set_state("failed", error)

    def _cancel(self) -> None:
        if self.session.jobs.job.name == _JOB:
            self.session.jobs.cancel()

    def _end(self, error: DefsenseError | None, _: object = None) -> None:
        """Handle the end of the job: load the surface, show the error, or start again."""
        if self._is_closed:
            return
        with self._lock:
            was_stopped = error is not None and error.code == CANCELLED
            if self._should_restart:
                self._should_restart = False
                self._start()
                return
            if was_stopped:
                if self._state == "making":  # otherwise the built body is current
                    self._set_state("waiting" if self.session.jobs.is_replacing else "stopped")
                return
            if error is not None:
                self._set_state("failed", error)
                return
        self._load()

    def _load(self) -> None:
        try:
            surface = Build(preview_folder(self.session.project.folder)).surface
        except (DefsenseError, OSError, ValueError, KeyError) as error:
            self._set_state(
                "failed",
                BodyError(f"cannot be read: {error}", code="file-unreadable", where="the body"),
            )
            return
        self._state, self._problem = "idle", None
        if self.session.is_built:
            self._show_preview(surface)
        else:
            self.session.show_surface(surface)
        self.session.check_freshness()

    def _follow(self) -> None:
        """Make the changed body, if its script may run."""
        self._is_outdated = False
        if self._must_ask():
            self._set_state("not-agreed")
        else:
            self.make(has_changed=True)

    def _must_ask(self) -> bool:
        try:
            return self.session.agreement.script_to_confirm(self.session.device.body) is not None
        except DefsenseError:
            return True

    def _set_parameter(self, _: Client, request: messages.SetParameter) -> None:
        value = checked_value(self.session.device.body, request.name, request.value)
        self.session.apply(set_parameter(request.name, value))

    def _show_preview(self, surface: Surface | None) -> None:
        self.session.show_preview(surface)
        self._publish_status()

    def _set_state(self, state: _State, error: DefsenseError | None = None) -> None:
        self._state = state
        self._problem = None if error is None else Problem.of(error)
        self._publish_status()

    def _publish_fields(self) -> None:
        device, server = self.session.device, self.session.server
        document = tomllib.loads(self.session.project.text)
        server.publish(body_parameters(device.body))
        server.publish(
            messages.DeviceFields(
                choices=catalogue_choices(device, document), groups=device_fields(device, document)
            )
        )

    def _publish_status(self) -> None:
        surface = self.session.newest_surface
        status = messages.BodyStatus(
            state=self._state,
            text=_status_text(self._state, self.session.device),
            problem=self._problem,
            size=None if surface is None else np.ptp(surface.vertices, axis=0).tolist(),
            volume=0.0 if surface is None else surface.volume,
            is_preview=self.session.preview is not None,
        )
        if status != self.status:
            self.status = status
            self.session.server.publish(status)


def _status_text(state: _State, device: Device) -> str:
    file = device.body.path.name
    texts: dict[_State, str] = {
        "making": "The body is being made",
        "waiting": "The body is made when the running job has ended",
        "stopped": "Stopped. The body shown is an earlier one",
        "not-agreed": f"{file} has not run yet. Make the body to allow it",
    }
    return texts.get(state, "")


def _file_stamp(device: Device) -> Any:
    """Return the time and size of the body's file, which differ after a change."""
    try:
        status = device.body.path.stat()
    except OSError:
        return ()
    return (status.st_mtime_ns, status.st_size)
