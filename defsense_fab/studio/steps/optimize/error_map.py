"""The error of the last build's layout on the surface, by state."""

from __future__ import annotations

import threading

import numpy as np

from ....core.errors import DefsenseError, StorageError
from ....core.mesh import Surface
from ....workflow.build.results import Build, SurfaceErrors, surface_errors
from ....workflow.view import Arrays
from ...messages.optimize import ErrorStates, MappedState
from ...session.body_arrays import surface_arrays

_MIN_RANGE_MM = 1e-6  # of the color scale


class ErrorMap:
    """Computes the errors of a build's layout on the surface when they are first shown.

    Attributes:
        build: The build, or None before the first one is loaded.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.build: Build | None = None
        self._errors: SurfaceErrors | None = None

    def load(self, build: Build) -> ErrorStates:
        """Follow another build, and return the states that can be shown."""
        with self._lock:
            self.build, self._errors = build, None
        try:
            prediction = build.layout.prediction
            present = _present_names(build)
        except (DefsenseError, OSError):
            return ErrorStates(states=[])
        states = [
            MappedState(name=present.get(name, name), expected=error, is_held_out=is_held_out)
            for errors, is_held_out in ((prediction.per_state, False), (prediction.held_out, True))
            for name, error in errors.items()
            if name != "rest"
        ]
        return ErrorStates(states=states)

    def arrays(self, state: str) -> Arrays:
        """Return the surface and its error in a state.

        Raises:
            StorageError: The build has no layout, or the state does not exist.
        """
        errors = self._load_errors()
        if state not in errors.names:
            raise StorageError(
                f"there is no state {state!r} in the last build",
                code="unknown-state",
                action="Choose another state",
            )
        k = errors.names.index(state)
        surface = surface_arrays(Surface(errors.rest, errors.faces))
        return Arrays(
            name="error-map",
            arrays={
                "rest": surface["vertices"],
                "faces": surface["faces"],
                "edges": surface["edges"],
                "moved": (errors.rest + errors.moved[k]).astype(np.float32),
                "error": errors.error[k].astype(np.float32),
            },
            facts={
                "state": state,
                "mean": errors.mean(k),
                "largest": float(errors.error[k].max()),
                "high": max(errors.highest, _MIN_RANGE_MM),
            },
        )

    def _load_errors(self) -> SurfaceErrors:
        with self._lock:
            if self.build is None:
                raise StorageError("no layout is optimized", code="not-optimized")
            if self._errors is None:
                self._errors = surface_errors(self.build)
            return self._errors


def _present_names(build: Build) -> dict[str, str]:
    """Return the names of states, whose poses may be renamed, by those in the layout."""
    former, present = build.prediction.states[1:], build.fields.names
    if len(former) != len(present):
        return {}  # they are states of other poses
    return dict(zip(former, present, strict=True))
