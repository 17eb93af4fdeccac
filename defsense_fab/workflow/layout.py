"""Optimize the cords of a device, predict their errors, and make the parts."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..core.arrays import Float
from ..core.device.device import DECODERS
from ..core.errors import FabricationError, LayoutError, StorageError
from ..core.mesh import Surface
from ..core.progress import Progress, silent
from ..core.storage.files import replace_folder
from ..optimization.prediction import predict as design
from ..optimization.prediction.design_task import load_task
from ..store.build import Build
from ..store.layout import CordRecord, LayoutRecord, Prediction
from ..store.manifest import FOLDER, Manifest
from .arguments import number, of_kind, one_of, path
from .device import table_html
from .fabrication.effort import Effort, find_effort
from .simulation import Picture, Simulation


@dataclass(frozen=True, repr=False)
class Layout:
    """The cords of a device, created by `optimize`.

    Attributes:
        simulation: The simulated states that the cords are designed for.
        cords: The c cords in the order of their channels, with `points` (p, 3) mm in the rest
            frame, length in mm and so on.
        prediction: Predicted errors, mm.
        states: Names of the n states, with rest first.
        signals: Signals (n, c) of the states, (R - R0)/R0.
        errors: Distances (n, k) mm of the predicted markers from their positions, without noise.
        markers: Positions (k, 3) mm of the markers at rest.
        warnings: Risks of the design.
        record: The layout as a build saves it.
    """

    simulation: Simulation
    cords: tuple[CordRecord, ...]
    prediction: Prediction
    states: tuple[str, ...]
    signals: Float
    errors: Float
    markers: Float
    warnings: tuple[str, ...]
    record: LayoutRecord

    def picture(self) -> Picture:
        """Return a picture of the body with its cords from three sides.

        The paths of cords as they were drawn are gray.
        """
        from ..geometry.bodies.orientation import viewing_axes
        from ..report.pictures.body_views import draw_routing

        surface = self.simulation.surface
        drawn = () if self.record.proposed else self.record.drawn
        radius = self.simulation.device.record.cord.diameter / 2
        paths = [c.points for c in self.cords]
        return Picture.from_uri(draw_routing(surface, paths, drawn, radius, viewing_axes(surface)))

    def __repr__(self) -> str:
        return (
            f"<Layout of {self.simulation.device.name!r}: {len(self.cords)} cords,"
            f" {self.prediction.unseen:.2f} mm RMSE on unseen states>"
        )

    def _repr_html_(self) -> str:
        p = self.prediction
        rows = {"unseen states": f"{p.unseen:.3f} mm RMSE ({p.decoder})"}
        states = {**p.per_state, **p.held_out}
        rows |= {s: f"{e:.3f} mm RMSE" for s, e in states.items()}
        return table_html(f"Cords of {self.simulation.device.name}", rows)


def optimize(simulation: Simulation, progress: Progress = silent) -> Layout:
    """Optimize the drawn cords of a device and find further ones, as `defsense build` does.

    Args:
        simulation: The simulated states of the device.
        progress: Receives each stage's name, completed fraction and a message.

    Raises:
        LayoutError: A cord cannot keep its limits, or an argument is invalid.
        FabricationError: No layout that was found can be made.
    """
    of_kind(simulation, "simulation", Simulation, LayoutError)
    results = simulation.device.results("optimize", progress)
    layout, prediction = results.layout, results.prediction
    return Layout(
        simulation=simulation,
        cords=tuple(layout.by_channel()),
        prediction=layout.prediction,
        states=prediction.states,
        signals=prediction.signals,
        errors=prediction.errors,
        markers=prediction.markers,
        warnings=layout.warnings,
        record=layout,
    )


def predict(
    layout: Layout,
    simulation: Simulation | None = None,
    *,
    noise: float | None = None,
    decoder: str | None = None,
) -> Prediction:
    """Predict the errors of the cords of a layout, with a decoder fitted to simulated states.

    Args:
        layout: The layout.
        simulation: States of a device with the same body; None: those of the layout.
        noise: Standard deviation of (R - R0)/R0; None: that of the device.
        decoder: "affine", "quadratic" or "kernel"; None: that of the layout.

    Returns:
        Errors over all states and of each state, mm.

    Raises:
        LayoutError: The noise or the decoder is invalid, or the states are of another body.
    """
    of_kind(layout, "layout", Layout, LayoutError)
    states = layout.simulation
    if simulation is not None:
        states = of_kind(simulation, "simulation", Simulation, LayoutError)
    kind = layout.prediction.decoder
    if decoder is not None:
        kind = one_of(decoder, "decoder", DECODERS, "decoder", LayoutError)
    if not np.array_equal(states.surface.vertices, layout.simulation.surface.vertices):
        raise LayoutError(
            f"the states of {states.device.name!r} are of another body than the cords",
            code="other-body",
            where="simulation",
            action="Optimize cords for it, or simulate poses of the same body",
            argument="simulation",
        )
    device = states.device.record
    if noise is not None:
        deviation = number(noise, "noise", LayoutError, above=0)
        device = replace(device, cord=replace(device.cord, noise=deviation))
    task = load_task(device, states.results).with_decoder(kind)
    return design.predict(task, [c.built for c in layout.cords]).prediction


@dataclass(frozen=True, repr=False)
class Parts:
    """The parts into which a device is cut along its cords, created by `fabricate`.

    Attributes:
        layout: The layout.
        surfaces: Surfaces of the parts by name, in mm in the frame of the device.
        prediction: Predicted errors of the cords as built in, mm.
        manifest: All that must be printed, cut and joined.
        warnings: Risks of the fabrication.
        results: The results of the build.
    """

    layout: Layout
    surfaces: Mapping[str, Surface]
    prediction: Prediction | None
    manifest: Manifest
    warnings: tuple[str, ...]
    results: Build

    @property
    def effort(self) -> Effort:
        """What the device takes: printing time, mass, cord, time of assembly and cost."""
        return find_effort(self.layout.simulation.device.record, self.manifest)

    def save(self, folder: str | Path) -> Path:
        """Write all files of the parts (STL, 3MF, manifest) into a new folder.

        Args:
            folder: The folder; it is written completely or not at all.

        Returns:
            The folder.

        Raises:
            StorageError: The folder exists or cannot be written.
        """
        folder = path(folder, "folder", StorageError)
        source = self.results.folder / FOLDER
        with replace_folder(folder) as new:
            shutil.copytree(source, new, dirs_exist_ok=True)
        return folder

    def __repr__(self) -> str:
        return f"<Parts of {self.manifest.device!r}: {', '.join(self.surfaces)}>"

    def _repr_html_(self) -> str:
        rows = {
            n: f"{s.volume / 1000:.1f} cm\N{SUPERSCRIPT THREE}" for n, s in self.surfaces.items()
        }
        return table_html(f"Parts of {self.manifest.device}", rows)


def fabricate(layout: Layout, progress: Progress = silent) -> Parts:
    """Make the parts of a device, as `defsense build` does.

    Args:
        layout: The layout.
        progress: Receives each stage's name, completed fraction and a message.

    Raises:
        FabricationError: The parts cannot be made, or an argument is invalid.
    """
    of_kind(layout, "layout", Layout, FabricationError)
    results = layout.simulation.device.results("fabricate", progress)
    manifest = results.manifest
    return Parts(layout, results.parts, manifest.prediction, manifest, manifest.warnings, results)
