"""Train, evaluate and recalibrate models that decode positions from resistances, and use them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float, Int
from ..core.device.device import Device
from ..core.errors import LiveError, TrainingError
from ..core.progress import Progress, silent
from ..decoding.trained_model import TrainedModel
from ..runtime.surface.live_surface import Mode
from ..sensing.response import relative_change
from ..training.data.dataset import Dataset
from ..training.data.problems import raise_fatal
from ..training.data.unit_checks import check_resistance_unit
from ..training.evaluation.evaluate_models import SessionEvaluation
from ..training.fitting.model_file import load_model, write_model
from . import arguments
from .arguments import array, each_of, of_kind, one_of
from .layout import Layout
from .recordings import UNNAMED, session_paths, validate_rest_resistances
from .run.live_device import (
    LiveDevice,
    Misfit,
    device_surface,
    misfit,
    with_build,
    without_build,
)
from .train.evaluation import evaluate_recordings
from .train.options import ClockShift, DataFiles, EvaluateOptions, TrainOptions
from .train.recalibration import recalibrate_model
from .train.training import train_recordings

MODES: tuple[Mode, ...] = ("default", "basis", "arap")


@dataclass(frozen=True, repr=False)
class MovingSurface:
    """The surface of a body in t frames.

    Attributes:
        vertices: Vertices (t, v, 3) mm in the device's rest frame; NaN in frames without markers.
        faces: Triangles (f, 3), counterclockwise seen from outside.
        rest: Vertices (v, 3) mm at rest.
    """

    vertices: Float
    faces: Int
    rest: Float

    def __repr__(self) -> str:
        t, v, _ = self.vertices.shape
        return f"<MovingSurface: {t} frames of {v} vertices, {len(self.faces)} triangles>"


@dataclass(frozen=True, repr=False)
class Model:
    """A trained model, created by `train` or `Model.load`.

    Attributes:
        record: The model as a file has it.
        test_rmse: RMSE on the frames held out of the training, mm, or in the first unit of the
            targets; None if no frames were held out, or if the model was loaded from a file.
        notes: Reasons to doubt the data or the model.
    """

    record: TrainedModel
    test_rmse: float | None = None
    notes: tuple[str, ...] = ()

    @staticmethod
    def load(path: str | Path) -> Model:
        """Load a model from a file.

        Args:
            path: `model.json`, or the folder that contains it.

        Raises:
            TrainingError: There is no such file, or it is not a model.
        """
        return Model(load_model(arguments.path(path, "path", TrainingError)))

    def save(self, path: str | Path) -> Path:
        """Write the model as a .json file (docs/model.md).

        Args:
            path: The file.

        Returns:
            The file.

        Raises:
            TrainingError: The suffix is not .json.
            StorageError: The file cannot be written.
        """
        file = arguments.file_path(path, ".json", TrainingError)
        write_model(file, self.record)
        return file

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the c channels, in the order of the resistances."""
        return self.record.channels

    @property
    def rest_positions(self) -> Float:
        """Markers at rest, (m, 3) mm in the device's rest frame."""
        return self.record.rest_points

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the m targets; numbers for markers."""
        return self.record.target_names

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the m targets; mm for markers, empty where unknown."""
        return self.record.units

    def predict(
        self,
        time: ArrayLike,
        resistances: ArrayLike,
        rest_resistances: ArrayLike | None = None,
    ) -> Float:
        """Decode positions of the markers from resistances, or targets from readings.

        Args:
            time: Times (t,) s, increasing.
            resistances: Resistances (t, c) ohm; readings in the units of a model of targets.
            rest_resistances: Resistances (c,) ohm at rest; None for a model of targets, whose
                reference is fixed.

        Returns:
            Positions (t, m, 3) mm, or targets (t, m, r); NaN where a resistance is NaN.

        Raises:
            TrainingError: The shapes do not fit the model, a value is invalid, or resistances and
                those at rest have different units.
        """
        c = len(self.channels)
        times = array(time, "time", TrainingError)
        ohm = array(resistances, "resistances", TrainingError)
        readings = self.record.readings
        if (readings is None) == (rest_resistances is None):
            is_needed = readings is None
            raise TrainingError(
                "is missing" if is_needed else "has no effect: the reference of the model is fixed",
                code="argument-missing" if is_needed else "options-conflict",
                where="rest_resistances",
                action="Give the resistances at rest, ohm" if is_needed else "Omit it",
                argument="rest_resistances",
            )
        rest = np.ones(c)
        if rest_resistances is not None:
            rest = array(rest_resistances, "rest_resistances", TrainingError)
        if ohm.shape != (len(times) if times.ndim == 1 else -1, c) or rest.shape != (c,):
            raise TrainingError(
                f"shapes of time {times.shape}, resistances {ohm.shape} and rest_resistances"
                f" {rest.shape} do not fit together; the model has {c} channels:"
                f" {', '.join(self.channels)}",
                code="wrong-shape",
                where="resistances",
                argument="resistances",
                channels=self.channels,
            )
        if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
            raise TrainingError(
                "must be finite and increase, in s",
                code="times-not-increasing",
                where="time",
                argument="time",
            )
        if readings is not None:
            return self.record.decode(times, readings.signals(ohm), times).points
        raise_fatal(check_resistance_unit(ohm, validate_rest_resistances(rest)))
        positive = np.where(ohm > 0, ohm, np.nan)
        return self.record.decode(times, relative_change(positive, rest), times).points

    def surface(
        self, positions: ArrayLike, layout: Layout, mode: Mode = "default"
    ) -> MovingSurface:
        """Reconstruct the surface of the device from positions of the markers.

        Each frame starts from the shape of the previous one.

        Args:
            positions: Positions (t, m, 3) mm of the markers in the order of time, as `predict`
                returns them; NaN where one is unknown.
            layout: The layout that the model was trained with.
            mode: "basis" combines deformation modes of the simulated states, "arap" deforms the
                surface as rigidly as possible, and "default" starts from the modes and adds an
                as-rigid-as-possible deformation to them.

        Raises:
            LiveError: The shape does not fit, or the model was trained on another device.
        """
        one_of(mode, "mode", MODES, "mode", LiveError)
        points = _validate_positions(positions, len(self.record.ids))
        live = fitting_device(self.record, of_kind(layout, "layout", Layout, LiveError))
        solve = device_surface(live, mode, frame=np.inf)
        assert live.rest is not None
        vertices = np.full((len(points), len(live.rest.vertices), 3), np.nan)
        for k, markers in enumerate(points):
            if np.isfinite(markers).all(axis=1).any():
                vertices[k] = solve(markers)
        return MovingSurface(vertices, np.asarray(live.rest.faces, np.int64), live.rest.vertices)

    def __repr__(self) -> str:
        unit = self.units[0] or "(no unit given)"
        tested = "" if self.test_rmse is None else f", {self.test_rmse:.2f} {unit} test RMSE"
        notes = f", {len(self.notes)} notes" if self.notes else ""
        return f"<Model of {self.record.device!r}: {self.record.kind}{tested}{notes}>"


