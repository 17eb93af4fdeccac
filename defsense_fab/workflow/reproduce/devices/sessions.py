"""A unit of a device: recorded by its twin while a hand moves it, trained on, and tested."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ....capture.files.formats import read_tracks
from ....capture.sessions.result_files import ALIGNED
from ....core.device.build_folder import build_folder
from ....core.device.device import Device
from ....core.markers import FILE as MARKERS
from ....core.markers import Markers, read_markers
from ....core.progress import Progress
from ....core.storage.files import digest, storage_errors
from ....store.layout import LAYOUT, layout_hash, load_layout
from ....store.mesh import RECORD
from ....training.fitting.train_model import TrainingOptions
from ....training.models.train_device import train_files
from ....training.recordings.datasets import DataFiles
from ....twin.devices.device_fields import MechanicsTraits
from ....twin.devices.twin_traits import FilmTraits, TwinTraits
from ....twin.recordings.twin_recordings import simulate_runs
from ...sessions.twin_sessions import write_sessions
from ...tags.markers import write_markers
from ..experiments.experiment import Experiment, SessionPlan
from ..results.kept import keep, kept, once
from .unit_errors import unit_errors

#: Markers that the cameras see in a smaller share of the pictures are left out.
_SEEN = 0.1
#: Raised when a test tells other things of the same session.
_TESTED = 3
#: Of the twin at a small size: relative edges, states a way to move, at most, and mm.
_SMALL = MechanicsTraits(edge=1.0, states=8, max_states=40, accuracy=0.2)


def tags_of(experiment: Experiment, device: Device, out: Path, progress: Progress) -> Markers:
    """The tags that all layouts carry, placed on this built device and written to `out/markers`.
    Raises CaptureError where they do not fit."""
    plan, folder = experiment.session, out / "markers"
    side = None if plan.side is None else list(plan.side)
    key = digest(_layout(device), (plan.tags, plan.tag_size, side))
    found = kept(folder / "placed.json", key)
    if found is None or not (folder / MARKERS).is_file():
        write_markers(
            device, folder, count=plan.tags, size=plan.tag_size, skin=True,
            side=None if side is None else np.array(side),
            progress=progress,
        )  # fmt: skip
        keep(folder / "placed.json", key, True)
    return read_markers(folder)


def traits_of(experiment: Experiment, device: Device) -> TwinTraits:
    """What the twin is taken to be: as `defsense twin` has it, filmed by the session's cameras; at
    a small size on the design's own mesh, with fewer solved states."""
    traits, plan = TwinTraits.for_device(device), experiment.session
    if experiment.quick:
        traits = replace(traits, mechanics=_SMALL)
    if plan.cameras:
        kind, _, number = plan.cameras.partition(",cameras=")
        traits = replace(traits, film=FilmTraits(kind, int(number or 2), plan.rate))
    else:
        traits = replace(traits, markers=replace(traits.markers, rate=plan.rate))
    return traits


def tested_unit(
    experiment: Experiment, device: Device, markers: Markers, unit: int, progress: Progress
) -> dict[str, Any]:
    """What `unit_errors` tells of the unit of this number, from its session, recorded now or
    before. Raises a DefsenseError where that fails."""
    plan = experiment.session
    traits = traits_of(experiment, device)
    key = unit_key(experiment, device, markers, unit)
    session, model = unit_session(device, unit), unit_model(device, unit)
    told = once(
        session.with_suffix(".session.json"), key,
        lambda: _record(session, device, markers, plan, traits, unit, progress),
    )  # fmt: skip

    def tested() -> dict[str, Any]:
        rare = _rare(session)
        trained = train_files(
            DataFiles((session,)), device, TrainingOptions(test_share=plan.share), out=model,
            excluded_markers=rare, is_synchronized=True, progress=progress,
        )  # fmt: skip
        progress("test", 0.0, "errors and what they come from")
        found = unit_errors(device, session, model, trained.training)
        progress("test", 1.0, "done")
        return {**found, "unit": unit, "twin": told, "left_out": rare}

    result: dict[str, Any] = once(session.with_suffix(".test.json"), digest(key, _TESTED), tested)
    return result


def unit_session(device: Device, unit: int) -> Path:
    """Where a unit's session is."""
    return device.source / f"unit-{unit}"


def unit_model(device: Device, unit: int) -> Path:
    """Where the model trained on it is."""
    return device.source / f"unit-{unit}.json"


def _record(
    session: Path, device: Device, markers: Markers, plan: SessionPlan, traits: TwinTraits,
    unit: int, progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """What is told of how the twin was solved and read."""
    with storage_errors(session):
        if session.exists():  # of other inputs, or interrupted before it was processed
            shutil.rmtree(session)
    made = simulate_runs(
        device, seconds=plan.seconds, seed=unit, unit=unit, traits=traits, markers=markers,
        progress=progress,
    )  # fmt: skip
    write_sessions(session, device, made, progress)
    return {
        "states": len(made.fields.space.states),
        "interpolation_mm": made.fields.error,
        "interpolation_signal": made.fields.signal_error,
        "warnings": list(made.fields.warnings),
    }


def _layout(device: Device) -> str:
    return layout_hash(load_layout(build_folder(device)))


def unit_key(experiment: Experiment, device: Device, markers: Markers, unit: int) -> str:
    """Of all that a unit's session and test depend on."""
    folder, plan, traits = build_folder(device), experiment.session, traits_of(experiment, device)
    told = (plan.frames, plan.rate, plan.cameras, plan.share, unit)
    tags = (markers.size, markers.ids.tolist(), markers.centers.tolist(), markers.axes.tolist())
    return digest(
        folder / LAYOUT, folder / RECORD, repr(device.material), repr(device.poses),
        device.converter, told, tags, repr(traits),
    )  # fmt: skip


def _rare(session: Path) -> list[int]:
    """Markers that the cameras hardly ever see."""
    tracks = read_tracks(session / ALIGNED)
    seen = tracks.seen.mean(axis=0)
    return [int(n) for n, s in zip(tracks.ids, seen, strict=True) if s < _SEEN]
