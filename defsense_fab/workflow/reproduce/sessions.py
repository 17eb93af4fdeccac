"""Sessions of units: recorded by a twin while a hand moves it, trained on and tested."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...capture.files.formats import read_tracks
from ...capture.sessions.results import ALIGNED
from ...core.device.device import Device
from ...core.markers import FILE as MARKERS
from ...core.markers import Markers, read_markers
from ...core.progress import Progress
from ...core.storage.files import digest, storage_errors
from ...store.layout import LAYOUT, layout_hash
from ...store.mesh import RECORD
from ...twin.devices.device_fields import MechanicsTraits
from ...twin.devices.twin_traits import FilmTraits, TwinTraits
from ...twin.recordings.twin_recordings import simulate_runs
from ..sessions.twin_sessions import write_sessions
from ..tags.markers import write_markers
from ..tags.options import MarkerOptions
from ..train.options import DataFiles, TrainOptions, TwinOptions
from ..train.training import train_files
from .experiment import Experiment
from .result_files import compute_once, keep, load_kept
from .unit import Unit, measure_unit

MIN_VISIBLE_SHARE = 0.1  # of the frames; markers that are visible in fewer are omitted
TEST_VERSION = 4  # raised when a test computes other values from the same session
#: Mechanics of the twin in a quick run.
QUICK_MECHANICS = MechanicsTraits(edge=1.0, states=8, max_states=40, accuracy=0.2)


def place_tags(experiment: Experiment, unit: Unit, out: Path, progress: Progress) -> Markers:
    """Place the tags that all layouts carry on a built device, and write them to `out/markers`.

    Raises:
        CaptureError: The tags do not fit on the device.
    """
    plan, folder = experiment.session, out / "markers"
    side = None if plan.side is None else list(plan.side)
    key = digest(layout_hash(unit.build.layout), (plan.tags, plan.tag_size, side))
    if load_kept(folder / "placed.json", key) is None or not (folder / MARKERS).is_file():
        options = MarkerOptions(
            count=plan.tags, size=plan.tag_size, skin=True, side=plan.side, out=folder
        )
        write_markers(unit.device, options, progress)
        keep(folder / "placed.json", key, True)
    return read_markers(folder)


def twin_traits(experiment: Experiment, device: Device) -> TwinTraits:
    """Return the assumptions of the twin: those of `defsense twin`, with the session's cameras.

    In a quick run the twin uses the mesh of the design and fewer states.
    """
    traits, plan = TwinTraits.for_device(device), experiment.session
    if experiment.quick:
        traits = replace(traits, mechanics=QUICK_MECHANICS)
    if plan.cameras:
        kind, _, number = plan.cameras.partition(",cameras=")
        return replace(traits, film=FilmTraits(kind, int(number or 2), plan.rate))
    return replace(traits, markers=replace(traits.markers, rate=plan.rate))


def evaluate_unit(
    experiment: Experiment, unit: Unit, markers: Markers, progress: Progress
) -> dict[str, Any]:
    """Record, train and test a unit, or load the results if they were computed before.

    Args:
        experiment: The experiment.
        unit: The unit.
        markers: The tags on it.
        progress: Called with the progress.

    Returns:
        The results of `measure_unit`, the quality of the twin, and the omitted markers.

    Raises:
        DefsenseError: The unit cannot be recorded or trained on.
    """
    key = _unit_key(experiment, unit, markers)
    twin = compute_once(
        unit.file(".session.json"), key, lambda: _record(experiment, unit, markers, progress)
    )

    def train_and_test() -> dict[str, Any]:
        tracks = read_tracks(unit.session / ALIGNED)
        shares = zip(tracks.ids, tracks.visible.mean(axis=0), strict=True)
        rare = tuple(int(n) for n, share in shares if share < MIN_VISIBLE_SHARE)
        trained = train_files(
            DataFiles((unit.session,)),
            unit.device,
            TrainOptions(test_share=experiment.session.share, without_markers=rare),
            out=unit.model_file,
            is_synchronized=True,
            progress=progress,
        )
        progress("test", 0.0, "errors and their causes")
        assert trained.training is not None
        errors = measure_unit(unit, trained.training)
        progress("test", 1.0, "done")
        return {**errors, "unit": unit.number, "twin": twin, "left_out": rare}

    result: dict[str, Any] = compute_once(
        unit.file(".test.json"), digest(key, TEST_VERSION), train_and_test
    )
    return result


def _record(
    experiment: Experiment, unit: Unit, markers: Markers, progress: Progress
) -> dict[str, Any]:
    """Write the session of a unit; return the quality of the twin."""
    with storage_errors(unit.session):
        if unit.session.exists():  # made from other inputs, or interrupted before processing
            shutil.rmtree(unit.session)
    runs = simulate_runs(
        unit.device,
        TwinOptions(seed=unit.number, unit=unit.number),
        seconds=experiment.session.seconds,
        traits=twin_traits(experiment, unit.device),
        markers=markers,
        progress=progress,
    )
    write_sessions(unit.session, unit.device, runs, progress)
    return {
        "states": len(runs.fields.space.states),
        "interpolation_mm": runs.fields.error,
        "interpolation_signal": runs.fields.signal_error,
        "warnings": list(runs.fields.warnings),
    }


def _unit_key(experiment: Experiment, unit: Unit, markers: Markers) -> str:
    """Return a hash of all inputs of a unit's session and test."""
    plan, device = experiment.session, unit.device
    return digest(
        unit.build.folder / LAYOUT,
        unit.build.folder / RECORD,
        repr(device.material),
        repr(device.poses),
        device.converter,
        (plan.frames, plan.rate, plan.cameras, plan.share, unit.number),
        (markers.size, markers.ids.tolist(), markers.centers.tolist(), markers.axes.tolist()),
        repr(twin_traits(experiment, device)),
    )
