"""Prepare datasets for training: align, check, and compare with the simulation."""

from __future__ import annotations

import igl
import numpy as np

from ...core.arrays import Float
from ...core.device.build_folder import finished_build
from ...core.device.device import Device
from ...core.errors import DefsenseError, TrainingError
from ...core.progress import Progress, silent
from ...sensing.built_cord import CordReading
from ...store.build import Build
from ...store.fields import INDEX
from ...store.layout import LAYOUT
from ..data.dataset import Dataset
from ..data.dataset_assembly import exclude_channels, exclude_markers, exclude_uncertain_positions
from ..data.dataset_checks import CLOCK_CODES, require_trainable
from ..data.problems import raise_fatal
from ..data.time_alignment import align_samples
from ..data.unit_checks import check_cord_resistance, check_units
from ..options import ClockShift, DataFiles, PriorMode, TrainOptions
from ..recordings.datasets import describe_files, match_to_device
from ..regression.frames import Frames
from ..regression.simulation_prior import Prior, measure_coverage, predict_signals

_MIN_UNCERTAIN_SHARE = 1e-3  # of the positions; a smaller share is not reported
# Markers on printed tags are above the skin, but not by more.
_MAX_BODY_DISTANCE_MM = 5.0


def prepare(
    dataset: Dataset,
    device: Device | None,
    options: TrainOptions | None = None,
    *,
    build: Build | None = None,
    is_synchronized: bool = False,
    shift: ClockShift = DataFiles.shift,
    progress: Progress = silent,
) -> tuple[Dataset, Prior | None, list[str]]:
    """Prepare a dataset for training.

    Args:
        dataset: The dataset as recorded.
        device: The device, if available.
        options: Options of the training: its prior, and the markers to leave out.
        build: The device's build; by default that in its folder.
        is_synchronized: As in `require_trainable`.
        shift: Seconds to add to the times of the samples, or "auto" to find them.
        progress: Called with the stage "data".

    Returns:
        The prepared dataset, the simulated states to start from (None if they are not used), and
        notes on doubtful data and poses that were not shown.

    Raises:
        TrainingError: If a problem forbids training.
    """
    options = options or TrainOptions()
    dataset = match_to_device(dataset, device, build)
    notes = describe_files(dataset)
    if options.without_channels:
        dataset = exclude_channels(dataset, options.without_channels)
    dataset, channel_notes = _exclude_constant(dataset)
    dataset, marker_notes = _exclude_unusable(dataset, options.without_markers)
    notes += channel_notes + marker_notes
    raise_fatal(check_units(dataset))
    if device is not None and dataset.readings is None:
        shortest_ohm = device.cord.ohm_per_mm * device.cord.min_stretch
        raise_fatal(check_cord_resistance(dataset, shortest_ohm))
    progress("data", 0.4, "aligning signals and markers")
    if options.in_step and shift != 0:
        raise TrainingError(
            "contradicts a shift of the signals",
            code="options-conflict",
            where="in_step",
            action="Omit one of them",
            option="in_step",
        )
    dataset, shift_notes = align_samples(dataset, shift)
    notes += shift_notes
    progress("data", 0.6, "checking")
    prior, prior_notes = load_prior(dataset, device, options.prior, build)
    notes += prior_notes
    predicted = predict_recordings(prior, dataset)
    problems = require_trainable(dataset, predicted=predicted, is_synchronized=is_synchronized)
    if options.in_step:
        problems = tuple(p for p in problems if p.code not in CLOCK_CODES)
        notes.append("signals and markers are in step, as stated")
    notes += [str(p) for p in problems]
    units = sorted({r.unit for r in dataset.recordings})
    if len(units) > 1:
        notes.append(
            f"{', '.join(units)} are different devices: one model for all of them has additional"
            " errors from their differences; train one for each"
        )
    if prior is not None:
        coverage = measure_coverage(Frames.from_dataset(dataset), prior)
        notes.append(f"{coverage.share:.0%} of the simulated states were shown")
        notes += coverage.advice
    progress("data", 1.0, "done")
    return dataset, prior if options.prior != "no" else None, notes


def _exclude_constant(dataset: Dataset) -> tuple[Dataset, list[str]]:
    """Exclude channels of readings that have no value or never change; return notes."""
    if dataset.readings is None:
        return dataset, []
    silent, constant = list[str](), list[str]()
    for k, name in enumerate(dataset.channels):
        values = np.concatenate([r.ohm[:, k] for r in dataset.recordings])
        values = values[np.isfinite(values)]
        if not len(values):
            silent.append(name)
        elif (values == values[0]).all():
            constant.append(name)
    if len(silent) + len(constant) == len(dataset.channels):
        raise TrainingError(
            f"no channel changes: {', '.join(dataset.channels)}",
            code="constant-channel",
            where=", ".join(r.name for r in dataset.recordings),
            action="Check how the sensor is connected, and record again",
            channels=dataset.channels,
        )
    notes = [f"{name} has no value, and is left out" for name in silent]
    notes += [f"{name} never changes, and is left out" for name in constant]
    if notes:
        dataset = exclude_channels(dataset, [*silent, *constant])
    return dataset, notes


