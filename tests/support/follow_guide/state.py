"""The state of the assembly while a guide is followed."""

from __future__ import annotations

from typing import Any

import numpy as np

from .workpiece import STEP_MM, Cord, cords_of


class State:
    """Records the finished actions and their consequences.

    Attributes:
        cords: Cords by name.
        complaints: Actions that were impossible, with the numbers of their steps.
        refused: Kind of the action of each complaint; "finish" is the final check.
    """

    def __init__(
        self,
        manifest: dict[str, Any],
        layout: dict[str, Any],
        parts: dict[str, Any],
        ferrule: float,
        max_strain: float,
    ) -> None:
        """Start with loose parts.

        Args:
            manifest: The manifest of the parts.
            layout: The layout.
            parts: Triangles (m, 3, 3) of the parts by name.
            ferrule: Length of a ferrule, mm.
            max_strain: Largest strain of a cord.
        """
        self._joints = [tuple(set(side) for side in s["join"]) for s in manifest["assembly"]]
        self._laid_in = [set(s["cords"]) for s in manifest["assembly"]]
        self._pins = [bool(s["pins"]) for s in manifest["assembly"]]
        self.cords = cords_of(manifest, layout, parts)
        self._piece = {name: k for k, name in enumerate(parts)}
        self._cast_parts = manifest.get("casting") is not None
        self._bonded = manifest["assembly_of_cords"] == "bonded"
        self._ferrule, self._max_strain = ferrule, max_strain
        self._done: set[tuple[Any, ...]] = set()
        self._number, self._time = 0, 0
        self._tried_at: dict[int, int] = {}
        self._closed_at: dict[int, int] = {}
        self._kind = ""
        self.complaints: list[str] = []
        self.refused: list[str] = []

    def _complain(self, text: str) -> None:
        self.complaints.append(f"step {self._number}: {text}")
        self.refused.append(self._kind)

    def _check(self, holds: Any, text: str) -> None:
        if not holds:
            self._complain(text)

    def _covered(self, line: Any) -> Any:
        return np.array(
            [
                a is not None and b is not None and self._piece[a] == self._piece[b]
                for a, b in line.pairs
            ]
        )

    def _joined(self, j: int) -> dict[str, int]:
        """Return the piece that each part belongs to once joint j is closed."""
        names = self._joints[j][0] | self._joints[j][1]
        old = {self._piece[n] for n in names}
        return {n: min(old) if k in old else k for n, k in self._piece.items()}

    def _is_in_joint(self, c: Cord) -> bool:
        """Return whether a cord is in the groove of some joint, and not only threaded."""
        return bool(c.line.inserted.any()) and any(c.name in names for names in self._laid_in)

    def _enclosed(self, cord: Cord, end: int) -> bool:
        """Return whether an end is in a closed joint, and not pulled out."""
        k = -1 if end else 0
        return bool(cord.line.inserted[k] and self._covered(cord.line)[k] and not cord.out[end])

    def _whole(self, cord: Cord) -> bool:
        """Return whether all of a cord is at its final place."""
        pieces = {self._piece[n] for pair in cord.line.pairs for n in pair if n}
        return bool(
            cord.line.inserted.all() and self._covered(cord.line).all() and len(pieces) == 1
        )

    def _spanning(self, c: Cord) -> Any:
        """Return the places that are not in a groove yet, because they cross an open joint.

        A cord that passes through a slanted joint crosses it within twice the width of its channel,
        and is inserted on both sides.
        """
        out = np.zeros(len(c.line.pairs), bool)
        longest = int(2 * c.record["channel_diameter"] / STEP_MM)
        for j, (low, high) in enumerate(self._joints):
            if ("glued", j) in self._done or c.name in self._laid_in[j]:
                continue
            across = np.flatnonzero(c.line.between(low, high) & ~c.line.inserted)
            for run in np.split(across, np.flatnonzero(np.diff(across) > 1) + 1):
                if not 0 < len(run) <= longest or run[0] == 0 or run[-1] + 1 == len(out):
                    continue
                out[run] = c.line.inserted[run[0] - 1] and c.line.inserted[run[-1] + 1]
        return out

    def _anchored(self, c: Cord, end: int) -> bool:
        """Return whether an end cannot slide out of its place."""
        if c.end(end)["joint"] == "free":
            return c.end_set[end]
        return bool(c.crimped[end] and c.line.inserted[-1 if end else 0])

    def _inner(self, j: int) -> list[int]:
        """Return the joints inside one side of a joint."""
        return [
            i
            for i, (a, b) in enumerate(self._joints)
            if i != j and any(a | b <= side for side in self._joints[j])
        ]

    def _stuck(self, c: Cord, part: slice) -> bool:
        """Return whether set glue holds a bonded cord at some of its places."""
        for i, (low, high) in enumerate(self._joints):
            if ("set", i) in self._done and c.line.between(low, high)[part].any():
                return True
        return False

    def _to_mouth(self, c: Cord, end: int) -> float:
        """Return the length (mm) from the cord's first end to the mouth of the other end."""
        other = c.end(1 - end)
        hidden = other["pocket"] - self._ferrule / 2 if other["joint"] == "pocket" else 0.0
        return float(c.record["channel_length"]) - hidden + float(other["lead"])

    def _in_place(self, c: Cord) -> bool:
        return c.stretched or any(c.let_in) or not c.held
