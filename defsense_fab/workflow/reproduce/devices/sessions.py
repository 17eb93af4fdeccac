"""Units of a device: recorded by its twin while a hand moves it, trained on and tested.

The causes of a unit's error are found by simulating it again without one cause after another: the
same unit is moved by the same hand with some traits of the twin disabled, trained on and tested.
No real device allows that, and no model of the error is needed.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ....capture.files.formats import read_tracks
from ....capture.sessions.results import ALIGNED
from ....core.device.build_folder import build_folder
from ....core.device.device import Device
from ....core.markers import FILE as MARKERS
from ....core.markers import Markers, read_markers
from ....core.progress import Progress, silent
from ....core.storage.files import digest, storage_errors
from ....store.layout import LAYOUT, layout_hash, load_layout
from ....store.mesh import RECORD
from ....training.fitting.train_model import TrainingOptions, train
from ....training.models.prepare import simulated_prior
from ....training.models.train_device import train_files
from ....training.recordings.datasets import DataFiles
from ....twin.devices.device_fields import MechanicsTraits
from ....twin.devices.twin_traits import FilmTraits, TwinTraits
from ....twin.recordings.twin_recordings import simulate_recordings, simulate_runs
from ...sessions.twin_sessions import write_sessions
from ...tags.markers import write_markers
from ..experiments.experiment import Experiment, SessionPlan
from ..results.result_files import compute_once, keep, load_kept
from .unit_errors import measure_unit

#: Traits of the twin (docs/twin.md) that are disabled together, by the name of the cause.
CAUSES = {
    "noise of the read-out": ("noise", "quantisation", "contact"),
    "hysteresis and softening of the cords": ("relaxation", "hysteresis", "mullins"),
    "drift, temperature, ageing": ("drift", "temperature", "ageing"),
    "placement and spread of the cords": ("placement", "spread", "prestretch", "compression"),
    "clocks": ("sync",),
    "cameras": ("marker-noise", "gaps"),
}
MIN_SEEN_SHARE = 0.1  # of the frames: markers that are seen less are left out
TEST_VERSION = 3  # raised when a test computes other values from the same session
#: Mechanics of the twin in a quick run.
QUICK_MECHANICS = MechanicsTraits(edge=1.0, states=8, max_states=40, accuracy=0.2)


def place_tags(experiment: Experiment, device: Device, out: Path, progress: Progress) -> Markers:
    """Place the tags that all layouts carry on a built device, and write them to `out/markers`.

    Raises:
        CaptureError: The tags do not fit on the device.
    """
    plan, folder = experiment.session, out / "markers"
    side = None if plan.side is None else list(plan.side)
    layout_id = layout_hash(load_layout(build_folder(device)))
    key = digest(layout_id, (plan.tags, plan.tag_size, side))
    if load_kept(folder / "placed.json", key) is None or not (folder / MARKERS).is_file():
        write_markers(
            device,
            folder,
            count=plan.tags,
            size=plan.tag_size,
            skin=True,
            side=None if side is None else np.array(side),
            progress=progress,
        )
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
    experiment: Experiment, device: Device, markers: Markers, unit: int, progress: Progress
) -> dict[str, Any]:
    """Record, train and test a unit, or load the results if they were computed before.

    Args:
        experiment: The experiment.
        device: The built device.
        markers: The tags on it.
        unit: Number of the unit.
        progress: Called with the progress.

    Returns:
        The results of `measure_unit`, the quality of the twin, and the markers left out.

    Raises:
        DefsenseError: The unit cannot be recorded or trained on.
    """
    traits, plan = twin_traits(experiment, device), experiment.session
    key = _unit_key(experiment, device, markers, unit)
    session, model = unit_session(device, unit), unit_model(device, unit)
    twin = compute_once(
        session.with_suffix(".session.json"),
        key,
        lambda: _record(session, device, markers, plan, traits, unit, progress),
    )

    def train_and_test() -> dict[str, Any]:
        rare = _find_rare_markers(session)
        options = TrainingOptions(test_share=plan.share)
        trained = train_files(
            DataFiles((session,)),
            device,
            options,
            out=model,
            excluded_markers=rare,
            is_synchronized=True,
            progress=progress,
        )
        progress("test", 0.0, "errors and their causes")
        errors = measure_unit(device, session, model, trained.training)
        progress("test", 1.0, "done")
        return {**errors, "unit": unit, "twin": twin, "left_out": rare}

    path, test_key = session.with_suffix(".test.json"), digest(key, TEST_VERSION)
    result: dict[str, Any] = compute_once(path, test_key, train_and_test)
    return result


def unit_session(device: Device, unit: int) -> Path:
    """Return the folder of a unit's session."""
    return device.source / f"unit-{unit}"


