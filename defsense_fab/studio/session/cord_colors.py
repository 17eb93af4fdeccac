"""Colors of cords; a cord keeps its color while others are added, deleted or renamed."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence

#: Colors of cords, distinct for color-blind people (Okabe & Ito 2008; Tol 2021, "bright").
CORD_COLORS = (
    "#0072b2",
    "#e69f00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#8f6d00",
    "#aa3377",
    "#66ccee",
)


class CordColors:
    """Remembers the color of each cord by its name, also of deleted ones."""

    def __init__(self) -> None:
        self._colors: dict[str, str] = {}
        self._names: tuple[str, ...] = ()
        self._lock = threading.Lock()

    def of(self, names: Sequence[str]) -> dict[str, str]:
        """Return the color of each cord of the device.

        A cord that was deleted gets its color back where it is free; a new cord gets the first
        color that the fewest others have.

        Args:
            names: Names of all cords, in the order of the device.
        """
        with self._lock:
            self._follow_rename(names)
            colors: dict[str, str] = {}
            present = set(self._names)
            for name in sorted(names, key=lambda name: name not in present):  # present ones first
                known = self._colors.get(name)
                used = Counter(colors.values())
                is_kept = known is not None and (name in present or known not in used)
                colors[name] = (
                    known
                    if known is not None and is_kept
                    else min(CORD_COLORS, key=lambda color: used[color])
                )
            self._colors |= colors
            self._names = tuple(names)
            return {name: colors[name] for name in names}

    def _follow_rename(self, names: Sequence[str]) -> None:
        """Pass the color on if one name has changed, and everything else is as it was."""
        if len(names) != len(self._names):
            return
        changed = [(old, new) for old, new in zip(self._names, names, strict=True) if old != new]
        if len(changed) == 1:
            (old, new) = changed[0]
            self._colors[new] = self._colors[old]
            self._names = tuple(names)
