"""A read-out board that replays a simulated session of a built device in real time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.progress import Progress, silent
from ..electronics.cords import CordFault
from ..electronics.readout_board import ReadoutTwin
from ..options import CordFamilyName, TwinOptions
from .bent_cords import BentCords
from .twin_recordings import TwinRuns, simulate_runs


@dataclass(frozen=True)
class WalkingBoard:
    """A device whose simulated session is replayed forwards and backwards.

    Attributes:
        device: The device.
        cords: Its cords, which replay the session or are bent by a person.
        runs: The simulated session.
    """

    device: Device
    cords: BentCords
    runs: TwinRuns

    def shape_of(self, points: Float) -> Callable[[], Float]:
        """Return a function that returns where points (p, 3) of the body at rest are now, mm."""
        fields, cords = self.runs.fields, self.cords
        moves = fields.displacements(points)

        def shape() -> Float:
            return points + np.tensordot(fields.space(cords.levels[None])[0], moves, axes=1)

        return shape

    def open(self) -> ReadoutTwin:
        """Switch the read-out board on: the session starts, with a rest."""
        b = self.runs.traits.board
        return ReadoutTwin(
            self.cords,
            self.runs.converter.reference,
            offset=b.offset,
            drift=b.drift,
            converter=self.device.converter,
        )


def simulate_walking_board(
    device: Device,
    *,
    unit: int = 1,
    cords: CordFamilyName | None = TwinOptions.cords,
    seed: int = 101,
    seconds: float = 300.0,
    faults: Sequence[CordFault] = (),
    off: Sequence[str] = (),
    progress: Progress = silent,
) -> WalkingBoard:
    """Simulate a session of a built device for replay.

    The first call solves the displacement fields of the device, which takes minutes.

    Args:
        device: The device.
        unit: Number of the built device (see `build_unit`).
        cords: Family of the cords' memory; None for the default of the device.
        seed: Seed of the hand's motion.
        seconds: Duration of the session, s.
        faults: Faults of cords and plugs.
        off: Names of traits to disable.
        progress: Called with the progress.

    Raises:
        CaptureError: The device is not built, or there is no such trait.
    """
    options = TwinOptions(seed=seed, unit=unit, cords=cords, off=tuple(off))
    runs = simulate_runs(device, options, seconds=seconds, progress=progress)
    truth = runs.runs[0].truth
    bent = BentCords(
        runs.dataset.channels,
        truth,
        tuple(pose.name for pose in device.poses),
        lambda levels: runs.built.signals(runs.fields.space(levels)),
        replace(runs.built.pieces, age=runs.traits.age),
        tuple(faults),
    )
    return WalkingBoard(device, bent, runs)
