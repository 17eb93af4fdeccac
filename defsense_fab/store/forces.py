"""The forces that hold a device in its poses, in `forces.json`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..core.arrays import Float
from ..core.device.build_folder import BUILD_AGAIN
from ..core.storage import typed_json

FORCES = "forces.json"
_N_MM_PER_N_M = 1000.0


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
        largest = max(self.held, key=lambda h: abs(h.push))
        at = f" (at {self.state})" if not self.state.endswith("@1") else ""
        torque = largest.torque / _N_MM_PER_N_M
        more = f", {_short(torque)} N m" if torque > 0 else ""
        return f"{self.pose}: {_short(abs(largest.push))} N at {largest.place!r}{more}{at}"


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
