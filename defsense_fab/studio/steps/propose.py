"""Search for another cord, show how far the search is, and add the cord."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace

from ...core.errors import DefsenseError
from ...workflow.view import Client, Request
from ..background.background_job import CANCELLED
from ..edits import cords as edits
from ..edits.edit import free_name
from ..messages import sensors as messages
from ..session.cord_check import CordCheck
from ..session.device_session import DeviceSession
from ..session.step import Handler, Step
from .judgement import simulated_judge
from .makeable_proposal import makeable_proposal

_JOB_END_S = 30.0  # in which the results of a job that has ended are read


class ProposeStep(Step):
    """Adds the cord that lowers the error most, for each browser that asks for one.

    Args:
        session: The device.
        check: Makes cords on trial.
    """

    def __init__(self, session: DeviceSession, check: CordCheck) -> None:
        super().__init__(session)
        self._check = check
        #: Set to end the search of a browser; one search runs for each of them.
        self._canceled: dict[Client, threading.Event] = {}

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {messages.Propose: self._propose, messages.CancelProposal: self._cancel}

    def _propose(self, client: Client, _: messages.Propose) -> messages.ProposalResult:
        session, jobs = self.session, self.session.jobs
        judge, sensors = simulated_judge(session), session.device.sensors
        canceled = self._canceled[client] = threading.Event()

        def check_canceled() -> None:
            if canceled.is_set() or not client.is_open:
                raise DefsenseError("the search for another cord was canceled", code=CANCELLED)

        def report(share: float, _: str) -> None:
            check_canceled()
            client.send(messages.ProposalProgress(share=share))

        try:
            if jobs.job.state == "idle":
                jobs.wait(_JOB_END_S)  # the simulation that this waited for
            jobs.check_idle()
            name = self._free_name("cord")
            found = makeable_proposal(judge, self._check, sensors, name, report)
            check_canceled()
        finally:
            del self._canceled[client]
            client.send(messages.ProposalProgress(share=None))
        # The name may have been taken meanwhile.
        cord = replace(found.cord, name=self._free_name("cord"))
        session.apply(edits.add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))
        return messages.ProposalResult(
            name=cord.name, error=found.error, error_before=found.error_before
        )

    def _cancel(self, client: Client, _: messages.CancelProposal) -> None:
        canceled = self._canceled.get(client)
        if canceled is not None:
            canceled.set()

    def _free_name(self, name: str) -> str:
        return free_name(name, [s.name for s in self.session.device.sensors])
