"""Training sessions of a device that is not there: what its cords would say while it is moved, and
where cameras would see its markers, with the truth beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import igl
import numpy as np

from ...capture.sessions.rest_resistance import rest_resistances
from ...capture.sessions.sample_table import ClockPart
from ...capture.sessions.signals import resistances_at
from ...core.arrays import Bool, Float, Int
from ...core.device.device import CONVERTERS, Device
from ...core.errors import CaptureError
from ...core.markers import Markers
from ...core.progress import Progress, silent
from ...core.device.build_folder import finished_build
from ...geometry.bodies.body_record import load_surface
from ...sensing.layout import (
    LAYOUT,
    PREDICTION,
    LayoutRecord,
    layout_hash,
    load_layout,
    load_prediction,
)
from ...sensing.voltage_divider import reference
from ...training.data.dataset import Dataset, Recording
from ..devices.built_unit import BuiltUnit, build_unit
from ..devices.device_fields import DeviceFields, solve_fields
from ..devices.pose_samples import add_grips, place_grips
from ..devices.twin_traits import TwinTraits
from ..electronics.readout_board import Converter
from ..electronics.rubber_cords import RubberState
from ..scenes.hand_walk import REST, Walk, plan_walk
from ..scenes.marker_measurement import measure_markers

# The places that a device is designed to tell, as if tags were glued there.

_SIZES = (50, 100, 250, 1000)  # of the dictionaries of 4 x 4 tags


def design_markers(device: Device, folder: Path) -> Markers:
    """Numbered from 0, upright on the skin. Raises CaptureError for more than can be numbered."""
    centers = load_prediction(folder).markers
    family = next((n for n in _SIZES if n >= len(centers)), None)
    if family is None:
        raise CaptureError(
            f"{device.source}: has {len(centers)} markers; a twin shows {_SIZES[-1]} at most: give"
            " tags with --markers, or a number of [outputs] markers"
        )
    surface = load_surface(folder)
    _, face, _ = igl.point_mesh_squared_distance(centers, surface.vertices, surface.faces)[:3]
    a, b, c = np.moveaxis(surface.vertices[surface.faces[face]], 1, 0)
    anchor = device.outputs.anchor
    held = device.regions[anchor].contains(centers) if anchor else np.zeros(len(centers), bool)
    return Markers(
        device.name, f"4X4_{family}", device.fabrication.marker_size, np.arange(len(centers)),
        centers, _axes(np.cross(b - a, c - a)), held,
    )  # fmt: skip


def _axes(normals: Float) -> Float:
    """(m, 3, 3) of normals (m, 3) of any length."""
    z = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.eye(3)[np.abs(z).argmin(axis=1)]
    x = np.cross(across, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


_FIRST_REST = 0.3  # of a rest, that R0 is not taken from: as a session's rests are processed
_LATE = 0.002  # s, at least, that samples arrive after they were taken


@dataclass(frozen=True)
class Truth:
    """What no camera sees. At the pictures' times `time` (t,) s: markers `points` (t, m, 3) mm. At
    the samples' true times `sample_time` (n,) s by the same clock: poses' `weights` (n, d), signals
    (n, c) of the same cords without memory, and resistances `ohm` (n, c) before the converter."""

    time: Float
    points: Float
    sample_time: Float
    weights: Float
    signals: Float
    ohm: Float


@dataclass(frozen=True)
class TwinRun:
    """A run as it would be recorded: sums of conversions (n, c) with the read-out board's clock and
    the host's when they arrived, resistances `at` (t, c) ohm at the pictures, which of those are at
    `rest` (t,), how the clocks were compared, what was asked of the hand."""

    recording: Recording
    truth: Truth
    sums: Int
    device_us: Int
    host_ns: Int
    at: Float
    rest: Bool
    clock: ClockPart
    walk: Walk


@dataclass(frozen=True)
class TwinRuns:
    """Sessions of one built device, in their order, with the data set that they make."""

    dataset: Dataset
    runs: tuple[TwinRun, ...]
    markers: Markers
    converter: Converter
    traits: TwinTraits
    fields: DeviceFields


def simulate_recordings(device: Device, **options: Any) -> Dataset:
    """What `simulate_runs` makes, for training alone; its options."""
    return simulate_runs(device, **options).dataset


def simulate_runs(
    device: Device, *, seconds: float = 600.0, sessions: int = 1, seed: int = 1, unit: int = 1,
    off: Sequence[str] = (), traits: TwinTraits | None = None, markers: Markers | None = None,
    grip_count: int = 0, progress: Progress = silent,
) -> TwinRuns:  # fmt: skip
    """`sessions` of so many seconds of the built device of the number `unit`, moved by the hand of
    this `seed`; traits named in `off` are switched off. Markers are the device's outputs unless
    tags are given; `grip_count` places are pulled at besides the poses. Raises CaptureError for a
    device that is not built, and names of no trait."""
    own = (traits or TwinTraits.of(device)).disable_traits(off)
    folder = finished_build(device, LAYOUT, PREDICTION)
    layout = load_layout(folder)
    seen = markers or design_markers(device, folder)
    poses = add_grips(device.poses, place_grips(device, folder, grip_count))
    fields = solve_fields(device, own.mechanics, progress, poses)
    built = build_unit(device, layout, fields, unit, own.building, own.rubber)
    stage = _Stage(device, layout, own, seen, fields, built, fields.displacements(seen.centers))
    state, runs = RubberState.new(own.rubber, len(built.cords)), []
    for k in range(sessions):
        progress("recording", k / sessions, f"session {k + 1} of {sessions}")
        run, state = _run(stage, k, seconds, seed, unit, state)
        state = state.after_rest(own.rubber, own.between)
        runs.append(run)
    progress("recording", 1.0, "done")
    told = {
        "twin": True, "seed": seed, "unit": unit, "off": sorted(off), "grips": grip_count,
        "response": _response(device), "assembly": device.fabrication.assembly,
        "interpolation_mm": fields.error, "interpolation_signal": fields.signal_error,
    }  # fmt: skip
    dataset = Dataset(
        device.name, layout_hash(layout), tuple(r.name for r in layout.by_channel()), seen.ids,
        seen.centers, tuple(r.recording for r in runs), told,
    )  # fmt: skip
    return TwinRuns(dataset, tuple(runs), seen, stage.converter, own, fields)


def _response(device: Device) -> dict[str, Any]:
    """As in `response.json`, but without strains for one that holds everywhere: JSON knows no
    infinite numbers."""
    told = device.cord.response.to_json()
    if not np.isfinite(told["strain_range"]).all():
        told.pop("strain_range")
    return told


@dataclass(frozen=True)
class _Stage:
    """What all sessions of one built device have in common; `shown` (s, m, 3) mm are the
    displacements of its markers."""

    device: Device
    layout: LayoutRecord
    traits: TwinTraits
    markers: Markers
    fields: DeviceFields
    built: BuiltUnit
    shown: Float

    @property
    def converter(self) -> Converter:
        """With the resistors that the cut list names for cords as they are sold."""
        full_scale, averages = CONVERTERS[self.device.converter]
        nominal = [r.resistance(c) for c, r in zip(self.built.cords, self.built.readings,
                                                   strict=True)]  # fmt: skip
        resistors = np.array([reference(0.95 * ohm, 1.3 * ohm) for ohm in nominal])
        return Converter.from_traits(self.traits.board, full_scale, averages, resistors)


def _run(
    stage: _Stage, number: int, seconds: float, seed: int, unit: int, state: RubberState
) -> tuple[TwinRun, RubberState]:
    # Generators of their own, so that what one trait draws does not change the others, and all
    # units are moved alike.
    hand = np.random.default_rng([seed, number])
    rubber, board, camera = (np.random.default_rng([seed, number, unit, k]) for k in range(3))
    t, b = stage.traits, stage.traits.board
    path = plan_walk(
        stage.fields.poses, stage.fields.together, seconds, hand, t.hand, len(stage.device.poses)
    )
    time = np.arange(int(seconds * t.markers.rate)) / t.markers.rate
    at = np.arange(int(seconds * b.rate)) / b.rate + 0.4 / b.rate
    weights = path(at)
    signals = stage.built.signals(stage.fields.space(weights))
    pieces = replace(stage.built.pieces, age=t.age + number * t.between / 24)
    ohm, state = pieces.simulate(at, signals, state, rubber)
    converter = stage.converter
    sums = converter.convert(ohm, b.own_noise, board)
    device_us = np.round(1e6 * (b.offset + (1 + b.drift) * at)).astype(np.int64)
    arrival = at + _LATE + board.exponential(_LATE, len(at))
    host_ns = np.maximum.accumulate(np.round(1e9 * arrival).astype(np.int64))
    off = b.sync_error * float(board.normal())
    clock = ClockPart(slice(0, len(at)), off - b.offset / (1 + b.drift), 1 / (1 + b.drift) - 1)
    sample_time: Float = clock.offset + (1 + clock.drift) * device_us.astype(float) / 1e6
    moved = stage.fields.space(path(time)) @ stage.shown.reshape(len(stage.shown), -1)
    points = stage.markers.centers + moved.reshape(len(time), -1, 3)
    thin = int(np.ptp(stage.markers.centers, axis=0).argmin())
    seen, sigma = measure_markers(time, points, thin, t.markers, camera)
    read = converter.to_resistances(sums)
    beside, rest = resistances_at(time, sample_time, read), _resting(path, time, seconds)
    R0, _ = rest_resistances(["run-1"], [r.name for r in stage.layout.by_channel()], [beside],
                             [rest])  # fmt: skip
    name = f"session-{number + 1}"
    recording = Recording(
        "run-1", name, f"twin-{unit}", sample_time, read, R0[0], time, seen, sigma, b.sync_error,
        path.steps,
    )  # fmt: skip
    truth = Truth(time, points, at, weights, signals, ohm)
    return TwinRun(recording, truth, sums, device_us, host_ns, beside, rest, clock, path), state


def _resting(path: Walk, time: Float, seconds: float) -> Bool:
    """Pictures (t,) of rests, but for their beginnings."""
    out = np.zeros(len(time), bool)
    ends = [*(begin for begin, _ in path.steps[1:]), seconds]
    for (begin, name), end in zip(path.steps, ends, strict=True):
        if name == REST:
            out |= (time > begin + _FIRST_REST * (end - begin)) & (time < end)
    return out
