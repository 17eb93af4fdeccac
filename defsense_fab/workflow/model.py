"""Models that tell positions from resistances: trained, kept, used."""

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
from .recordings import UNNAMED

# The surface of a device, of the positions of its markers.

# The device that a model fits, as what runs it live has it.

_NEEDED = "give the layout of optimize(simulate(device))"


def fitting_device(model: TrainedModel, layout: Layout | None) -> LiveDevice:
    """Of the model alone where there is no layout. Raises LiveError for a layout of another device,
    or of other cords, than those that the model was trained on."""
    if layout is None:
        return without_build(model)
    of_kind(layout, "layout", Layout, LiveError)
    device = layout.poses.device.record
    why = misfit(model, device, layout.record)
    if why is not None:
        trained = f"device {model.device!r}" if why is Misfit.DEVICE else ", ".join(model.channels)
        raise LiveError(
            f"layout: of {device.name!r}, with {', '.join(c.name for c in layout.cords)}; the model"
            f" is of {why.value} ({trained}); {_NEEDED} that it was trained on"
        )
    return with_build(model, device)


MODES: tuple[Mode, ...] = ("default", "basis", "arap")


@dataclass(frozen=True, repr=False)
class MovingSurface:
    """The skin of a body in t pictures: `vertices` (t, v, 3) mm in the device's rest frame, NaN
    where no marker was known; `faces` (f, 3) outward by the right hand; `rest` (v, 3) mm where the
    vertices are at rest."""

    vertices: Float
    faces: Int
    rest: Float

    def __repr__(self) -> str:
        t, v, _ = self.vertices.shape
        return f"<MovingSurface: {t} pictures of {v} vertices, {len(self.faces)} triangles>"


def moving_surface(
    model: TrainedModel, positions: ArrayLike, layout: Layout, mode: Mode
) -> MovingSurface:
    """As `Model.surface` says."""
    if of_kind(mode, "mode", str, LiveError) not in MODES:
        raise LiveError(f"mode {mode!r}: is unknown; there are {', '.join(MODES)}")
    points = _checked(positions, len(model.ids))
    live = fitting_device(model, of_kind(layout, "layout", Layout, LiveError))
    surface = device_surface(live, mode, frame=np.inf)
    assert live.rest is not None
    vertices = np.full((len(points), len(live.rest.vertices), 3), np.nan)
    for k, markers in enumerate(points):
        if np.isfinite(markers).all(axis=1).any():
            vertices[k] = surface(markers)
    return MovingSurface(vertices, np.asarray(live.rest.faces, np.int64), live.rest.vertices)


def _checked(positions: ArrayLike, count: int) -> Float:
    points = array(positions, "positions", LiveError)
    if points.ndim != 3 or points.shape[1:] != (count, 3):
        raise LiveError(
            f"positions: must have shape (t, {count}, 3), pictures of the model's {count} markers,"
            f" not {points.shape}"
        )
    if np.isinf(points).any():
        raise LiveError("positions: must not be infinite; NaN is where there is none")
    return points


