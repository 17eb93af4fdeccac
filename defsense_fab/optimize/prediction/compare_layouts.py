"""Layouts side by side: as drawn, by eye, the most accurate, and the simplest to make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.curve import distinct_planes
from ...core.device.device import Device, Sensor
from ...core.errors import LayoutError, StorageError
from ...store.body import load_body_record, load_surface
from ...store.build import Build
from ...store.layout import CordPath, LayoutRecord, WeighedRecord, load_layout, load_weighed
from ..refinement.refine import OptimizedLayout
from ..search import baselines
from ..search.plane_directions import face_directions
from ..studies.tolerance_monte_carlo import tolerance_band
from .as_built import assumed_cords
from .choose_layout import make_on_trial
from .design_task import SEED, DesignTask, decoders, load_task, tolerances_of
from .predict import Scored, predict
from .preference import preferred

DRAWN, VISUAL, FULL, SIMPLE = "as drawn", "by eye", "most accurate", "simplest"
#: What making a layout on trial, laying one out by eye and a band take on a machine of 2024: s, and
#: s for each triangle of the body.
_MAKING, _EYE, _BAND, _TRIANGLE = 10.0, 2.0, 5.0, 3e-4


@dataclass(frozen=True)
class ComparedLayout:
    """RMSE (mm) on unseen states of `sensors`: as built where their parts were made on trial, and
    as designed otherwise (`parts` is None); the limits (mm) between which 90 % of built devices
    lie, where they were computed; the problem for which there can be no parts, or what is to be
    said of them; whether it is the one that the build took."""

    name: str
    sensors: tuple[Sensor, ...]
    error: float
    parts: int | None = None
    band: tuple[float, float] | None = None
    warnings: tuple[str, ...] = ()
    problem: str | None = None
    taken: bool = False

    @property
    def planes(self) -> int:
        """How many planes the body is cut along."""
        return len(distinct_planes([s.plane for s in self.sensors]))


def weighed_layouts(folder: Path) -> list[ComparedLayout]:
    """Those that the last build of a `folder` made on trial, in its order: nothing is computed.
    Raises StorageError where there is no layout."""
    layout = load_layout(folder)
    try:
        paths = load_weighed(folder).layouts
    except StorageError:  # a build of a version before: it kept the paths of the chosen one
        paths = ()
    if len(paths) != len(layout.weighed):
        chosen = [w for w in layout.weighed if w.chosen]
        return [_weighed(layout, w, _cords(layout.sensors), "optimised") for w in chosen]
    best, simple = (preferred(layout.weighed, p) for p in ("accuracy", "simple"))
    out = []
    for k, (one, cords) in enumerate(zip(layout.weighed, paths, strict=True), start=1):
        names = [n for n, w in ((FULL, best), (SIMPLE, simple)) if w is one]
        out.append(_weighed(layout, one, _cords(cords), " and ".join(names) or f"other {k}"))
    return out


def _cords(paths: tuple[CordPath, ...]) -> tuple[Sensor, ...]:
    return tuple(p.sensor() for p in paths)


def _weighed(
    layout: LayoutRecord, one: WeighedRecord, sensors: tuple[Sensor, ...], name: str
) -> ComparedLayout:
    band = (layout.band.low, layout.band.high) if one.chosen else None
    error = one.designed if one.built is None else one.built
    return ComparedLayout(
        name, sensors, error, one.parts, band, one.warnings, one.problem, one.chosen
    )


def seconds_of(device: Device, folder: Path) -> float:
    """About how long `compare_layouts` takes. Raises StorageError where there is no layout."""
    known = weighed_layouts(folder)
    triangles = len(load_surface(folder).faces)
    trials = 1 + bool(device.sensors)
    bands = trials + sum(k.band is None and k.problem is None for k in known)
    return _EYE + trials * _MAKING + bands * _BAND + (trials + 1) * _TRIANGLE * triangles


def compare_layouts(
    device: Device,
    folder: Path,
    found: Callable[[ComparedLayout], None],
    report: Callable[[float, str], None],
) -> None:
    """The bands of the layouts that were weighed, and the cords as drawn and as one lays them by
    eye, made on trial with their bands; each is `found` as soon as it is known. Raises a
    DefsenseError where the build of `folder` has no layout."""
    layout, known = load_layout(folder), weighed_layouts(folder)
    task = load_task(device, Build(folder))
    count = len(layout.sensors)
    new = [(DRAWN, tuple(device.sensors))] if device.sensors else []
    report(0.0, "laying cords out by eye")
    try:
        rng = np.random.default_rng(SEED)
        new.append((VISUAL, tuple(baselines.visual_layout(task.design, count, rng))))
    except LayoutError as error:
        found(ComparedLayout(VISUAL, (), float("nan"), problem=str(error)))
    lacking = [k for k in known if k.band is None and k.problem is None]
    for k, (name, sensors) in enumerate(new):
        report((k + 0.5) / (len(new) + 1), f"making the layout {name} on trial")
        found(_tried(device, folder, task, name, sensors))
    decoded = task.with_decoder(layout.prediction.decoder)
    for k, one in enumerate(lacking):
        report((len(new) + k / len(lacking)) / (len(new) + 1), f"devices built as {one.name}")
        scored = predict(decoded, assumed_cords(decoded, one.sensors))
        found(replace(one, band=_band(device, decoded, scored, one.error)))


def _tried(
    device: Device, folder: Path, task: DesignTask, name: str, sensors: tuple[Sensor, ...]
) -> ComparedLayout:
    """PartSet on trial, for the decoder that does best on it."""
    tasks = [task.with_decoder(kind) for kind in decoders(device, task)]
    cords = assumed_cords(task, sensors)
    error, best = min(
        ((predict(t, cords).prediction.unseen, t) for t in tasks), key=lambda found: found[0]
    )
    surface = load_surface(folder)
    layout = OptimizedLayout(sensors, error, False, (), sensors)
    trial = make_on_trial(
        device, best, layout, error, surface, load_body_record(folder).bay, face_directions(surface)
    )
    if trial.problem is not None:
        return ComparedLayout(name, sensors, error, problem=trial.problem)
    band = _band(device, best, trial.scored, trial.built)
    return ComparedLayout(name, sensors, trial.built, trial.parts, band, trial.warnings)


def _band(device: Device, task: DesignTask, scored: Scored, error: float) -> tuple[float, float]:
    """Of devices built so, mm; about the `error` as built where `scored` is only as designed."""
    band = tolerance_band(
        task.everything, scored.cords, task.reading, np.random.default_rng(SEED), task.unseen,
        tolerances=tolerances_of(device),
    )  # fmt: skip
    factor = error / scored.prediction.unseen
    return factor * band.low, factor * band.high
