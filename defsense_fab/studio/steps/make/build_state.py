"""Which version of the device the parts of the last build belong to."""

from __future__ import annotations

from dataclasses import dataclass

from ...session.built_cords import BuiltCords


@dataclass(frozen=True)
class BuildState:
    """Which version of the device the parts belong to.

    Attributes:
        is_built: Whether there are parts.
        outdated_stage: Title of the first stage that is outdated, or None if the parts are up to
            date.
        error: Error of the last build, or None.
        changes: Options of the plates that have changed since the build; empty for none.
        options: Options of the command with which up-to-date parts were built; empty for none.
        noun: What one sensor is called.
        cords: The cords of the parts, or None.
        are_cords_drawn: Whether these are the drawn ones.
    """

    is_built: bool
    outdated_stage: str | None = None
    error: str | None = None
    changes: str = ""
    options: str = ""
    noun: str = "cord"
    cords: BuiltCords | None = None
    are_cords_drawn: bool = True

    @property
    def code(self) -> str:
        """Identifier of the state: "not-built", "outdated", "other-options" or "up-to-date"."""
        if not self.is_built:
            return "not-built"
        if self.outdated_stage is not None:
            return "outdated"
        return "other-options" if self.options else "up-to-date"
