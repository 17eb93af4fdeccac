"""Make cords on trial with the checks of a build, and predict what they sense in their parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import sample_path
from ...core.device.device import Device, Sensor
from ...core.errors import FabricationError
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.splitting.long_parts import split_long_parts
from ...optimization.prediction.as_built import assumed_cords, part_rules
from ...optimization.prediction.built_devices import predict_built_devices
from ...optimization.prediction.choose_layout import (
    Trial,
    casting_error,
    make_on_trial,
    outline_trial,
)
from ...optimization.prediction.design_task import DesignTask, candidate_decoders, load_task
from ...optimization.prediction.predict import predict_with_best_decoder
from ...optimization.refinement.refine import OptimizedLayout
from ...optimization.search.plane_directions import face_directions
from ...store.build import Build
from ...store.layout import BandRecord, CordPath
from ...store.printed_pieces import PrintedPiece
from ..fabrication.print_time import pieces_of_parts
from .session_shares import session_shares

_TOLERANCE_MM = 1e-3  # by which a path may leave the body


@dataclass(frozen=True)
class TrialProblem:
    """Why cords cannot be made.

    Attributes:
        code: Stable identifier of the check that fails.
        text: What is wrong, and what to do.
        cords: Names of the cords concerned; all cords if the check names none.
        at: Where (3,), mm; the middle of the first of these cords if the check names no place.
    """

    code: str
    text: str
    cords: tuple[str, ...]
    at: tuple[float, float, float]


@dataclass(frozen=True)
class CordTrial:
    """Cords whose parts were made on trial.

    Attributes:
        sensors: The cords.
        drawn_error: RMSE (mm) on unseen states as drawn, with the ends that a search assumes; NaN
            if a cord leaves the body.
        error: RMSE (mm) on unseen states in the parts, with their grooves, pockets and strain
            relief; None if the parts cannot be made.
        parts: Number of parts; None if they cannot be made.
        warnings: Notes about the parts.
        problem: Why they cannot be made; None if they can.
        band: Errors of built devices; None if they were not computed.
        pieces: The parts and pins as they are printed; empty if they cannot be made.
    """

    sensors: tuple[Sensor, ...]
    drawn_error: float
    error: float | None = None
    parts: int | None = None
    warnings: tuple[str, ...] = ()
    problem: TrialProblem | None = None
    band: BandRecord | None = None
    pieces: tuple[PrintedPiece, ...] = ()


class TrialBench:
    """Makes cords of a device on trial.

    Args:
        device: The device.
        build: Its build, whose poses are simulated.
        task: Its design task; read from the build by default.

    Raises:
        DefsenseError: The poses are not simulated.
    """

    def __init__(self, device: Device, build: Build, task: DesignTask | None = None) -> None:
        task = task or load_task(device, build)
        self._device = device
        self._tasks = [task.with_decoder(kind) for kind in candidate_decoders(device, task)]
        self._surface, self._directions = build.surface, face_directions(build.surface)
        self._bay: Prism | None = build.body.bay
        self._shares: Float | None = None

    def make(self, sensors: Sequence[Sensor]) -> CordTrial:
        """Make cords on trial, for the decoder that predicts the smallest error, in seconds.

        Args:
            sensors: The cords.

        Raises:
            LayoutError: The predicted error is not finite.
        """
        return self._make(sensors)[0]

    def make_with_band(
        self, sensors: Sequence[Sensor], on_made: Callable[[CordTrial], None] = lambda _: None
    ) -> CordTrial:
        """Make cords on trial, and predict the errors of built devices, which takes as long.

        Args:
            sensors: The cords.
            on_made: Called with the result without these errors, as soon as it is known.

        Raises:
            LayoutError: The predicted error is not finite.
        """
        made, trial, task = self._make(sensors)
        on_made(made)
        if made.problem is not None:
            return made
        return replace(made, band=self._band(trial, task))

    def _make(self, sensors: Sequence[Sensor]) -> tuple[CordTrial, Trial, DesignTask]:
        cords = tuple(replace(s, plane=CordPath.of(s).sensor().plane) for s in sensors)
        task, scored = predict_with_best_decoder(self._tasks, assumed_cords(self._tasks[0], cords))
        error = scored.prediction.unseen
        layout = OptimizedLayout(cords, error, False, (), cords)
        trial = outline_trial(
            self._device, task, layout, error, self._surface, self._bay, self._directions
        )
        trial = make_on_trial(task, trial, self._surface, self._bay)
        failure = trial.failure or self._later_failure(trial)
        made = CordTrial(tuple(sensors), error)
        if failure is not None:
            if self._leave_body(cords):
                made = replace(made, drawn_error=float("nan"))
            return replace(made, problem=_describe(failure, cords)), trial, task
        assert trial.part_set is not None
        made = replace(
            made,
            error=trial.built,
            parts=trial.parts,
            warnings=trial.warnings,
            pieces=pieces_of_parts(trial.part_set),
        )
        return made, trial, task

    def _leave_body(self, sensors: Sequence[Sensor]) -> bool:
        depth = self._tasks[0].everything.depth(np.concatenate([sample_path(s) for s in sensors]))
        return bool(depth.min() < -_TOLERANCE_MM)

    def _later_failure(self, trial: Trial) -> FabricationError | None:
        """Return the error of a check that a build makes after it has chosen a layout."""
        device = self._device
        assert trial.part_set is not None
        if device.fabrication.kind == "cast":
            return casting_error(device, trial, lambda *_: None)
        if device.cord.trace is not None:
            return None
        try:
            split_long_parts(trial.part_set, device.fabrication.bed, part_rules(device))
        except FabricationError as error:
            return error
        return None

    def _band(self, trial: Trial, task: DesignTask) -> BandRecord:
        if self._shares is None:
            self._shares = session_shares(self._device, task.weights)
        return predict_built_devices(self._device, task, trial.scored.cords, self._shares)


def _describe(error: FabricationError, sensors: Sequence[Sensor]) -> TrialProblem:
    names = [sensor.name for sensor in sensors]
    named = error.data.get("cords") or [error.data.get("cord")]
    cords = tuple(n for n in names if isinstance(named, list | tuple) and n in named)
    cords = cords or tuple(names)
    place = error.data.get("at")
    if not isinstance(place, list):
        path = sample_path(next(s for s in sensors if s.name == cords[0]))
        place = path[len(path) // 2].tolist()
    x, y, z = (float(value) for value in np.asarray(place))
    return TrialProblem(error.code, str(error), cords, (x, y, z))
