"""Cords with optimised paths, and what they are predicted to sense."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.arrays import Float
from ..core.errors import LayoutError
from ..core.prediction import Prediction
from ..core.progress import Progress, silent
from ..store.layout import CordRecord, LayoutRecord, load_layout, load_prediction
from .device import table_html
from .given import of_kind
from .picture import Picture
from .simulation import Simulation


@dataclass(frozen=True, repr=False)
class Layout:
    """The cords of a device that was simulated as `poses`. `cords` in the order of their channels:
    their `points` (p, 3) mm in the rest frame, length mm and so on; the `prediction` with errors in
    mm; of the n `states`, rest first, `signals` (n, c) as (R - R0)/R0 and distances `errors` (n, k)
    mm of the k `markers` (k, 3) mm from where they are, without noise; `warnings`."""

    poses: Simulation
    cords: tuple[CordRecord, ...]
    prediction: Prediction
    states: tuple[str, ...]
    signals: Float
    errors: Float
    markers: Float
    warnings: tuple[str, ...]
    record: LayoutRecord

    def picture(self) -> Picture:
        """The body with its cords from three sides; paths as they were drawn are grey."""
        from ..geometry.bodies.orientation import viewing_axes
        from ..report.pictures.routing import routing

        surface = self.poses.surface
        drawn = () if self.record.proposed else self.record.drawn
        radius = self.poses.device.record.cord.diameter / 2
        paths = [c.points for c in self.cords]
        return Picture.of_uri(routing(surface, paths, drawn, radius, viewing_axes(surface)))

    def __repr__(self) -> str:
        return (
            f"<Layout of {self.poses.device.name!r}: {len(self.cords)} cords,"
            f" {self.prediction.unseen:.2f} mm RMSE on unseen states>"
        )

    def _repr_html_(self) -> str:
        p = self.prediction
        rows = {"unseen states": f"{p.unseen:.3f} mm RMSE ({p.decoder})"}
        states = {**p.per_state, **p.held_out}
        rows |= {s: f"{e:.3f} mm RMSE" for s, e in states.items()}
        return table_html(f"Cords of {self.poses.device.name}", rows)


def optimise(poses: Simulation, progress: Progress = silent) -> Layout:
    """The cords that the device asks for, drawn ones improved and others found, chosen as `defsense
    build` does. Raises LayoutError where a cord cannot keep its limits, and for what is no
    simulation; FabricationError where nothing that was found can be made."""
    of_kind(poses, "poses", Simulation, LayoutError)
    device = poses.device
    folder = device.workspace.built(device.record, "optimize", progress)
    layout, found = load_layout(folder), load_prediction(folder)
    return Layout(
        poses, tuple(layout.by_channel()), layout.prediction, found.states, found.signals,
        found.errors, found.markers, layout.warnings, layout,
    )  # fmt: skip
