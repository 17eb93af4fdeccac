"""Design, fabrication and use of soft objects that sense their own deformation.

This is the Python interface (docs/python.md). Each name is imported when it is first used.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from .core.version import __version__ as __version__

if TYPE_CHECKING:
    from .core.errors import DefsenseError as DefsenseError
    from .core.mesh import Surface as Surface
    from .core.prediction import Prediction as Prediction
    from .runtime.frames.live_frame import LiveFrame as LiveFrame
    from .training.data.dataset import Dataset as Dataset
    from .training.data.dataset import Recording as Recording
    from .workflow.calibrate.fit_response import FittedResponse as FittedResponse
    from .workflow.device import Device as Device
    from .workflow.experiments import fit_response as fit_response
    from .workflow.experiments import load_experiment as load_experiment
    from .workflow.experiments import record_specimen_twin as record_specimen_twin
    from .workflow.experiments import reproduce as reproduce
    from .workflow.layout import Layout as Layout
    from .workflow.layout import Parts as Parts
    from .workflow.layout import fabricate as fabricate
    from .workflow.layout import optimize as optimize
    from .workflow.layout import predict as predict
    from .workflow.live_session import Live as Live
    from .workflow.live_session import live as live
    from .workflow.model import Model as Model
    from .workflow.model import MovingSurface as MovingSurface
    from .workflow.model import train as train
    from .workflow.poses import Drag as Drag
    from .workflow.poses import DrawnCord as DrawnCord
    from .workflow.poses import Handle as Handle
    from .workflow.poses import Pose as Pose
    from .workflow.poses import Pressure as Pressure
    from .workflow.poses import Symmetry as Symmetry
    from .workflow.poses import box as box
    from .workflow.poses import cylinder as cylinder
    from .workflow.poses import half_space as half_space
    from .workflow.poses import sphere as sphere
    from .workflow.recordings import dataset as dataset
    from .workflow.recordings import load_sessions as load_sessions
    from .workflow.recordings import record_twin as record_twin
    from .workflow.reproduce.experiments.experiment import Experiment as Experiment
    from .workflow.simulation import Picture as Picture
    from .workflow.simulation import Simulation as Simulation
    from .workflow.simulation import simulate as simulate

_MODULES = {
    "core.errors": ("DefsenseError",),
    "core.mesh": ("Surface",),
    "core.prediction": ("Prediction",),
    "runtime.frames.live_frame": ("LiveFrame",),
    "training.data.dataset": ("Dataset", "Recording"),
    "workflow.calibrate.fit_response": ("FittedResponse",),
    "workflow.device": ("Device",),
    "workflow.experiments": (
        "fit_response",
        "load_experiment",
        "record_specimen_twin",
        "reproduce",
    ),
    "workflow.layout": ("Layout", "Parts", "fabricate", "optimize", "predict"),
    "workflow.live_session": ("Live", "live"),
    "workflow.model": ("Model", "MovingSurface", "train"),
    "workflow.poses": (
        "Drag",
        "DrawnCord",
        "Handle",
        "Pose",
        "Pressure",
        "Symmetry",
        "box",
        "cylinder",
        "half_space",
        "sphere",
    ),
    "workflow.recordings": ("dataset", "load_sessions", "record_twin"),
    "workflow.reproduce.experiments.experiment": ("Experiment",),
    "workflow.simulation": ("Picture", "Simulation", "simulate"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


class _Interface(ModuleType):
    """The package; a subpackage does not replace a function of the same name.

    Python assigns each imported subpackage to an attribute of its package, so that `optimize` would
    become the subpackage `optimize`.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _MODULE_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Interface


if not TYPE_CHECKING:  # type checkers must only see the names above

    def __getattr__(name: str) -> object:
        """Return a name of the interface, importing its module now."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULE_OF])
