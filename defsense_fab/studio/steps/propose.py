"""Search for another cord, show how far the search is, and add the cord."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from ...core.device.sensor_tables import new_sensor_names
from ...core.errors import DefsenseError
from ...workflow.view import Client, Request
from ..background.background_job import CANCELLED
from ..edits import cords as edits
from ..messages import sensors as messages
from ..session.computed_edit import EditBasis
from ..session.cord_check import CordCheck
from ..session.device_session import DeviceSession
from ..session.step import Handler, Step
from .judgement import simulated_judge
from .makeable_proposal import makeable_proposal

_JOB_END_S = 30.0  # in which the results of a job that has ended are read
_WAIT_S = 0.2  # between two looks at whether a search was canceled


class ProposeStep(Step):
    """Adds the cord that lowers the error most, for each browser that asks for one.

    Args:
        session: The device.
        check: Makes cords on trial.
    """

    def __init__(self, session: DeviceSession, check: CordCheck) -> None:
        super().__init__(session)
        self._check = check
        self._canceled = set[tuple[Client, int]]()  # searches, also such that did not start yet
        self._is_closed = False

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {messages.Propose: self._propose, messages.CancelProposal: self._cancel}

    def disconnect(self, client: Client) -> None:
        self._canceled = {search for search in self._canceled if search[0] is not client}

    def close(self) -> None:
        self._is_closed = True

    def _propose(self, client: Client, request: messages.Propose) -> messages.ProposalResult:
        judge, basis = simulated_judge(self.session), EditBasis.of(self.session)
        search, sensors = (client, request.search), basis.device.sensors

        def check_canceled() -> None:
            if search in self._canceled or not client.is_open or self._is_closed:
                raise DefsenseError("the search for another cord was canceled", code=CANCELLED)

        def report(share: float, _: str) -> None:
            check_canceled()
            client.send(messages.ProposalProgress(share=share))

        try:
            self._wait_for_results(check_canceled)
            name = next(new_sensor_names(s.name for s in sensors))
            found = makeable_proposal(judge, self._check, sensors, name, report)
            check_canceled()
        finally:
            self._canceled.discard(search)
            client.send(messages.ProposalProgress(share=None))
        cord = found.cord
        basis.apply(
            edits.add_cord(name, cord.plane, cord.curve, sorted(cord.free)), "Propose again"
        )
        return messages.ProposalResult(
            name=name, error=found.error, error_before=found.error_before
        )

    def _wait_for_results(self, check_canceled: Callable[[], None]) -> None:
        """Wait for the simulation that has just ended. Raises DefsenseError."""
        jobs = self.session.jobs
        end = time.monotonic() + _JOB_END_S
        while jobs.job.state == "idle" and time.monotonic() < end and not jobs.wait(_WAIT_S):
            check_canceled()
        jobs.check_idle()

    def _cancel(self, client: Client, request: messages.CancelProposal) -> None:
        self._canceled.add((client, request.search))
