"""A built device that a hand moves, read by its read-out board as fast as time goes: what
`defsense twin` writes as sessions, alive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.progress import Progress, silent
from ..electronics.readout_board import ReadoutTwin
from ..electronics.replayed_cords import FAULT_KINDS, SWAP, CordFault, ReplayedCords
from .twin_recordings import TwinRuns, simulate_runs


@dataclass(frozen=True)
class WalkingBoard:
    """A device's cords, and what was simulated: the run that is played forth and back."""

    device: Device
    cords: ReplayedCords
    made: TwinRuns

    def open(self) -> ReadoutTwin:
        """Its read-out board, switched on now: the run begins, with a rest."""
        b = self.made.traits.board
        return ReadoutTwin(
            self.cords, self.made.converter.reference, offset=b.offset, drift=b.drift,
            converter=self.device.converter,
        )  # fmt: skip


def simulate_walking_board(
    device: Device, *, unit: int = 1, seed: int = 101, seconds: float = 300.0,
    faults: Sequence[CordFault] = (), off: Sequence[str] = (), progress: Progress = silent,
) -> WalkingBoard:  # fmt: skip
    """Of the built device of the number `unit`, moved by the hand of this `seed`. The device's
    shapes are solved the first time, which takes minutes. Raises CaptureError."""
    made = simulate_runs(device, seconds=seconds, seed=seed, unit=unit, off=off, progress=progress)
    truth = made.runs[0].truth
    cords = ReplayedCords(made.dataset.channels, truth.sample_time, truth.ohm, tuple(faults))
    return WalkingBoard(device, cords, made)


def parse_faults(channels: Sequence[str], words: Sequence[str]) -> tuple[CordFault, ...]:
    """Of cut=left@20-30, swap=left+right@40, ...: what, which, from and to which second. Raises
    CaptureError."""
    out = []
    for word in words:
        kind, equals, rest = word.partition("=")
        names, at, when = rest.partition("@")
        begin, _, end = when.partition("-")
        which = [n for n in names.split("+") if n]
        if not equals or not at or kind not in FAULT_KINDS:
            raise CaptureError(f"twin:{word}: write {', '.join(FAULT_KINDS)} as in cut=left@20-30")
        unknown = [n for n in which if n not in channels]
        if unknown or len(which) != (2 if kind == SWAP else 1):
            raise CaptureError(
                f"twin:{word}: name {'two channels' if kind == SWAP else 'a channel'} of"
                f" {', '.join(channels)}" + (" with + between" if kind == SWAP else "")
            )
        try:
            span = float(begin), float(end) if end else float("inf")
        except ValueError:
            raise CaptureError(f"twin:{word}: write seconds, as in @20-30") from None
        if not 0 <= span[0] < span[1]:
            raise CaptureError(
                f"twin:{word}: ends before it begins; write the second at which it begins, from 0"
                " on, and a later one at which it ends, as in @20-30"
            )
        out.append(CordFault(kind, tuple(channels.index(n) for n in which), *span))
    return tuple(out)