def fitting_device(model: TrainedModel, layout: Layout | None) -> LiveDevice:
    """Return the device of a model for a live run.

    Args:
        model: The model.
        layout: The layout that it was trained with; None: what the model alone contains.

    Raises:
        LiveError: The layout is of another device, or of other cords.
    """
    if layout is None:
        return without_build(model)
    of_kind(layout, "layout", Layout, LiveError)
    device = layout.simulation.device.record
    reason = misfit(model, device, layout.record)
    if reason is not None:
        is_other_device = reason is Misfit.DEVICE
        trained = f"device {model.device!r}" if is_other_device else ", ".join(model.channels)
        raise LiveError(
            f"is of {device.name!r}, with {', '.join(c.name for c in layout.cords)}, but the model"
            f" is of {reason.value} ({trained})",
            code="model-misfit",
            where="layout",
            action="Give the layout that the model was trained with",
            argument="layout",
            reason=reason.name.lower(),
        )
    return with_build(model, device)


def _validate_positions(positions: ArrayLike, count: int) -> Float:
    points = array(positions, "positions", LiveError)
    if points.ndim != 3 or points.shape[1:] != (count, 3):
        raise LiveError(
            f"must have shape (t, {count}, 3), for the model's {count} markers, not {points.shape}",
            code="wrong-shape",
            where="positions",
            argument="positions",
            shape=points.shape,
        )
    if np.isinf(points).any():
        raise LiveError(
            "must not be infinite",
            code="not-finite",
            where="positions",
            action="Use NaN where a position is unknown",
            argument="positions",
        )
    return points


