"""Check in the background whether the drawn cords can be made, and what they sense in the parts."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np

from ...core.device.device import Device, Sensor
from ...core.errors import DefsenseError
from ...workflow.build.results import last_build, poses_digest
from ...workflow.design.cord_trial import CordTrial, TrialBench
from ..background.background_job import CANCELLED, BackgroundJob, JobReporter
from ..background.latest_worker import LatestWorker
from .device_session import DeviceSession

CheckState = Literal["none", "checking", "done", "aborted"]
Cords = tuple[Sensor, ...]

_PAUSE_S = 0.5  # without another change, after which a check starts
_MAX_KNOWN = 60  # results that are kept for undo, redo and other layouts
_NICENESS = 10  # of the process: drags are judged meanwhile
_DECIMALS = 6  # of millimeters, to which equal cords are equal


class CordCheck:
    """Makes the drawn cords on trial in a separate process; results are cached by content.

    Args:
        session: The device.

    Attributes:
        on_result: Called when a check has a result or ends with an error, on the check's thread.
    """

    def __init__(self, session: DeviceSession) -> None:
        self._session = session
        self.on_result: list[Callable[[], None]] = []
        self._lock = threading.Lock()
        self._known: dict[str, CordTrial] = {}
        self._wanted = self._aborted = ""  # keys of the cords
        self._job = self._new_job("")
        self._worker = LatestWorker(self._start, session.show_error, delay_s=_PAUSE_S)

    def request(self, sensors: Cords) -> None:
        """Check these cords next, unless that is known; a check of others is canceled."""
        key = self._key(sensors)
        if not key:
            self.stop()
            return
        with self._lock:
            if key == self._wanted:
                return
            self._wanted = key
            is_known = _is_complete(self._known.get(key))
        self._job.cancel()
        if not is_known:
            self._worker.give((key, self._session.device, sensors))

    def stop(self) -> None:
        """Check no cords, as while they break limits."""
        with self._lock:
            self._wanted = ""
        self._job.cancel()

    def state(self, sensors: Cords) -> CheckState:
        """Return whether it is known if these cords can be made.

        A check that ended with an error is aborted until these cords are requested again.
        """
        key = self._key(sensors)
        with self._lock:
            if not key:
                return "none"
            if key in self._known:
                return "done"
            if key == self._wanted:
                return "checking"
            return "aborted" if key == self._aborted else "none"

    def result(self, sensors: Cords) -> CordTrial | None:
        """Return the result for these cords; None if it is not known."""
        with self._lock:
            return self._known.get(self._key(sensors))

    def make_now(self, sensors: Cords) -> CordTrial:
        """Make cords on trial on the calling thread, which takes seconds, unless it is known.

        Raises:
            DefsenseError: The poses are not simulated, or the error cannot be predicted.
        """
        known = self.result(sensors)
        if known is None:
            session, key = self._session, self._key(sensors)
            known = TrialBench(session.device, session.results).make(sensors)
            self._remember(key, known)
        return known

    def wait(self, timeout_s: float) -> bool:
        """Wait until no check runs; return False after `timeout_s`."""
        return self._worker.wait(timeout_s) and self._job.wait(timeout_s)

    def close(self) -> None:
        """End the running check."""
        self.stop()
        self._worker.close()
        self._job.close()

    def _start(self, item: tuple[str, Device, Cords]) -> None:
        key, device, sensors = item
        self._job.wait(_PAUSE_S)  # for the end of a canceled check
        with self._lock:
            if key != self._wanted:
                return
            self._job.cancel()
            self._job = self._new_job(key)
            error: DefsenseError | None = None
            try:
                self._job.start(run_check, device, sensors)
            except DefsenseError as cause:
                error = cause
        if error is not None:
            self._end(key, error, None)

    def _new_job(self, key: str) -> BackgroundJob:
        """Return the job of a check, whose results are those of the cords with this key."""
        return BackgroundJob(
            "check of the cords", _ignore, partial(self._end, key), partial(self._keep, key)
        )

    def _keep(self, key: str, trial: CordTrial) -> None:
        self._remember(key, trial)
        self._call()

    def _end(self, key: str, error: DefsenseError | None, trial: CordTrial | None) -> None:
        if trial is not None:
            self._keep(key, trial)
        elif error is not None and error.code != CANCELLED:
            # A build replaces the poses; the cords are checked after that.
            jobs = self._session.jobs
            is_building = jobs.is_running and jobs.job.name == "build"
            with self._lock:
                if self._wanted == key:
                    self._wanted = ""
                self._aborted = "" if is_building else key
            if not is_building:
                self._session.show_error(error)
            self._call()

    def _remember(self, key: str, trial: CordTrial) -> None:
        if not key:  # nobody knows what these cords were made of
            return
        with self._lock:
            self._known.pop(key, None)
            self._known[key] = trial
            for oldest in list(self._known)[:-_MAX_KNOWN]:
                del self._known[oldest]

    def _call(self) -> None:
        for callback in self.on_result:
            callback()

    def _key(self, sensors: Cords) -> str:
        """Return a digest of all that a check depends on; empty if nothing can be checked."""
        session = self._session
        if session.judge is None or not sensors:
            return ""
        try:
            poses = poses_digest(session.results)
        except (DefsenseError, OSError):  # a build replaces them
            return ""
        device = replace(session.device, name="", sensors=())
        cords = [(sensor.name, *_numbers(sensor)) for sensor in sensors]
        return hashlib.sha256(repr((poses, device, cords)).encode()).hexdigest()


def run_check(reporter: JobReporter, device: Device, sensors: Cords) -> CordTrial:
    """Make cords on trial; run this in a BackgroundJob.

    Its item is the result without the errors of built devices.
    """
    from ...core.machine.processes import one_blas_thread

    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    with one_blas_thread():  # as in builds
        bench = TrialBench(device, last_build(device))
        return bench.make_with_band(sensors, reporter.item)


def _numbers(sensor: Sensor) -> list[Any]:
    plane, curve = sensor.plane, sensor.curve
    arrays = (plane.origin, plane.axes, curve.points, curve.tangents)
    return [np.round(np.asarray(array, float), _DECIMALS).tolist() for array in arrays]


def _is_complete(trial: CordTrial | None) -> bool:
    return trial is not None and (trial.problem is not None or trial.band is not None)


def _ignore(*_: object) -> None:
    pass
