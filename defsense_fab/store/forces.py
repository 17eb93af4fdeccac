"""The forces that hold a device in its poses, in `forces.json`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..core.arrays import Float
from ..core.device.build_folder import BUILD_AGAIN
from ..core.storage import typed_json
from .hand_strength import FINGERS, HAND, Effort, judge_effort

FORCES = "forces.json"
_N_MM_PER_N_M = 1000.0
_EFFORTS: tuple[Effort, ...] = ("fingers", "hand", "beyond")
_EFFORT_WORDS = {
    "fingers": "",
    "hand": ", with a whole hand",
    "beyond": ", more than one hand can do",
}


@dataclass(frozen=True)
class HeldRecord:
    """The force at one place of a pose, in the rest frame.

    Attributes:
        place: Name of the moved region, or the rest position of a dragged point.
        push: Force along the movement, N: the work per amplitude divided by the root mean square
            distance per amplitude that the region moves. It is negative after a snap-through.
        force: Resultant force (3,) on the body, N; zero where the translation is free.
        moment: Resultant moment (3,) about the region's center, N mm.
    """

    place: str
    push: float
    force: Float
    moment: Float

    @property
    def torque(self) -> float:
        """Size of the moment, N mm."""
        return float((self.moment**2).sum() ** 0.5)

    @property
    def resultant(self) -> float:
        """Size of the resultant force, N."""
        return float((self.force**2).sum() ** 0.5)

    @property
    def effort(self) -> Effort:
        """What a hand needs to hold the place."""
        return judge_effort(abs(self.push), self.resultant, self.torque)

    @property
    def need(self) -> str:
        """The force or torque that counts for the effort, as in "2.8 N m"."""
        push, turn = abs(self.push) / FINGERS.force, self.torque / FINGERS.torque
        if self.resultant / FINGERS.force >= min(push, turn):
            return f"{_short(self.resultant)} N"
        if push <= turn:
            return f"{_short(abs(self.push))} N"
        return f"{_short(self.torque / _N_MM_PER_N_M)} N m"

    def describe(self) -> str:
        """Return force and torque, as in "1.3 N at 'tip', 0.10 N m".

        Where it is easier to turn the place than to push it, only the torque is stated.
        """
        torque = f"{_short(self.torque / _N_MM_PER_N_M)} N m"
        if self.need == torque:
            return f"{torque} at {self.place!r}"
        return f"{_short(abs(self.push))} N at {self.place!r}{f', {torque}' if self.torque else ''}"


@dataclass(frozen=True)
class PoseForces:
    """The forces that hold a device in a pose, with its printed traces, if any.

    Attributes:
        pose: Name of the pose.
        state: The state of the pose's ramp with the largest force, as in "bend@1".
        power: Work per amplitude in this state, N mm: the derivative of the stored energy.
        held: The forces at everything that the pose moves; empty for pressures and gravity.
    """

    pose: str
    state: str
    power: float
    held: tuple[HeldRecord, ...]

    @property
    def push(self) -> float:
        """Largest force along a movement, N; 0 without one."""
        return max((abs(h.push) for h in self.held), default=0.0)

    def describe(self) -> str:
        """Return a line, as in "bend: 1.3 N at 'tip', 0.10 N m"."""
        if not self.held:
            return f"{self.pose}: pressure or gravity only, no region is moved"
        at = f" (at {self.state})" if not self.state.endswith("@1") else ""
        return f"{self.pose}: {self._hardest.describe()}{_EFFORT_WORDS[self.effort]}{at}"

    @property
    def effort(self) -> Effort:
        """What a hand needs to hold the place that is hardest to hold."""
        return self._hardest.effort if self.held else "fingers"

    @property
    def warning(self) -> str:
        """What is too hard for fingers or for a hand, and what would help; empty if nothing is."""
        return "".join(_warn_of_efforts((self,)))

    @property
    def need(self) -> str:
        """The force or torque that is hardest to apply, as in "2.8 N m"; empty without one."""
        return self._hardest.need if self.held else ""

    @property
    def _hardest(self) -> HeldRecord:
        return max(self.held, key=lambda h: (_EFFORTS.index(h.effort), abs(h.push)))


def _warn_of_efforts(poses: Sequence[PoseForces]) -> tuple[str, ...]:
    """Return a warning about poses that one hand cannot hold, and one about those for a hand."""
    warnings = []
    for effort, limit, user, remark in (
        ("beyond", HAND, "one hand", ""),
        ("hand", FINGERS, "fingers", "; a whole hand can"),
    ):
        names = [f"{p.pose} ({p.need})" for p in poses if p.effort == effort]
        if names:
            warnings.append(
                f"{', '.join(names)}: more than {user} can do ({limit.force:g} N or"
                f" {limit.torque / _N_MM_PER_N_M:g} N m){remark}. A softer material, a thinner body"
                " or a smaller movement needs less"
            )
    return tuple(warnings)


def _short(value: float) -> str:
    """Return a number with two significant digits, as in 0.077 and 440."""
    return f"{float(f'{value:.2g}'):g}"


@dataclass(frozen=True)
class ForcesRecord:
    """The content of `forces.json`.

    Attributes:
        poses: The forces of each pose, in the order of the device.
        traces: Factor by which printed traces increase the work of the pose where they do most; 1
            without traces.
    """

    SCHEMA: ClassVar[int] = 1

    poses: tuple[PoseForces, ...]
    traces: float = 1.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about poses that fingers, or one hand, cannot hold."""
        return _warn_of_efforts(self.poses)

    @property
    def largest(self) -> float:
        """Largest force along a movement over all poses, N."""
        return max((p.push for p in self.poses), default=0.0)

    @property
    def largest_torque(self) -> float:
        """Largest moment on a moved region over all poses, N mm."""
        return max((h.torque for p in self.poses for h in p.held), default=0.0)


def save_forces(folder: Path, record: ForcesRecord) -> None:
    """Write `forces.json` into a build's folder. Raises StorageError."""
    typed_json.save(folder / FORCES, record)


def load_forces(folder: Path) -> ForcesRecord:
    """Return the forces of a build. Raises StorageError."""
    return typed_json.load(folder / FORCES, ForcesRecord, BUILD_AGAIN)
