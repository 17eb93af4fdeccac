"""A read-out board that replays a simulated session of a built device in real time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.progress import Progress, silent
from ..electronics.cords import FAULT_KINDS, SWAP, CordFault, ReplayedCords
from ..electronics.readout_board import ReadoutTwin
from ..options import CordFamilyName, TwinOptions
from .twin_recordings import TwinRuns, simulate_runs


@dataclass(frozen=True)
class WalkingBoard:
    """A device whose simulated session is replayed forwards and backwards.

    Attributes:
        device: The device.
        cords: Its cords, which replay the session.
        runs: The simulated session.
    """

    device: Device
    cords: ReplayedCords
    runs: TwinRuns

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
    replayed = ReplayedCords(runs.dataset.channels, truth.sample_time, truth.ohm, tuple(faults))
    return WalkingBoard(device, replayed, runs)


def parse_faults(channels: Sequence[str], words: Sequence[str]) -> tuple[CordFault, ...]:
    """Parse faults such as `cut=left@20-30` and `swap=left+right@40`.

    Args:
        channels: Names of the channels.
        words: One fault each: kind, channels, and the seconds from which to which it lasts.

    Raises:
        CaptureError: A fault has another form (`fault-invalid`), names channels that do not exist
            (`unknown-channel`), or ends before it starts (`fault-ends-early`).
    """
    return tuple(_parse_fault(channels, word) for word in words)


def _parse_fault(channels: Sequence[str], word: str) -> CordFault:
    where = f"twin:{word}"
    kind, equals, rest = word.partition("=")
    names, at, when = rest.partition("@")
    begin, _, end = when.partition("-")
    affected = [n for n in names.split("+") if n]
    if not equals or not at or kind not in FAULT_KINDS:
        raise CaptureError(
            "is not a valid fault",
            code="fault-invalid",
            where=where,
            action=f"Write {', '.join(FAULT_KINDS)} as in cut=left@20-30",
        )
    unknown = [n for n in affected if n not in channels]
    if unknown or len(affected) != (2 if kind == SWAP else 1):
        raise CaptureError(
            f"does not name {'two channels' if kind == SWAP else 'one channel'} of the device",
            code="unknown-channel",
            where=where,
            action=(
                f"Name {'two' if kind == SWAP else 'one'} of {', '.join(channels)}"
                + (", with + between them" if kind == SWAP else "")
            ),
            channels=tuple(affected),
        )
    try:
        start, stop = float(begin), float(end) if end else float("inf")
    except ValueError:
        raise CaptureError(
            "has no valid start time",
            code="fault-invalid",
            where=where,
            action="Write seconds as in @20-30",
        ) from None
    if not 0 <= start < stop:
        raise CaptureError(
            "ends before it starts",
            code="fault-ends-early",
            where=where,
            action="Write the second of its start, at least 0, and a later one, as in @20-30",
        )
    return CordFault(kind, tuple(channels.index(n) for n in affected), start, stop)
