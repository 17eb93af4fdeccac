"""Compare layouts: as drawn, straight, the most accurate, and the simplest to make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.curve import distinct_planes
from ...core.device.device import Device, Sensor
from ...core.errors import LayoutError, StorageError
from ...core.progress import Report
from ...optimization.prediction.as_built import assumed_cords
from ...optimization.prediction.built_devices import predict_built_devices
from ...optimization.prediction.choose_layout import prefer_layout
from ...optimization.prediction.design_task import (
    SEED,
    DesignTask,
    load_task,
)
from ...optimization.prediction.predict import ScoredLayout, predict
from ...optimization.search import baselines
from ...store.build import Build
from ...store.layout import BandRecord, CordPath, LayoutRecord, WeighedRecord
from ...store.printed_pieces import PrintedPiece
from .cord_trial import CordTrial, TrialBench
from .session_shares import session_shares

DRAWN, STRAIGHT, FULL, SIMPLE = "as drawn", "straight", "most accurate", "simplest"
#: Seconds that a trial, a straight layout, a band and each triangle of the body take on a machine
#: of 2024.
_TRIAL_S, _STRAIGHT_S, _BAND_S, _TRIANGLE_S = 10.0, 2.0, 5.0, 3e-4


@dataclass(frozen=True)
class ComparedLayout:
    """A layout in a comparison.

    Attributes:
        name: Name for people.
        sensors: The cords.
        error: RMSE (mm) on unseen states, as built if parts were made on trial, else as designed.
        parts: Number of parts, None if they were not made.
        band: Limits (mm) between which 90 % of built devices lie, if computed.
        warnings: Notes about the parts.
        problem: Reason why it cannot be made.
        is_built: Whether it is the layout of the build.
        is_studied: Whether it is a result of `defsense study`.
        trained: RMSE (mm) expected after training, with the memory of the cords: its median and
            the limits between which 90 % of built devices lie, if computed.
        drawn_error: RMSE (mm) on unseen states as drawn, without the grooves of the parts; NaN if
            it is not known.
        pieces: The parts and pins as they are printed; empty if they were not made.
    """

    name: str
    sensors: tuple[Sensor, ...]
    error: float
    parts: int | None = None
    band: tuple[float, float] | None = None
    warnings: tuple[str, ...] = ()
    problem: str | None = None
    is_built: bool = False
    is_studied: bool = False
    trained: tuple[float, float, float] | None = None
    drawn_error: float = float("nan")
    pieces: tuple[PrintedPiece, ...] = ()

    @property
    def planes(self) -> int:
        """Number of planes that the body is cut along."""
        return len(distinct_planes([s.plane for s in self.sensors if s.curve.is_planar]))


def tried_layouts(build: Build) -> list[ComparedLayout]:
    """Return the layouts that a build made on trial, in its order.

    Args:
        build: The build.

    Raises:
        StorageError: If the build has no layout.
    """
    layout = build.layout
    try:
        paths = build.weighed.layouts
    except StorageError:  # builds of an earlier version stored only the chosen paths
        paths = ()
    if len(paths) != len(layout.weighed):
        chosen = [w for w in layout.weighed if w.chosen]
        return [_compared(layout, w, _cords(layout.sensors), "optimized") for w in chosen]
    best, simple = (prefer_layout(layout.weighed, p) for p in ("accuracy", "simple"))
    out = []
    for k, (record, cords) in enumerate(zip(layout.weighed, paths, strict=True), start=1):
        names = [n for n, w in ((FULL, best), (SIMPLE, simple)) if w is record]
        out.append(
            _compared(layout, record, _cords(cords), " and ".join(names) or f"candidate {k}")
        )
    return out


def _cords(paths: tuple[CordPath, ...]) -> tuple[Sensor, ...]:
    return tuple(p.sensor() for p in paths)


def _compared(
    layout: LayoutRecord, one: WeighedRecord, sensors: tuple[Sensor, ...], name: str
) -> ComparedLayout:
    band = (layout.band.low, layout.band.high) if one.chosen else None
    trained = _trained(layout.band) if one.chosen else None
    error = one.designed if one.built is None else one.built
    return ComparedLayout(
        name,
        sensors,
        error,
        one.parts,
        band,
        one.warnings,
        one.problem,
        one.chosen,
        trained=trained,
        drawn_error=one.designed,
        pieces=one.pieces,
    )


def _trained(band: BandRecord, factor: float = 1.0) -> tuple[float, float, float]:
    """Return the error expected after training, and its range, mm, times a factor."""
    trained = band.trained
    return factor * trained.median, factor * trained.low, factor * trained.high


def estimate_seconds(device: Device, build: Build) -> float:
    """Estimate how long `compare_layouts` takes, s.

    Args:
        device: The device.
        build: Its build.

    Raises:
        StorageError: If the build has no layout.
    """
    tried = tried_layouts(build)
    triangles = len(build.surface.faces)
    unmade = sum(k.parts is None and k.problem is None for k in tried)
    trials = 1 + bool(device.sensors) + unmade
    bands = trials + sum(k.band is None and k.parts is not None for k in tried)
    return (
        _STRAIGHT_S + trials * _TRIAL_S + bands * _BAND_S + (trials + 1) * _TRIANGLE_S * triangles
    )


def compare_layouts(
    device: Device,
    build: Build,
    on_layout: Callable[[ComparedLayout], None],
    report: Report,
) -> None:
    """Make the drawn cords, straight ones and those not made yet on trial, and compute all bands.

    Args:
        device: The device.
        build: Its build.
        on_layout: Called with each layout as soon as it is finished.
        report: Called with the share of the work done and a description.

    Raises:
        DefsenseError: If the build has no layout.
    """
    layout, tried = build.layout, tried_layouts(build)
    task = load_task(device, build)
    count = len(layout.sensors)
    new = [(DRAWN, tuple(device.sensors))] if device.sensors else []
    report(0.0, "placing straight cords where the strain is largest")
    try:
        rng = np.random.default_rng(SEED)
        new.append((STRAIGHT, tuple(baselines.visual_layout(task.design, count, rng))))
    except LayoutError as error:
        on_layout(ComparedLayout(STRAIGHT, (), float("nan"), problem=str(error)))
    new += [(k.name, k.sensors) for k in tried if k.parts is None and k.problem is None]
    without_band = [k for k in tried if k.band is None and k.parts is not None]
    bench = TrialBench(device, build, task)
    for k, (name, sensors) in enumerate(new):
        report((k + 0.5) / (len(new) + 1), f"making the layout {name} on trial")
        on_layout(tried_as(name, bench.make_with_band(sensors)))
    decoded = task.with_decoder(layout.prediction.decoder)
    for k, layout_without_band in enumerate(without_band):
        report(
            (len(new) + k / len(without_band)) / (len(new) + 1),
            f"devices built as {layout_without_band.name}",
        )
        scored = predict(decoded, assumed_cords(decoded, layout_without_band.sensors))
        band, trained = _band(device, decoded, scored, layout_without_band.error)
        on_layout(replace(layout_without_band, band=band, trained=trained))


def tried_as(name: str, trial: CordTrial) -> ComparedLayout:
    """Return cords that were made on trial as a layout with a name."""
    error = trial.drawn_error if trial.error is None else trial.error
    layout = ComparedLayout(name, trial.sensors, error, trial.parts, drawn_error=trial.drawn_error)
    if trial.problem is not None:
        return replace(layout, problem=trial.problem.text)
    layout = replace(layout, warnings=trial.warnings, pieces=trial.pieces)
    if trial.band is None:
        return layout
    band = trial.band.low, trial.band.high
    return replace(layout, band=band, trained=_trained(trial.band))


def _band(
    device: Device, task: DesignTask, scored: ScoredLayout, error: float
) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """Return the errors of built devices without and with the memory of the cords, mm.

    They are scaled to the `error` as built.
    """
    shares = session_shares(device, task.weights)
    band = predict_built_devices(device, task, scored.cords, shares)
    factor = error / scored.prediction.unseen
    return (factor * band.low, factor * band.high), _trained(band, factor)