def _exclude_unusable(
    dataset: Dataset, without_markers: tuple[int, ...]
) -> tuple[Dataset, list[str]]:
    """Exclude markers, those that are never visible, and uncertain positions; return notes."""
    notes = []
    is_visible = np.any([r.visible.any(axis=0) for r in dataset.recordings], axis=0)
    never = dataset.ids[~is_visible].tolist()
    if never and len(never) < len(dataset.ids):
        numbers = dataset.describe(np.flatnonzero(~is_visible).tolist())
        notes.append(
            f"{numbers} is never visible, so the model does not decode it"
            if dataset.targets is None
            else f"{numbers} has no value, so the model does not decode it"
        )
    if excluded := sorted({*without_markers, *never}):
        dataset = exclude_markers(dataset, excluded)
    dataset, share = exclude_uncertain_positions(dataset)
    return dataset, notes + describe_uncertain(share)


def simulated_prior(
    device: Device, channels: tuple[str, ...], rest_points: Float, build: Build | None = None
) -> Prior:
    """Compute the simulated states of a built device, with the cord's present response.

    Args:
        device: The device, whose build is complete.
        channels: Names of its channels, in the required order.
        rest_points: Marker positions at rest, shape (m, 3), mm, in the device's rest frame.
        build: The device's build; by default that in its folder.

    Returns:
        The states, rest first.

    Raises:
        TrainingError: If channels or markers are not the device's.
    """
    folder = finished_build(device, LAYOUT, INDEX)
    build = build or Build(folder)
    fields, locator, surface = build.fields, build.locator, build.surface
    cords = {record.name: record.built for record in build.layout.by_channel()}
    if set(cords) != set(channels):
        raise TrainingError(
            f"the device's cords are {', '.join(cords)}, but the recordings' channels are"
            f" {', '.join(channels)}",
            code="channels-differ",
            where=folder,
            action="Give recordings of this device and layout",
            missing=tuple(name for name in cords if name not in channels),
            extra=tuple(name for name in channels if name not in cords),
        )
    reading = CordReading.from_device(device)

    def displacements_at(points: Float) -> Float:
        u = locator.displacement(locator.find(points), fields.displacements)
        return np.concatenate([np.zeros((1, *points.shape)), u])

    square = igl.point_mesh_squared_distance(rest_points, surface.vertices, surface.faces)[0]
    is_outside = locator.find(rest_points).depth < 0
    distance = np.where(is_outside, np.sqrt(np.asarray(square)), 0.0)
    if (distance > _MAX_BODY_DISTANCE_MM).any():
        k = int(distance.argmax())
        raise TrainingError(
            f"marker {k + 1} at {np.round(rest_points[k], 1).tolist()} mm is {distance[k]:.0f} mm"
            f" from the body of {device.name}",
            code="markers-off-body",
            action="Give tracks of this device, in its rest frame",
            index=k,
            distance_mm=float(distance[k]),
        )
    signals = [
        reading.signals(cords[name], cords[name].path + displacements_at(cords[name].path))
        for name in channels
    ]
    names = ("rest", *fields.names)
    return Prior(names, np.stack(signals, axis=1), displacements_at(rest_points))


def load_prior(
    dataset: Dataset, device: Device | None, mode: PriorMode, build: Build | None = None
) -> tuple[Prior | None, list[str]]:
    """Load the simulated states of a dataset's device, if it is built.

    Args:
        dataset: The dataset.
        device: The device, if available.
        mode: "yes" if the simulation is required, otherwise "auto" or "no".
        build: The device's build; by default that in its folder.

    Returns:
        The states, or None, and a note if the simulation cannot be used.

    Raises:
        TrainingError: If the simulation is required and not available.
    """
    if device is None:
        if mode == "yes":
            raise TrainingError(
                "the simulation is only available for a built device",
                code="device-missing",
                where="prior",
                action="Give the device's folder",
            )
        return None, []
    if dataset.targets is not None:
        if mode == "yes":
            raise TrainingError(
                "the simulation decodes markers, not other targets",
                code="options-conflict",
                where="prior",
                action="Omit it, or give tracks of markers",
                option="prior",
            )
        return None, ["the simulation is not used: it decodes markers, not other targets"]
    try:
        return simulated_prior(device, dataset.channels, dataset.rest_points, build), []
    except DefsenseError as error:
        if mode == "yes":
            raise
        return None, [f"the simulation is not used: {error}"]


def predict_recordings(prior: Prior | None, dataset: Dataset) -> dict[str, Float]:
    """Return predicted signals (t, c) of each recording by its name; none without a prior."""
    if prior is None:
        return {}
    return {r.name: predict_signals(prior, r, dataset.rest_points) for r in dataset.recordings}


def describe_uncertain(share: float) -> list[str]:
    """Return a note on the share of positions that were left out as uncertain, if it is notable."""
    if share < _MIN_UNCERTAIN_SHARE:
        return []
    return [
        f"{share:.1%} of the marker positions are left out: they were seen at such a slant that the"
        " cameras hardly determine them"
    ]
