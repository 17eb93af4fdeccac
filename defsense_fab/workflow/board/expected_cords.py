"""What a device's build expects of its wired cords: resistances at rest and changes in poses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...capture.board_check.records import Change, ExpectedCord
from ...core.arrays import Float
from ...core.device.device import Device
from ...optimization.studies.tolerance_monte_carlo import Tolerances, sample_built_cord
from ...report.guide.plan import BATCH_TOLERANCE, INSTALLED_TOLERANCE, TRACE_TOLERANCE
from ...sensing.built_cord import CordReading
from ...store.build import Build

#: Tolerance of a reference resistor that was not measured, relative (E24).
_RESISTOR_TOLERANCE = 0.05
_DRAWS, _DRAW_SEED = 24, 5  # of built cords per cord, for the scatter of their signals
#: Share of a signal that the memory of a cord adds or lacks after some seconds in a pose: the
#: larger one of the relaxing shares that `twin/electronics` assumes for cords.
_MEMORY_SHARE = 0.16
#: Share of a cord's largest signal that earlier motion leaves in any pose (play and relaxation).
_REMANENCE_SHARE = 0.05
#: Smallest deviation of a change, (R - R0)/R0: drift and joints within half a minute.
_CHANGE_FLOOR = 0.004


def expected_cords(device: Device, build: Build) -> list[ExpectedCord]:
    """Return what the build expects of each cord, in the order of the channels.

    Args:
        device: The device.
        build: Its build, until the stage fabricate.

    Raises:
        StorageError: A file of the build is missing or damaged.
    """
    cut = {c.sensor: c for c in build.manifest.cords}
    batch = BATCH_TOLERANCE if device.cord.trace is None else TRACE_TOLERANCE
    factor = (1 + batch) * (1 + INSTALLED_TOLERANCE) * (1 + _RESISTOR_TOLERANCE)
    changes = _pose_changes(device, build)
    out = []
    for record in build.layout.by_channel():
        ohm = cut[record.name].resistance
        out.append(
            ExpectedCord(
                name=record.name,
                ohm=ohm,
                low=ohm / factor,
                high=ohm * factor,
                noise=device.cord.noise,
                contact=device.cord.contact,
                changes=changes[record.name],
            )
        )
    return out


def _pose_changes(device: Device, build: Build) -> dict[str, Mapping[str, Change]]:
    """Return the changes by cord and pose, for poses that were simulated to their full extent."""
    states = build.fields
    full = {
        pose.name: k
        for pose in device.poses
        for k, weights in enumerate(states.weights)
        if dict(weights) == {pose.name: 1.0}
    }
    rows = list(full.values())
    reading, rng = CordReading.from_device(device), np.random.default_rng(_DRAW_SEED)
    tolerances, locator = Tolerances(), build.locator
    out: dict[str, Mapping[str, Change]] = {}
    for record in build.layout.by_channel():
        draws = []
        for _ in range(_DRAWS):
            cord, own = sample_built_cord(record.built, reading, rng, tolerances)
            moved = locator.displacement(locator.find(cord.path), states.displacements[rows])
            draws.append(own.signals(cord, cord.path + moved))
        signals: Float = np.array(draws)
        mean = signals.mean(axis=0)
        memory = (_MEMORY_SHARE * mean) ** 2 + (_REMANENCE_SHARE * np.abs(mean).max()) ** 2
        deviation = np.sqrt(signals.var(axis=0) + memory + _CHANGE_FLOOR**2)
        out[record.name] = {
            name: Change(float(m), float(d))
            for name, m, d in zip(full, mean, deviation, strict=True)
        }
    return out
