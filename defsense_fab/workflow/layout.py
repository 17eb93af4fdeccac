"""Cords with optimised paths, and what they are predicted to sense."""

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
from ..core.prediction import Prediction
from ..core.progress import Progress, silent
from ..core.storage.files import replace_folder
from ..optimize.prediction import predict as design
from ..optimize.prediction.design_task import load_task
from ..store.build import Build
from ..store.layout import CordRecord, LayoutRecord
from ..store.manifest import FOLDER, Manifest
from .arguments import number, of_kind, path
from .device import table_html
from .simulation import Picture, Simulation

# The parts into which a device is cut along its cords.


@dataclass(frozen=True, repr=False)
class Parts:
    """The parts of a `layout`: their `surfaces` by name, in mm where they belong in the device; the
    `prediction` of the cords as they are built in, errors in mm; the `manifest` of all that is to
    be printed, cut and joined; `warnings`."""

    layout: Layout
    surfaces: Mapping[str, Surface]
    prediction: Prediction | None
    manifest: Manifest
    warnings: tuple[str, ...]
    results: Build

    def save(self, folder: str | Path) -> Path:
        """Write all files of the parts (STL, 3MF, manifest) into a new folder, whole or not
        at all. Raises StorageError."""
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
    """The parts, as `defsense build` makes them. Raises FabricationError."""
    of_kind(layout, "layout", Layout, FabricationError)
    device = layout.poses.device
    results = device.results("fabricate", progress)
    manifest = results.manifest
    return Parts(layout, results.parts, manifest.prediction, manifest, manifest.warnings, results)


# What given cords are predicted to sense of given poses.


def predict(
    layout: Layout,
    poses: Simulation | None = None,
    *,
    noise: float | None = None,
    decoder: str | None = None,
) -> Prediction:
    """Errors in mm, of all and of each state, of the layout's cords where they are, with a decoder
    fitted to the poses: its own, or those of another simulation of a device with the same body.

    `noise` (standard deviation of (R - R0)/R0) and `decoder` ("affine", "quadratic", "kernel") are
    its own where they are not given. Raises LayoutError for a noise or a decoder that cannot be,
    for poses of another body, and for what is no layout and no simulation.
    """
    of_kind(layout, "layout", Layout, LayoutError)
    seen = layout.poses if poses is None else of_kind(poses, "poses", Simulation, LayoutError)
    kind = layout.prediction.decoder
    if decoder is not None:
        kind = of_kind(decoder, "decoder", str, LayoutError)
    if kind not in DECODERS:
        raise LayoutError(f"decoder {kind!r}: is unknown; there are {', '.join(DECODERS)}")
    if not np.array_equal(seen.surface.vertices, layout.poses.surface.vertices):
        raise LayoutError(
            f"the poses of {seen.device.name!r} are of another body than the cords; optimize cords"
            " for it, or simulate poses of the same body"
        )
    device = seen.device.record
    if noise is not None:
        deviation = number(noise, "noise", LayoutError, above=0)
        device = replace(device, cord=replace(device.cord, noise=deviation))
    task = load_task(device, seen.results).with_decoder(kind)
    return design.predict(task, [c.built for c in layout.cords]).prediction


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


def optimize(poses: Simulation, progress: Progress = silent) -> Layout:
    """The cords that the device asks for, drawn ones improved and others found, chosen as `defsense
    build` does. Raises LayoutError where a cord cannot keep its limits, and for what is no
    simulation; FabricationError where nothing that was found can be made."""
    of_kind(poses, "poses", Simulation, LayoutError)
    device = poses.device
    results = device.results("optimize", progress)
    layout, prediction = results.layout, results.prediction
    return Layout(
        poses=poses,
        cords=tuple(layout.by_channel()),
        prediction=layout.prediction,
        states=prediction.states,
        signals=prediction.signals,
        errors=prediction.errors,
        markers=prediction.markers,
        warnings=layout.warnings,
        record=layout,
    )
