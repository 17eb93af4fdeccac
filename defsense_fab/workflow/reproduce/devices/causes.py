"""What a unit's error comes from, told by building it without one cause after another.

The same unit is recorded by the same hand with some of the twin's traits switched off, trained on
and tested anew. That is what no real device allows, and knows no model of the error.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ....core.device.device import Device
from ....core.markers import Markers
from ....core.progress import Progress, silent
from ....core.storage.files import digest
from ....training.fitting.train_model import TrainingOptions, train
from ....training.models.prepare import simulated_prior
from ....twin.recordings.twin_recordings import simulate_recordings
from ..experiments.experiment import Experiment
from ..results.kept import once
from .sessions import traits_of, unit_key

#: Traits of the twin (docs/twin.md) that are switched off together.
CAUSES = {
    "noise of the read-out": ("noise", "quantisation", "contact"),
    "hysteresis and softening of the cords": ("relaxation", "hysteresis", "mullins"),
    "drift, temperature, ageing": ("drift", "temperature", "ageing"),
    "placement and spread of the cords": ("placement", "spread", "prestretch", "compression"),
    "clocks": ("sync",),
    "cameras": ("marker-noise", "gaps"),
}


def kept_causes(
    experiment: Experiment, device: Device, markers: Markers, progress: Progress
) -> dict[str, Any]:
    """What `causes_by_rebuilding` tells of the first unit, now or before."""
    key = digest(unit_key(experiment, device, markers, 1), repr(CAUSES))
    found: dict[str, Any] = once(
        device.source / "unit-1.causes.json", key,
        lambda: causes_by_rebuilding(experiment, device, markers, 1, progress),
    )  # fmt: skip
    return found


def causes_by_rebuilding(
    experiment: Experiment, device: Device, markers: Markers, unit: int, progress: Progress
) -> dict[str, Any]:
    """RMSE (mm) of the decoder that the folds choose, with `all` causes, `without` each, and
    without any (`without_all`): of sessions whose markers are seen by cameras that are numbers
    alone. Raises a DefsenseError where a session cannot be trained on."""
    traits = replace(traits_of(experiment, device), film=None)
    traits = replace(traits, markers=replace(traits.markers, rate=experiment.session.rate))
    options = TrainingOptions(test_share=experiment.session.share)

    def error(off: tuple[str, ...]) -> float:
        data = simulate_recordings(
            device, seconds=experiment.session.seconds, seed=unit, unit=unit, off=off,
            traits=traits, markers=markers,
        )  # fmt: skip
        prior = simulated_prior(device, data.channels, data.rest_points)
        found = train(data, options, silent, prior)
        test = next(a.test for a in found.candidates if a.name == found.selected)
        assert test is not None
        return test.rmse

    without = {}
    progress("causes", 0.0, "all")
    every = error(())
    for k, (cause, off) in enumerate(CAUSES.items()):
        progress("causes", (k + 1) / (len(CAUSES) + 2), f"without {cause}")
        without[cause] = error(off)
    progress("causes", 1 - 1 / (len(CAUSES) + 2), "without any")
    none = error(tuple(name for off in CAUSES.values() for name in off))
    progress("causes", 1.0, "done")
    return {"all": every, "without": without, "without_all": none}
