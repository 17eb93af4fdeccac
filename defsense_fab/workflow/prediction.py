"""What given cords are predicted to sense of given poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.device.device import DECODERS
from ..core.errors import LayoutError
from ..core.prediction import Prediction
from ..optimize.prediction import predict as design
from ..optimize.prediction.design_task import load_task
from ..store.build import Build
from .given import number, of_kind
from .layout import Layout
from .simulation import Simulation


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
            f"the poses of {seen.device.name!r} are of another body than the cords; optimise cords"
            " for it, or simulate poses of the same body"
        )
    device = seen.device.record
    if noise is not None:
        deviation = number(noise, "noise", LayoutError, above=0)
        device = replace(device, cord=replace(device.cord, noise=deviation))
    task = load_task(device, Build(seen.device.workspace.folder / "build")).with_decoder(kind)
    return design.predict(task, [c.built for c in layout.cords]).prediction
