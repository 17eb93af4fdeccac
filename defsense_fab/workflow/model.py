"""Train models that decode positions from resistances, and use them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float, Int
from ..core.errors import LiveError, StorageError, TrainingError
from ..core.machine.processes import one_blas_thread
from ..core.progress import Progress, silent
from ..decoding.trained_model import TrainedModel
from ..runtime.live.live_device import LiveDevice, device_surface, with_build, without_build
from ..runtime.live.run_choices import Misfit, misfit
from ..runtime.surface.live_surface import Mode
from ..sensing.response import relative_change
from ..training.data.dataset import Dataset
from ..training.data.problems import raise_fatal
from ..training.data.unit_checks import check_resistance_unit
from ..training.fitting.train_model import TrainingOptions
from ..training.models.model_file import load_model, write_model
from ..training.models.prepare import NO, YES, prepare
from ..training.models.train_device import train_dataset
from ..training.recordings.pair_dataset import Offset
from . import arguments
from .arguments import array, of_kind
from .layout import Layout
from .recordings import UNNAMED, validate_rest_resistances

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
        test_rmse: RMSE on the frames held out of the training, mm; None if no frames were held
            out, or if the model was loaded from a file.
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
        file = arguments.path(path, "path", StorageError)
        if file.suffix != ".json":
            raise TrainingError(
                "the name of a model must end in .json",
                code="wrong-suffix",
                where=file,
                suffix=file.suffix,
            )
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

    def predict(
        self, time: ArrayLike, resistances: ArrayLike, rest_resistances: ArrayLike
    ) -> Float:
        """Decode positions of the markers from resistances.

        Args:
            time: Times (t,) s, increasing.
            resistances: Resistances (t, c) ohm.
            rest_resistances: Resistances (c,) ohm at rest.

        Returns:
            Positions (t, m, 3) mm; NaN where a resistance is NaN.

        Raises:
            TrainingError: The shapes do not fit the model, a value is invalid, or resistances and
                those at rest have different units.
        """
        c = len(self.channels)
        times = array(time, "time", TrainingError)
        ohm = array(resistances, "resistances", TrainingError)
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
        if of_kind(mode, "mode", str, LiveError) not in MODES:
            raise unknown_mode("mode", mode)
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
        tested = "" if self.test_rmse is None else f", {self.test_rmse:.2f} mm test RMSE"
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


def unknown_mode(name: str, mode: object, *further: object) -> LiveError:
    """Return the error for an unknown mode of the surface, given as the argument `name`."""
    modes = (*MODES, *map(str, further))
    return LiveError(
        f"unknown mode {mode!r}",
        code="mode-unknown",
        where=name,
        action=f"Use one of {', '.join(modes)}",
        argument=name,
    )


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


@one_blas_thread()
def train(
    data: Dataset,
    layout: Layout | None = None,
    *,
    decoder: str = "auto",
    test_share: float = TrainingOptions.test_share,
    excluded_markers: Sequence[int] = (),
    time_shift: float | Literal["auto"] = 0.0,
    is_synchronized: bool = False,
    progress: Progress = silent,
) -> Model:
    """Train a model, the same one as `defsense train` does.

    Args:
        data: The dataset.
        layout: Layout of the device, whose simulation then supports the training.
        decoder: Name of a decoder, or "auto" for the best one.
        test_share: Share of the frames, at the end, that are held out for the test.
        excluded_markers: Numbers of markers to leave out.
        time_shift: Added to the times of the resistances, s; "auto": estimated from the data.
        is_synchronized: Whether signals and markers are known to be synchronous, as a twin's are.
        progress: Receives each stage's name, completed fraction and a message.

    Raises:
        TrainingError: The data are unsuitable, or of another device than the layout.
    """
    of_kind(data, "data", Dataset, TrainingError)
    if layout is not None:
        of_kind(layout, "layout", Layout, TrainingError)
    of_kind(decoder, "decoder", str, TrainingError)
    arguments.called(progress, TrainingError)
    share = arguments.number(test_share, "test_share", TrainingError)
    if not 0 <= share < 1:
        raise TrainingError(
            f"must be at least 0 and below 1, not {share:g}",
            code="out-of-range",
            where="test_share",
            argument="test_share",
        )
    markers = [
        arguments.whole(number, "excluded_markers", TrainingError, least=0)
        for number in arguments.listed(excluded_markers, "excluded_markers", TrainingError)
    ]
    synchronized = arguments.truth(is_synchronized, "is_synchronized", TrainingError)
    automatic = isinstance(time_shift, str) and time_shift == "auto"
    shift: Offset = (
        "auto" if automatic else arguments.number(time_shift, "time_shift", TrainingError)
    )
    device = None if layout is None else layout.simulation.device.record
    if device is not None and data.device == UNNAMED:
        data = replace(data, device=device.name)
    data, prior, notes = prepare(
        data,
        device,
        prior_mode=NO if device is None else YES,
        excluded_markers=markers,
        is_synchronized=synchronized,
        shift=shift,
        progress=progress,
    )
    options = TrainingOptions(decoder=decoder, test_share=share)
    training = train_dataset(data, options, prior, progress)
    tests = {a.name: a.test for a in training.candidates}
    test = tests[training.selected]
    return Model(training.model, None if test is None else test.rmse, tuple(notes))