@dataclass(frozen=True, repr=False)
class Model:
    """A trained model: its `record`, and of its training the RMSE (mm) on the pictures held out at
    the end (`test_rmse`; None where it was read from a file, or none were held out), and `notes` on
    what is doubtful."""

    record: TrainedModel
    test_rmse: float | None = None
    notes: tuple[str, ...] = ()

    @staticmethod
    def load(path: str | Path) -> Model:
        """Of model.json, or of the folder that holds it. Raises TrainingError."""
        return Model(load_model(arguments.path(path, "path", TrainingError)))

    def save(self, path: str | Path) -> Path:
        """Write a .json file (docs/model.md), which the commands read. Raises TrainingError,
        StorageError."""
        file = arguments.path(path, "path", StorageError)
        if file.suffix != ".json":
            raise TrainingError(f"{file}: a model is a .json file; let its name end so")
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
        """Positions (t, m, 3) mm of the markers, of `resistances` (t, c) ohm at the times (t,) s,
        with those at rest (c,) ohm; NaN where a resistance is. Raises TrainingError for shapes that
        do not fit the model, and resistances in another unit than those at rest."""
        c = len(self.channels)
        when = arguments.array(time, "time", TrainingError)
        ohm = arguments.array(resistances, "resistances", TrainingError)
        rest = arguments.array(rest_resistances, "rest_resistances", TrainingError)
        if ohm.shape != (len(when) if when.ndim == 1 else -1, c) or rest.shape != (c,):
            raise TrainingError(
                f"resistances {ohm.shape} at times {when.shape} with {rest.shape} at rest do not go"
                f" together; this model has {c} channels: {', '.join(self.channels)}"
            )
        if not (np.isfinite(when).all() and (np.diff(when) > 0).all()):
            raise TrainingError("time: must be finite and increase, in s")
        if not (np.isfinite(rest).all() and (rest > 0).all()):
            raise TrainingError("rest_resistances: must be above 0, in ohm, and none NaN")
        raise_fatal(check_resistance_unit(ohm, rest))
        known = np.where(ohm > 0, ohm, np.nan)
        return self.record.decode(when, relative_change(known, rest), when).points

    def surface(
        self, positions: ArrayLike, layout: Layout, mode: Mode = "default"
    ) -> MovingSurface:
        """The device's surface, of positions (t, m, 3) mm of the markers in the order of time, as
        `predict` gives them, NaN where one is not known; each picture begins with the shape of the
        one before. "default" takes modes of the simulated states, and is as rigid as possible
        beyond them; "basis" takes the modes alone, "arap" is as rigid as possible without them.
        Raises LiveError for other shapes, and for a layout that the model was not trained on."""
        return moving_surface(self.record, positions, layout, mode)

    def __repr__(self) -> str:
        tested = "" if self.test_rmse is None else f", {self.test_rmse:.2f} mm RMSE on its test"
        notes = f", {len(self.notes)} notes" if self.notes else ""
        return f"<Model of {self.record.device!r}: {self.record.kind}{tested}{notes}>"


@one_blas_thread()
def train(
    data: Dataset,
    layout: Layout | None = None,
    *,
    decoder: str = "auto",
    test_share: float = TrainingOptions.test_share,
    without_markers: Sequence[int] = (),
    shift: float | Literal["auto"] = 0.0,
    in_step: bool = False,
    progress: Progress = silent,
) -> Model:
    """A model of a dataset, the same that `defsense train` makes; with what the simulation says of
    the `layout` where that is given.

    `decoder` is the name of one, or "auto" for the best; `test_share` of the pictures, at the end,
    are held out; markers of the numbers `without_markers` are left out. `shift` s are added to the
    times of the resistances, or what is found, "auto". With `in_step`, signals and markers are
    known to go together in time, as a twin's do. Raises TrainingError for what forbids training,
    and for data of another device than the layout's.
    """
    arguments.of_kind(data, "data", Dataset, TrainingError)
    if layout is not None:
        arguments.of_kind(layout, "layout", Layout, TrainingError)
    arguments.of_kind(decoder, "decoder", str, TrainingError)
    arguments.called(progress, TrainingError)
    share = arguments.number(test_share, "test_share", TrainingError)
    if not 0 <= share < 1:
        raise TrainingError(f"test_share: must be at least 0 and below 1, not {share:g}")
    left_out = [
        arguments.whole(number, "without_markers", TrainingError, least=0)
        for number in arguments.listed(without_markers, "without_markers", TrainingError)
    ]
    together = arguments.truth(in_step, "in_step", TrainingError)
    automatic = isinstance(shift, str) and shift == "auto"
    offset: Offset = "auto" if automatic else arguments.number(shift, "shift", TrainingError)
    device = None if layout is None else layout.poses.device.record
    if device is not None and data.device == UNNAMED:
        data = replace(data, device=device.name)
    data, prior, notes = prepare(
        data, device, prior_mode=NO if device is None else YES, excluded_markers=left_out,
        is_synchronized=together,
        shift=offset, progress=progress,
    )  # fmt: skip
    options = TrainingOptions(decoder=decoder, test_share=share)
    training = train_dataset(data, options, prior, progress)
    tests = {a.name: a.test for a in training.candidates}
    test = tests[training.selected]
    return Model(training.model, None if test is None else test.rmse, tuple(notes))
