"""Design, fabrication and use of soft objects that sense their own deformation.

The Python interface is here, and is imported when it is first used (docs/python.md).
"""

from importlib import import_module
from typing import TYPE_CHECKING

from .core.version import __version__ as __version__

if TYPE_CHECKING:
    from .api.device import Device as Device
    from .api.layout import Layout as Layout
    from .api.layout import optimise as optimise
    from .api.models.live import Live as Live
    from .api.models.live import live as live
    from .api.models.model import Model as Model
    from .api.models.model import train as train
    from .api.models.surface import MovingSurface as MovingSurface
    from .api.parts import Parts as Parts
    from .api.parts import fabricate as fabricate
    from .api.picture import Picture as Picture
    from .api.poses import Drag as Drag
    from .api.poses import DrawnCord as DrawnCord
    from .api.poses import Handle as Handle
    from .api.poses import Pose as Pose
    from .api.poses import Pressure as Pressure
    from .api.poses import Symmetry as Symmetry
    from .api.prediction import predict as predict
    from .api.recordings import dataset as dataset
    from .api.recordings import load_sessions as load_sessions
    from .api.recordings import record_twin as record_twin
    from .api.regions import box as box
    from .api.regions import cylinder as cylinder
    from .api.regions import half_space as half_space
    from .api.regions import sphere as sphere
    from .api.simulation import Simulation as Simulation
    from .api.simulation import simulate as simulate
    from .core.errors import DefsenseError as DefsenseError
    from .core.mesh import Surface as Surface
    from .core.prediction import Prediction as Prediction
    from .runtime.frames.live_frame import LiveFrame as LiveFrame
    from .training.data.dataset import Dataset as Dataset
    from .training.data.dataset import Recording as Recording

_MODULES = {
    "api.device": ("Device",),
    "api.layout": ("Layout", "optimise"),
    "api.models.live": ("Live", "live"),
    "api.models.model": ("Model", "train"),
    "api.models.surface": ("MovingSurface",),
    "api.parts": ("Parts", "fabricate"),
    "api.picture": ("Picture",),
    "api.poses": ("Drag", "DrawnCord", "Handle", "Pose", "Pressure", "Symmetry"),
    "api.prediction": ("predict",),
    "api.recordings": ("dataset", "load_sessions", "record_twin"),
    "api.regions": ("box", "cylinder", "half_space", "sphere"),
    "api.simulation": ("Simulation", "simulate"),
    "core.errors": ("DefsenseError",),
    "core.mesh": ("Surface",),
    "core.prediction": ("Prediction",),
    "runtime.frames.live_frame": ("LiveFrame",),
    "training.data.dataset": ("Dataset", "Recording"),
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:  # for type checkers there is nothing but the names above

    def __getattr__(name: str) -> object:
        """A name of the interface, imported now."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f".{_PLACES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_PLACES])
