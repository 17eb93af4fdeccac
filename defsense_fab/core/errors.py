"""Errors that a user can cause and fix.

Each error carries a stable `code`. Programs and tests branch on the code and the data; the message
is for people and may change.
"""

from __future__ import annotations


class DefsenseError(Exception):
    """Base class for errors that the user can cause and fix.

    The text of an error reads `<where>: <problem>. <Action>.`

    Args:
        problem: What is wrong, with the offending value; no final full stop.
        code: Stable identifier of this kind of problem, in lower-case words joined by hyphens, such
            as `"port-busy"`. Codes are unique per kind of problem, not per place in the code.
        where: The file (with its line), argument, field or name that is wrong.
        action: One thing that the user can do about it, as an imperative sentence.
        data: Facts about the problem for programs, such as `channel="left"`.

    Attributes:
        is_machine_limit: True for errors caused by the machine (memory, disk, time), which need
            not occur again with the same input.
    """

    is_machine_limit = False

    def __init__(
        self,
        problem: str,
        *,
        code: str,
        where: object = "",
        action: str = "",
        **data: object,
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.code = code
        self.where = str(where)
        self.action = action
        self.data = data

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.problem, dict(vars(self)))

    def __str__(self) -> str:
        text = f"{self.where}: {self.problem}" if self.where else self.problem
        if not self.action:
            return text
        end = "" if self.action.endswith("?") else "."
        return f"{text.rstrip('.')}. {self.action.rstrip('.')}{end}"


def _rebuild(kind: type[DefsenseError], problem: str, state: dict[str, object]) -> DefsenseError:
    """Recreate an error that was pickled, as errors of worker processes are."""
    error = kind.__new__(kind, problem)
    error.args = (problem,)
    vars(error).update(state)
    return error


class DeviceError(DefsenseError):
    """`device.toml`, or a file that it names, is invalid."""


class BodyError(DefsenseError):
    """A body cannot be loaded or is not a closed solid."""


class MeshingError(DefsenseError):
    """Tetrahedralisation failed or produced an unusable mesh."""


class SolveError(DefsenseError):
    """A pose did not converge."""


class LayoutError(DefsenseError):
    """A cord violates a constraint: wall thickness, radius of curvature or clearance."""


class FabricationError(DefsenseError):
    """Parts cannot be made from this layout."""


class CalibrationError(DefsenseError):
    """Measurements of a cord, or a response fitted to them, are unusable."""


class CaptureError(DefsenseError):
    """A port, camera or recording cannot be read."""


class TrainingError(DefsenseError):
    """Recordings cannot be used for training, or a trained model cannot be used."""


class LiveError(DefsenseError):
    """A device cannot run live with this model, port or output."""


class ControlError(DefsenseError):
    """A control, or the expression that defines it, is invalid."""


class OutputError(DefsenseError):
    """An output of the live loop cannot be opened, or is misconfigured."""


class ExperimentError(DefsenseError):
    """An experiment cannot be found or run."""


class StudyError(DefsenseError):
    """A parameter study is invalid, or its files belong to another study."""


class StorageError(DefsenseError):
    """Files cannot be read or written."""

    is_machine_limit = True


class CapacityError(DefsenseError):
    """The machine has too little memory for the request."""

    is_machine_limit = True