def unit_model(device: Device, unit: int) -> Path:
    """Return the file of the model that is trained on a unit."""
    return device.source / f"unit-{unit}.json"


def _record(
    session: Path,
    device: Device,
    markers: Markers,
    plan: SessionPlan,
    traits: TwinTraits,
    unit: int,
    progress: Progress,
) -> dict[str, Any]:
    """Write the session of a unit; return the quality of the twin."""
    with storage_errors(session):
        if session.exists():  # made from other inputs, or interrupted before it was processed
            shutil.rmtree(session)
    runs = simulate_runs(
        device,
        seconds=plan.seconds,
        seed=unit,
        unit=unit,
        traits=traits,
        markers=markers,
        progress=progress,
    )
    write_sessions(session, device, runs, progress)
    return {
        "states": len(runs.fields.space.states),
        "interpolation_mm": runs.fields.error,
        "interpolation_signal": runs.fields.signal_error,
        "warnings": list(runs.fields.warnings),
    }


def _unit_key(experiment: Experiment, device: Device, markers: Markers, unit: int) -> str:
    """Return a hash of all inputs of a unit's session and test."""
    folder, plan = build_folder(device), experiment.session
    session = (plan.frames, plan.rate, plan.cameras, plan.share, unit)
    tags = (markers.size, markers.ids.tolist(), markers.centers.tolist(), markers.axes.tolist())
    return digest(
        folder / LAYOUT,
        folder / RECORD,
        repr(device.material),
        repr(device.poses),
        device.converter,
        session,
        tags,
        repr(twin_traits(experiment, device)),
    )


def _find_rare_markers(session: Path) -> list[int]:
    """Return the numbers of markers that the cameras hardly see."""
    tracks = read_tracks(session / ALIGNED)
    shares = tracks.visible.mean(axis=0)
    return [int(n) for n, s in zip(tracks.ids, shares, strict=True) if s < MIN_SEEN_SHARE]


def find_error_causes(
    experiment: Experiment, device: Device, markers: Markers, progress: Progress
) -> dict[str, Any]:
    """Find the causes of the error of the first unit, or load them (see `simulate_causes`)."""
    key = digest(_unit_key(experiment, device, markers, 1), repr(CAUSES))
    causes: dict[str, Any] = compute_once(
        device.source / "unit-1.causes.json",
        key,
        lambda: simulate_causes(experiment, device, markers, 1, progress),
    )
    return causes


def simulate_causes(
    experiment: Experiment, device: Device, markers: Markers, unit: int, progress: Progress
) -> dict[str, Any]:
    """Simulate a unit without one cause of errors after another.

    Markers are measured with noise, without rendered images.

    Args:
        experiment: The experiment.
        device: The built device.
        markers: The tags on it.
        unit: Number of the unit.
        progress: Called with the progress.

    Returns:
        RMSE of the chosen decoder, mm: `all`, `without` each cause, and `without_all`.

    Raises:
        DefsenseError: A session cannot be trained on.
    """
    plan = experiment.session
    traits = replace(twin_traits(experiment, device), film=None)
    traits = replace(traits, markers=replace(traits.markers, rate=plan.rate))
    options = TrainingOptions(test_share=plan.share)

    def measure_error(off: tuple[str, ...]) -> float:
        data = simulate_recordings(
            device,
            seconds=plan.seconds,
            seed=unit,
            unit=unit,
            off=off,
            traits=traits,
            markers=markers,
        )
        prior = simulated_prior(device, data.channels, data.rest_points)
        training = train(data, options, silent, prior)
        test = next(a.test for a in training.candidates if a.name == training.selected)
        assert test is not None
        return test.rmse

    without = {}
    progress("causes", 0.0, "all")
    all_causes = measure_error(())
    for k, (cause, off) in enumerate(CAUSES.items()):
        progress("causes", (k + 1) / (len(CAUSES) + 2), f"without {cause}")
        without[cause] = measure_error(off)
    progress("causes", 1 - 1 / (len(CAUSES) + 2), "without any")
    no_cause = measure_error(tuple(name for off in CAUSES.values() for name in off))
    progress("causes", 1.0, "done")
    return {"all": all_causes, "without": without, "without_all": no_cause}
