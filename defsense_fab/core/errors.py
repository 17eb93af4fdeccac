"""The error tree: every message says what is wrong, where, and what to do, in one line."""

from __future__ import annotations


class DefsenseError(Exception):
    """Base of all errors that a user can cause and mend. One that is `of_the_machine` need not come
    again: memory, disk or time did not suffice."""

    of_the_machine = False


class DeviceError(DefsenseError):
    """`device.toml` or something that it names is wrong."""


class BodyError(DefsenseError):
    """A body cannot be loaded or is not a closed solid."""


class MeshingError(DefsenseError):
    """Tetrahedralisation failed or gave an unusable mesh."""


class SolveError(DefsenseError):
    """A pose did not converge."""


class LayoutError(DefsenseError):
    """A cord breaks a constraint: wall, radius of curvature, or clearance."""


class FabricationError(DefsenseError):
    """The parts cannot be made from this layout."""


class CalibrationError(DefsenseError):
    """Measurements of a cord, or a response made of them, cannot be used."""


class CaptureError(DefsenseError):
    """A port or a recording cannot be read."""


class TrainingError(DefsenseError):
    """Recordings cannot be trained on, or a trained model cannot be used."""


class LiveError(DefsenseError):
    """A device cannot run live with this model, port or output."""


class ControlError(DefsenseError):
    """A control, or an expression that it is made of, cannot be used."""


class OutputError(DefsenseError):
    """An output of the live loop cannot be opened, or was told something wrong."""


class ExperimentError(DefsenseError):
    """An experiment cannot be found or run."""


class StudyError(DefsenseError):
    """A study of many runs cannot be made as it is asked for, or its files are not its own."""


class StorageError(DefsenseError):
    """Files cannot be read or written."""

    of_the_machine = True


class CapacityError(DefsenseError):
    """The machine's memory does not suffice for what was asked."""

    of_the_machine = True