def train(
    data: Dataset,
    layout: Layout | None = None,
    *,
    time_shift: ClockShift = DataFiles.shift,
    is_synchronized: bool = False,
    progress: Progress = silent,
    **options: Any,
) -> Model:
    """Train a model, the same one as `defsense train` does.

    Args:
        data: The dataset.
        layout: Layout of the device, whose simulation then supports the training.
        time_shift: Added to the times of the resistances, s; "auto": estimated from the data.
        is_synchronized: Whether signals and markers are known to be synchronous, as a twin's are.
        progress: Receives each stage's name, completed fraction and a message.
        **options: Fields of `TrainOptions`, such as `decoder="affine"`.

    Raises:
        TrainingError: The data are unsuitable, or of another device than the layout, or an option
            is invalid.
    """
    arguments.called(progress, TrainingError)
    synchronized = arguments.truth(is_synchronized, "is_synchronized", TrainingError)
    dataset, device = _recorded(data, layout)
    training, notes = train_recordings(
        dataset,
        device,
        arguments.options(options, TrainOptions, TrainingError),
        is_synchronized=synchronized,
        shift=_clock_shift(time_shift),
        progress=progress,
    )
    tests = {a.name: a.test for a in training.candidates}
    test = tests[training.selected]
    return Model(training.model, None if test is None else test.rmse, notes)


def evaluate(
    model: Model,
    data: Dataset,
    layout: Layout | None = None,
    *,
    against: Sequence[Model] = (),
    time_shift: ClockShift = DataFiles.shift,
    last_share: float | None = EvaluateOptions.last_share,
    progress: Progress = silent,
) -> SessionEvaluation:
    """Measure the errors of a model, as `defsense evaluate` does; no report is written.

    Args:
        model: The model.
        data: The dataset to test on.
        layout: Layout of the device, to predict the errors and check the data.
        against: Models to compare with, tested on the same data.
        time_shift: Added to the times of the resistances, s; "auto": estimated from the data.
        last_share: Share of the frames to test on, at the end of all runs; None: all frames that
            the models were not trained on.
        progress: Receives each stage's name, completed fraction and a message.

    Returns:
        The evaluation. Its `models` have errors (`evaluation`, whose `total.rmse` is in mm) and
        their causes (`budget`), the first one those of `model`.

    Raises:
        TrainingError: Models and data do not match, or an argument is invalid.
    """
    first = of_kind(model, "model", Model, TrainingError)
    others = each_of(against, "against", Model, TrainingError)
    arguments.called(progress, TrainingError)
    options = arguments.options({"last_share": last_share}, EvaluateOptions, TrainingError)
    dataset, device = _recorded(data, layout)
    if dataset.device == UNNAMED:
        dataset = replace(dataset, device=first.record.device)
    names = ["model", *(f"against[{k}]" for k in range(len(others)))]
    return evaluate_recordings(
        [(name, m.record) for name, m in zip(names, (first, *others), strict=True)],
        dataset,
        device,
        options.last_share,
        shift=_clock_shift(time_shift),
        progress=progress,
    )


def recalibrate(model: Model, *sessions: str | Path) -> Model:
    """Correct the gains of a model after a cord was replaced, as `defsense recalibrate` does.

    Args:
        model: The model.
        sessions: Folders of recorded sessions with rest and a few poses; cameras are not needed.

    Returns:
        The corrected model.

    Raises:
        TrainingError: Correcting the gains is not sufficient (`gains-insufficient`), or a session
            is of another device or other channels, or has no rest or poses.
    """
    of_kind(model, "model", Model, TrainingError)
    folders = session_paths(sessions)
    result = recalibrate_model(model.record, folders)
    if result.problems:
        raise TrainingError(
            f"correcting the gains is not sufficient: {'; '.join(result.problems)}",
            code="gains-insufficient",
            where="sessions",
            action="Record sessions with cameras, and train again",
            problems=result.problems,
        )
    return Model(result.model, notes=result.notes)


def _recorded(data: Dataset, layout: Layout | None) -> tuple[Dataset, Device | None]:
    """Return a dataset, with the device's name if it has none, and the device of the layout."""
    of_kind(data, "data", Dataset, TrainingError)
    if layout is None:
        return data, None
    device = of_kind(layout, "layout", Layout, TrainingError).simulation.device.record
    return (replace(data, device=device.name) if data.device == UNNAMED else data), device


def _clock_shift(time_shift: object) -> ClockShift:
    if isinstance(time_shift, str) and time_shift == "auto":
        return "auto"
    return arguments.number(time_shift, "time_shift", TrainingError)
