"""What the parts of the mode share: the body, gizmos, and the solver beside the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...mechanics.elements.threads import count_cores
from ...optimize.prediction.pose_preview import load_preview
from ...optimize.prediction.region_points import held_points
from ..workbench.workbench import Workbench
from .gizmos import Gizmos, Grip, Moved
from .posed_body import PosedBody
from .preview_work import PreviewWork


class PosesScene:
    """Of one workbench; there is no `body` until it is meshed."""

    def __init__(self, bench: Workbench, work: PreviewWork) -> None:
        self.bench, self.work = bench, work
        self.body: PosedBody | None = None
        self.gizmos: Gizmos | None = None
        self.moved: Moved = lambda *_: None  # hears of gizmos; belongs to the part that is shown
        self.clicked: Callable[[Any], None] = lambda _: None  # hears of clicks on the body
        self._shown = False

    @property
    def folder(self) -> Any:
        """The build's."""
        return build_folder(self.bench.project.device)

    @property
    def points(self) -> Float:
        """Of the surface at rest, (v, 3) mm."""
        assert self.body is not None
        return self.body.rest

    @property
    def size(self) -> float:
        """The body's largest extent, mm."""
        return float(np.ptp(self.points, axis=0).max())

    def load(self) -> None:
        """What there is of the build: the body and the solver, or neither."""
        self.clear()
        try:
            # One core is left to the page: with as many threads as cores the solver waits for it.
            preview = load_preview(self.bench.project.device, max(count_cores() - 1, 1))
        except (DefsenseError, OSError):
            self.work.begin(None)
            return
        surface = preview.surface
        self.work.begin(preview)
        self._add(surface)

    def clear(self) -> None:
        """Take all of it out of the scene."""
        if self.gizmos is not None:
            self.gizmos.place(())
        if self.body is not None:
            self.body.remove()
        self.body = self.gizmos = None

    def show(self, visible: bool) -> None:
        """The posed body in place of the one that other modes have."""
        self._shown = visible
        if self.body is not None:
            self.body.show(visible)
        if self.bench.body is not None:
            self.bench.body.visible = not (visible and self.body is not None)
        if not visible:
            self.grips(())

    def grips(self, grips: Sequence[Grip]) -> None:
        """The gizmos that are there, while the mode is shown."""
        if self.gizmos is not None:
            self.gizmos.place(grips if self._shown else ())

    def color_regions(self) -> None:
        """As the device has them now."""
        if self.body is not None:
            regions = self.bench.project.device.regions
            self.body.show_regions(held_points(regions, self.points))

    def rest(self) -> None:
        """Show the body as it is at rest."""
        if self.body is not None:
            self.body.move(self.body.rest)

    def _add(self, surface: Surface) -> None:
        self.body = PosedBody(self.bench.server, surface, lambda event: self.clicked(event))
        self.gizmos = Gizmos(self.bench.server, self.size, lambda *args: self.moved(*args))
        self.color_regions()
        self.show(self._shown)
