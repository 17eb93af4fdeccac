"""Design, fabrication and use of soft objects that sense their own deformation.

This is the Python interface (docs/python.md). Each name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .core.version import __version__ as __version__

if TYPE_CHECKING:
    from .core.errors import DefsenseError as DefsenseError
    from .core.mesh import Surface as Surface
    from .core.response import ResponseSpec as ResponseSpec
    from .runtime.frames.live_frame import LiveFrame as LiveFrame
    from .store.layout import Prediction as Prediction
    from .training.data.dataset import Dataset as Dataset
    from .training.data.dataset import Recording as Recording
    from .training.evaluation.evaluate_models import SessionEvaluation as SessionEvaluation
    from .workflow.calibrate.fit_response import FittedResponse as FittedResponse
    from .workflow.device import Device as Device
    from .workflow.experiments import fit_response as fit_response
    from .workflow.experiments import load_experiment as load_experiment
    from .workflow.experiments import reproduce as reproduce
    from .workflow.experiments import simulate_specimens as simulate_specimens
    from .workflow.layout import Layout as Layout
    from .workflow.layout import Parts as Parts
    from .workflow.layout import fabricate as fabricate
    from .workflow.layout import optimize as optimize
    from .workflow.layout import predict as predict
    from .workflow.live_session import Live as Live
    from .workflow.live_session import live as live
    from .workflow.model import Model as Model
    from .workflow.model import MovingSurface as MovingSurface
    from .workflow.model import evaluate as evaluate
    from .workflow.model import recalibrate as recalibrate
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
    from .workflow.recordings import export_dataset as export_dataset
    from .workflow.recordings import join as join
    from .workflow.recordings import load_sessions as load_sessions
    from .workflow.recordings import process as process
    from .workflow.recordings import read_tables as read_tables
    from .workflow.recordings import record as record
    from .workflow.recordings import record_twin as record_twin
    from .workflow.reproduce.experiment import Experiment as Experiment
    from .workflow.simulation import Picture as Picture
    from .workflow.simulation import Simulation as Simulation
    from .workflow.simulation import simulate as simulate

_MODULES = {
    "core.errors": ("DefsenseError",),
    "core.mesh": ("Surface",),
    "core.response": ("ResponseSpec",),
    "runtime.frames.live_frame": ("LiveFrame",),
    "store.layout": ("Prediction",),
    "training.data.dataset": ("Dataset", "Recording"),
    "training.evaluation.evaluate_models": ("SessionEvaluation",),
    "workflow.calibrate.fit_response": ("FittedResponse",),
    "workflow.device": ("Device",),
    "workflow.experiments": (
        "fit_response",
        "load_experiment",
        "reproduce",
        "simulate_specimens",
    ),
    "workflow.layout": ("Layout", "Parts", "fabricate", "optimize", "predict"),
    "workflow.live_session": ("Live", "live"),
    "workflow.model": ("Model", "MovingSurface", "evaluate", "recalibrate", "train"),
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
    "workflow.recordings": (
        "dataset",
        "export_dataset",
        "join",
        "load_sessions",
        "process",
        "read_tables",
        "record",
        "record_twin",
    ),
    "workflow.reproduce.experiment": ("Experiment",),
    "workflow.simulation": ("Picture", "Simulation", "simulate"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

if not TYPE_CHECKING:  # type checkers must only see the names above

    def __getattr__(name: str) -> object:
        """Return a name of the interface, importing its module now."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULE_OF])
