"""Predict the errors of built devices, before and after training on cords with a memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...sensing.built_cord import BuiltCord
from ...sensing.memory_residual import (
    AFFINE,
    TRAINED,
    known_family,
    memory_residuals,
)
from ...store.layout import BandRecord, ErrorRange
from ..studies.tolerance_monte_carlo import (
    SampledDevice,
    ToleranceBand,
    measure_devices,
    sample_devices,
)
from .design_task import SEED, DesignTask, device_tolerances

_AFFINE_DECODER = "affine"


def tolerance_band(device: Device, task: DesignTask, cords: Sequence[BuiltCord]) -> ToleranceBand:
    """Predict the errors of built devices on unseen states, without the memory of the cords.

    Args:
        device: The device.
        task: Its design task.
        cords: The cords as built in.
    """
    return ToleranceBand.of(
        measure_devices(_sample(device, task, cords, None), task.everything.decoder, task.unseen)
    )


def predict_built_devices(
    device: Device, task: DesignTask, cords: Sequence[BuiltCord], shares: Float | None = None
) -> BandRecord:
    """Predict the errors of built devices: by tolerances alone, and after training.

    Devices with each kind of memory are equally many. If the cord's kind is known, the median is
    that of its devices; the range contains 90 % of all of them.

    Args:
        device: The device.
        task: Its design task.
        cords: The cords as built in.
        shares: How often the session of the training shows each state (n,), rest included; None if
            it shows the unseen states alone.
    """
    name, unseen = device.cord.name, replace(task.unseen, shares=shares)
    decoder, sampled = task.everything.decoder, _sample(device, task, cords, shares)
    trained = {
        r.family: measure_devices(sampled, decoder, unseen, r)
        for r in memory_residuals(name, TRAINED, len(cords))
    }
    affine = [
        measure_devices(sampled, _AFFINE_DECODER, unseen, r)
        for r in memory_residuals(name, AFFINE, len(cords))
    ]
    family, everything = known_family(name), _range(list(trained.values()))
    if family:
        everything = replace(everything, median=_range([trained[family]]).median)
    return BandRecord(
        **asdict(tolerance_band(device, task, cords)),
        trained=everything,
        families={family: _range([errors]) for family, errors in trained.items()},
        affine=_range(affine),
        **asdict(device_tolerances(device)),
        family=family,
        without_memory=ToleranceBand.of(measure_devices(sampled, decoder, unseen)).median,
    )


def _range(errors: Sequence[Float]) -> ErrorRange:
    return ErrorRange(**asdict(ToleranceBand.of(np.concatenate(errors))))


def _sample(
    device: Device, task: DesignTask, cords: Sequence[BuiltCord], shares: Float | None
) -> list[SampledDevice]:
    return sample_devices(
        task.everything,
        cords,
        task.reading,
        np.random.default_rng(SEED),
        replace(task.unseen, shares=shares),
        tolerances=device_tolerances(device),
    )
