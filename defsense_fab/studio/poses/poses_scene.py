"""What the parts of the mode share: the body, gizmos, and the solver beside the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...mechanics.elements.threads import count_cores
from ...optimize.prediction.pose_preview import load_preview
from ...optimize.prediction.region_points import points_in_regions
from ..workbench.workbench import Workbench
from .gizmos import Gizmos, Grip, Moved
from .preview_work import PreviewWork

# The body as a pose has it, with its regions in colours of their own.

_BODY = (196, 203, 212)
#: Of regions, in their order: Okabe and Ito's, which colour-blind people tell apart.
COLORS = (
    (230, 159, 0), (0, 114, 178), (0, 158, 115), (204, 121, 167), (213, 94, 0), (86, 180, 233),
    (240, 228, 66),
)  # fmt: skip
_ROOT = "/poses"


def region_color(at: int) -> tuple[int, int, int]:
    """Of the region that is the `at`-th of the device."""
    return COLORS[at % len(COLORS)]


class PosedBody:
    """Faces of each region are a mesh of their own in a viser server's scene; so is the rest."""

    def __init__(self, server: Any, surface: Surface, clicked: Callable[[Any], None]) -> None:
        """`clicked` hears of clicks on the body while `clickable`."""
        self._scene, self._clicked = server.scene, clicked
        self.rest, self.faces = surface.vertices, surface.faces
        self.vertices: Float = surface.vertices  # as they are shown
        self._pieces: list[tuple[Any, Any]] = []  # mesh in the scene, and its vertices
        self._held: dict[str, Bool] = {}
        self._visible = self._clickable = False
        self.show_regions({})

    def show_regions(self, held: Mapping[str, Bool]) -> None:
        """The regions' points (v,), in the device's order; a face that two hold is the first's."""
        same = list(held) == list(self._held)
        if self._pieces and same and all((held[n] == self._held[n]).all() for n in held):
            return
        self._held = dict(held)
        owner = np.full(len(self.faces), -1)
        for k, inside in reversed(list(enumerate(held.values()))):
            owner[inside[self.faces].all(axis=1)] = k
        for mesh, _ in self._pieces:
            mesh.remove()
        self._pieces = []
        names = ["body", *(f"regions/{k}" for k in range(len(held)))]
        for k, name in enumerate(names, start=-1):
            faces = self.faces[owner == k]
            if len(faces):
                self._pieces.append(self._piece(name, faces, _BODY if k < 0 else region_color(k)))
        self._listen()

    def move(self, vertices: Float) -> None:
        """Show the vertices (v, 3) mm."""
        self.vertices = vertices
        for mesh, used in self._pieces:
            mesh.vertices = vertices[used].astype(np.float32)

    def show(self, visible: bool) -> None:
        """In the scene, or not."""
        self._visible = visible
        for mesh, _ in self._pieces:
            mesh.visible = visible

    def take_clicks(self, clickable: bool) -> None:
        """Whether clicks on the body are heard of."""
        if clickable != self._clickable:
            self._clickable = clickable
            self._listen()

    def remove(self) -> None:
        """Out of the scene."""
        for mesh, _ in self._pieces:
            mesh.remove()
        self._pieces = []

    def _piece(self, name: str, faces: Any, color: tuple[int, int, int]) -> tuple[Any, Any]:
        used, inverse = np.unique(faces, return_inverse=True)
        mesh = self._scene.add_mesh_simple(
            f"{_ROOT}/{name}", self.vertices[used].astype(np.float32),
            inverse.reshape(faces.shape).astype(np.uint32), color=color, side="double",
            visible=self._visible,
        )  # fmt: skip
        return mesh, used

    def _listen(self) -> None:
        for mesh, _ in self._pieces:
            mesh.remove_click_callback()
            if self._clickable:
                mesh.on_click(self._clicked)


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
            self.body.show_regions(points_in_regions(regions, self.points))

    def rest(self) -> None:
        """Show the body as it is at rest."""
        if self.body is not None:
            self.body.move(self.body.rest)

    def _add(self, surface: Surface) -> None:
        self.body = PosedBody(self.bench.server, surface, lambda event: self.clicked(event))
        self.gizmos = Gizmos(self.bench.server, self.size, lambda *args: self.moved(*args))
        self.color_regions()
        self.show(self._shown)
