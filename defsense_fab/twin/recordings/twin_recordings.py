"""Simulated training sessions of a built device: cord readings, marker tracks and the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import igl
import numpy as np

from ...capture.sessions.results import ClockPart
from ...capture.sessions.signals import resistances_at, rest_resistances
from ...core.arrays import Bool, Float, Int
from ...core.device.boards import CONVERTERS
from ...core.device.build_folder import finished_build
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Markers
from ...core.progress import Progress, silent
from ...sensing.voltage_divider import choose_reference
from ...store.build import Build
from ...store.layout import LAYOUT, PREDICTION, LayoutRecord, layout_hash
from ...training.data.dataset import Dataset, Recording
from ..devices.built_unit import BuiltUnit, build_unit
from ..devices.device_fields import DeviceFields, solve_fields
from ..devices.pose_samples import add_grips
from ..devices.twin_traits import TwinTraits
from ..electronics.readout_board import Converter
from ..electronics.rubber_cords import RubberState
from ..options import TwinOptions
from ..scenes.device_motion import REST
from ..scenes.hand_walk import Walk, plan_walk
from ..scenes.marker_measurement import measure_markers

DICTIONARY_SIZES = (50, 100, 250, 1000)  # of the dictionaries of 4 x 4 tags
SETTLING_SHARE = 0.3  # of a rest, which is not used for R0, as in the processing of sessions
SAMPLE_PHASE = 0.4  # of a sample's period, after which the first sample is taken
ARRIVAL_DELAY_S = 0.002  # shortest delay of samples, and mean of the random delay
RESISTOR_RANGE = (0.95, 1.3)  # of a cord's resistance, for which its resistor is chosen


@dataclass(frozen=True)
class Truth:
    """What a recording does not contain.

    Attributes:
        time: Times of the frames (t,) s.
        points: True positions of the markers (t, m, 3) mm.
        sample_time: True times of the samples (n,) s, by the same clock.
        weights: Weights of the poses (n, d).
        signals: Signals (R - R0)/R0 (n, c) of the same cords without memory.
        ohm: Resistances (n, c) ohm before the converter.
    """

    time: Float
    points: Float
    sample_time: Float
    weights: Float
    signals: Float
    ohm: Float


@dataclass(frozen=True)
class TwinRun:
    """One simulated session.

    Attributes:
        recording: The recording for training.
        truth: The truth about it.
        sums: Sums of conversions (n, c).
        device_us: Times of the samples by the board's clock (n,) microseconds.
        host_ns: Arrival times by the host's clock (n,) ns.
        frame_ohm: Resistances (t, c) ohm at the frames.
        rest: Whether the device is at rest in a frame (t,).
        clock: How the clocks were synchronized.
        walk: The walk of the hand.
    """

    recording: Recording
    truth: Truth
    sums: Int
    device_us: Int
    host_ns: Int
    frame_ohm: Float
    rest: Bool
    clock: ClockPart
    walk: Walk


@dataclass(frozen=True)
class TwinRuns:
    """Simulated sessions of one built device.

    Attributes:
        dataset: The data set that they make.
        runs: The sessions in their order.
        markers: The markers.
        converter: The converter of the read-out board.
        traits: The assumptions.
        fields: The displacement fields of the device.
        built: The built device.
    """

    dataset: Dataset
    runs: tuple[TwinRun, ...]
    markers: Markers
    converter: Converter
    traits: TwinTraits
    fields: DeviceFields
    built: BuiltUnit


def simulate_runs(
    device: Device,
    options: TwinOptions | None = None,
    *,
    seconds: float | None = None,
    traits: TwinTraits | None = None,
    markers: Markers | None = None,
    progress: Progress = silent,
) -> TwinRuns:
    """Simulate training sessions of a built device.

    Args:
        device: The device.
        options: Options of the sessions.
        seconds: Exact duration of a session, s; None for that of the options.
        traits: Assumptions that replace those of the options, except for `options.off`.
        markers: Tags on the device; None for the device's outputs.
        progress: Called with the progress.

    Raises:
        CaptureError: The device is not built, or there is no such trait.
    """
    options = options or TwinOptions()
    traits = traits or TwinTraits.for_device(device, options)
    traits = traits.disable_traits(options.off)
    seconds = 60 * options.minutes if seconds is None else seconds
    build = Build(finished_build(device, LAYOUT, PREDICTION))
    markers = markers or make_design_markers(device, build)
    poses = add_grips(device, build, options.grips)
    fields = solve_fields(device, traits.mechanics, progress, poses, build)
    built = build_unit(device, build.layout, fields, options.unit, traits.building, traits.rubber)
    displacements = fields.displacements(markers.centers)
    setup = _Setup(device, build.layout, traits, markers, fields, built, displacements)
    state, runs = RubberState.new(traits.rubber, len(built.cords)), []
    for k in range(options.sessions):
        progress("recording", k / options.sessions, f"session {k + 1} of {options.sessions}")
        run, state = _simulate_run(setup, k, seconds, options, state)
        state = state.after_rest(traits.rubber, traits.between)
        runs.append(run)
    progress("recording", 1.0, "done")
    dataset = Dataset(
        device.name,
        layout_hash(build.layout),
        tuple(r.name for r in build.layout.by_channel()),
        markers.ids,
        markers.centers,
        tuple(r.recording for r in runs),
        _provenance(device, options, fields),
    )
    return TwinRuns(dataset, tuple(runs), markers, setup.converter, traits, fields, built)


def make_design_markers(device: Device, build: Build) -> Markers:
    """Return upright markers at the points of the design's prediction, numbered from 0.

    Raises:
        CaptureError: There are more points than tags in a dictionary (`too-many-markers`).
    """
    centers = build.prediction.markers
    family = next((n for n in DICTIONARY_SIZES if n >= len(centers)), None)
    if family is None:
        raise CaptureError(
            f"has {len(centers)} markers; a twin has {DICTIONARY_SIZES[-1]} at most",
            code="too-many-markers",
            where=device.source,
            action="Give tags, or set a number of markers in [outputs]",
            count=len(centers),
        )
    surface = build.surface
    _, face, _ = igl.point_mesh_squared_distance(centers, surface.vertices, surface.faces)[:3]
    a, b, c = np.moveaxis(surface.vertices[surface.faces[face]], 1, 0)
    anchor = device.outputs.anchor
    is_anchor = device.regions[anchor].contains(centers) if anchor else np.zeros(len(centers), bool)
    return Markers(
        device.name,
        f"4X4_{family}",
        device.fabrication.marker_size,
        np.arange(len(centers)),
        centers,
        _upright_axes(np.cross(b - a, c - a)),
        is_anchor,
    )


def _upright_axes(normals: Float) -> Float:
    """Return rotations (m, 3, 3) with the directions of normals (m, 3) as their third axes."""
    z = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.eye(3)[np.abs(z).argmin(axis=1)]
    x = np.cross(across, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _provenance(device: Device, options: TwinOptions, fields: DeviceFields) -> dict[str, Any]:
    return {
        "twin": True,
        "seed": options.seed,
        "unit": options.unit,
        "cords": options.family(device),
        "off": sorted(options.off),
        "grips": options.grips,
        "response": _response(device),
        "assembly": device.fabrication.assembly,
        "interpolation_mm": fields.error,
        "interpolation_signal": fields.signal_error,
    }


def _response(device: Device) -> dict[str, Any]:
    """Return the response as in `response.json`, without an infinite range, which JSON lacks."""
    response = device.cord.response.to_json()
    if not np.isfinite(response["strain_range"]).all():
        response.pop("strain_range")
    return response


@dataclass(frozen=True)
class _Setup:
    """What all sessions of one built device share.

    `displacements` (s, m, 3) mm are those of its markers.
    """

    device: Device
    layout: LayoutRecord
    traits: TwinTraits
    markers: Markers
    fields: DeviceFields
    built: BuiltUnit
    displacements: Float

    @property
    def converter(self) -> Converter:
        """The converter with the resistors that the cut list names for cords as they are sold."""
        full_scale, averages = CONVERTERS[self.device.converter]
        cords = zip(self.built.cords, self.built.readings, strict=True)
        nominal = [reading.resistance(cord) for cord, reading in cords]
        low, high = RESISTOR_RANGE
        resistors = np.array([choose_reference(low * ohm, high * ohm) for ohm in nominal])
        return Converter.from_traits(self.traits.board, full_scale, averages, resistors)


def _simulate_run(
    setup: _Setup, number: int, seconds: float, options: TwinOptions, state: RubberState
) -> tuple[TwinRun, RubberState]:
    """Return a session and the state of the cords after it."""
    # Each part has its own generator, so that the draws of one trait do not change the others, and
    # all units are moved in the same way.
    seed, unit = options.seed, options.unit
    hand = np.random.default_rng([seed, number])
    rubber, board, camera = (np.random.default_rng([seed, number, unit, k]) for k in range(3))
    t, b = setup.traits, setup.traits.board
    fields, channels = setup.fields, [r.name for r in setup.layout.by_channel()]
    pose_count = len(setup.device.poses)
    walk = plan_walk(fields.poses, fields.mixable, seconds, hand, t.hand, pose_count)
    time = np.arange(int(seconds * t.markers.rate)) / t.markers.rate
    true_time = np.arange(int(seconds * b.rate)) / b.rate + SAMPLE_PHASE / b.rate
    weights = walk(true_time)
    signals = setup.built.signals(fields.space(weights))
    pieces = replace(setup.built.pieces, age=t.age + number * t.between / 24)
    ohm, state = pieces.simulate(true_time, signals, state, rubber)
    converter = setup.converter
    sums = converter.convert(ohm, b.own_noise, board)
    device_us = np.round(1e6 * b.clock(true_time)).astype(np.int64)
    arrival = true_time + ARRIVAL_DELAY_S + board.exponential(ARRIVAL_DELAY_S, len(true_time))
    host_ns = np.maximum.accumulate(np.round(1e9 * arrival).astype(np.int64))
    sync_error = b.sync_error * float(board.normal())
    offset = sync_error - b.offset / (1 + b.drift)
    clock = ClockPart(slice(0, len(true_time)), offset, 1 / (1 + b.drift) - 1)
    sample_time: Float = clock.offset + (1 + clock.drift) * device_us.astype(float) / 1e6
    states = len(setup.displacements)
    moved = fields.space(walk(time)) @ setup.displacements.reshape(states, -1)
    points = setup.markers.centers + moved.reshape(len(time), -1, 3)
    shortest_axis = int(np.ptp(setup.markers.centers, axis=0).argmin())
    measured, sigma = measure_markers(time, points, shortest_axis, t.markers, camera)
    read_ohm = converter.to_resistances(sums)
    frame_ohm = resistances_at(time, sample_time, read_ohm)
    rest = _find_rest(walk, time, seconds)
    R0, _ = rest_resistances(["run-1"], channels, [frame_ohm], [rest])
    recording = Recording(
        "run-1",
        f"session-{number + 1}",
        f"twin-{unit}",
        sample_time,
        read_ohm,
        R0[0],
        time,
        measured,
        sigma,
        b.sync_error,
        walk.steps,
    )
    truth = Truth(time, points, true_time, weights, signals, ohm)
    run = TwinRun(recording, truth, sums, device_us, host_ns, frame_ohm, rest, clock, walk)
    return run, state


def _find_rest(walk: Walk, time: Float, seconds: float) -> Bool:
    """Return which frames (t,) are at rest, without the first part of each rest."""
    is_rest = np.zeros(len(time), bool)
    ends = [*(start for start, _ in walk.steps[1:]), seconds]
    for (start, name), end in zip(walk.steps, ends, strict=True):
        if name == REST:
            is_rest |= (time > start + SETTLING_SHARE * (end - start)) & (time < end)
    return is_rest
