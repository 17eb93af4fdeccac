"""The body, its regions and the gizmos in the scene of the Poses mode."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...core.rotations import rotation_matrices
from ...workflow.design.pose_preview import load_preview
from ...workflow.design.region_points import points_in_regions
from ...workflow.view import quaternion
from ..workbench.cord_tubes import Color
from ..workbench.workbench import Workbench
from .grips import Grip, GripCallback
from .preview_work import PreviewWork

_BODY_COLOR: Color = (196, 203, 212)
#: Colors of regions in their order, which color-blind people can distinguish (Okabe and Ito).
REGION_COLORS: tuple[Color, ...] = (
    (230, 159, 0),
    (0, 114, 178),
    (0, 158, 115),
    (204, 121, 167),
    (213, 94, 0),
    (86, 180, 233),
    (240, 228, 66),
)
_ROOT = "/poses"
_GIZMO_SIZE = 0.22  # times the body's size
_MIN_ANGLE_RAD = 1e-9


def region_color(index: int) -> Color:
    """Return the RGB color of the device's region with an index."""
    return REGION_COLORS[index % len(REGION_COLORS)]


class PosedBody:
    """The body in a pose: a mesh for the faces of each region, and one for all others.

    Args:
        server: The viser server.
        surface: The surface at rest.
        on_click: Called with each click on the body while clicks are taken.

    Attributes:
        rest: Vertices (v, 3) mm at rest.
        faces: Triangles (f, 3).
        vertices: Vertices (v, 3) mm as shown.
        region_points: Which vertices (v,) each region holds, by its name, as shown.
    """

    def __init__(self, server: Any, surface: Surface, on_click: Callable[[Any], None]) -> None:
        self._scene, self._on_click = server.scene, on_click
        self.rest, self.faces = surface.vertices, surface.faces
        self.vertices: Float = surface.vertices
        self.region_points: dict[str, Bool] = {}
        self._meshes: list[tuple[Any, Any]] = []  # each mesh of the scene with its vertices
        self._is_visible = self._takes_clicks = False
        self.show_regions({})

    def show_regions(self, points: Mapping[str, Bool]) -> None:
        """Color the regions; a face in two regions has the color of the first.

        Args:
            points: Which vertices (v,) each region holds, by its name, in the device's order.
        """
        before = self.region_points
        has_same_names = list(points) == list(before)
        if (
            self._meshes
            and has_same_names
            and all((points[name] == before[name]).all() for name in points)
        ):
            return
        self.region_points = dict(points)
        owner = np.full(len(self.faces), -1)
        for k, inside in reversed(list(enumerate(points.values()))):
            owner[inside[self.faces].all(axis=1)] = k
        self.remove()
        names = ["body", *(f"regions/{k}" for k in range(len(points)))]
        for k, name in enumerate(names, start=-1):
            faces = self.faces[owner == k]
            if len(faces):
                color = _BODY_COLOR if k < 0 else region_color(k)
                self._meshes.append(self._add_mesh(name, faces, color))
        self._update_click_callbacks()

    def move(self, vertices: Float) -> None:
        """Show the vertices at (v, 3) mm."""
        self.vertices = vertices
        for mesh, used in self._meshes:
            mesh.vertices = vertices[used].astype(np.float32)

    def show(self, is_visible: bool) -> None:
        """Show or hide the body."""
        self._is_visible = is_visible
        for mesh, _ in self._meshes:
            mesh.visible = is_visible

    def take_clicks(self, takes_clicks: bool) -> None:
        """Start or stop to report clicks on the body."""
        if takes_clicks != self._takes_clicks:
            self._takes_clicks = takes_clicks
            self._update_click_callbacks()

    def remove(self) -> None:
        """Remove the meshes from the scene."""
        for mesh, _ in self._meshes:
            mesh.remove()
        self._meshes = []

    def _add_mesh(self, name: str, faces: Any, color: Color) -> tuple[Any, Any]:
        used, inverse = np.unique(faces, return_inverse=True)
        mesh = self._scene.add_mesh_simple(
            f"{_ROOT}/{name}",
            self.vertices[used],
            inverse.reshape(faces.shape),
            color=color,
            side="double",
            visible=self._is_visible,
        )
        return mesh, used

    def _update_click_callbacks(self) -> None:
        for mesh, _ in self._meshes:
            mesh.remove_click_callback()
            if self._takes_clicks:
                mesh.on_click(self._on_click)


class Gizmos:
    """The gizmos of some grips.

    A gizmo that stays is moved rather than replaced, so that one user keeps hold of it while
    another releases it.

    Args:
        server: The viser server.
        size: Size of the body, mm.
        on_move: Called while a gizmo is dragged and once it is released.
    """

    def __init__(self, server: Any, size: float, on_move: GripCallback) -> None:
        self._scene, self._size, self._on_move = server.scene, size, on_move
        self._gizmos: dict[tuple[str, bool, bool], Any] = {}
        self._rotations: dict[str, Float] = {}  # rotation vectors, which count whole turns

    @property
    def positions(self) -> dict[str, Float]:
        """Positions (3,) mm of the gizmos, by the names of their grips."""
        return {key[0]: np.asarray(gizmo.position) for key, gizmo in self._gizmos.items()}

    def place(self, grips: Sequence[Grip]) -> None:
        """Show gizmos on these grips, and remove all others."""
        grips_by_key = {
            (grip.name, grip.can_shift, grip.can_turn): grip
            for grip in grips
            if grip.can_shift or grip.can_turn
        }
        for key in [key for key in self._gizmos if key not in grips_by_key]:
            self._gizmos.pop(key).remove()
        for key, grip in grips_by_key.items():
            self._rotations[grip.name] = grip.rotation
            if key not in self._gizmos:
                self._gizmos[key] = self._add(grip)
            gizmo = self._gizmos[key]
            gizmo.position, gizmo.wxyz = (
                tuple(grip.position.tolist()),
                quaternion(rotation_matrices(grip.rotation)),
            )

    def follow(self, event: Any, name: str) -> None:
        """Pass on the event of viser that a grip's gizmo has moved."""
        if event.client is None and event.client_id is None:  # set by the page itself
            return
        previous = self._rotations.get(name, np.zeros(3))
        rotation = rotation_vector(np.asarray(event.target.wxyz, float), previous)
        self._rotations[name] = rotation
        position = np.asarray(event.target.position, float)
        self._on_move(name, position, rotation, event.phase == "end")

    def _add(self, grip: Grip) -> Any:
        gizmo = self._scene.add_transform_controls(
            f"/grips/{grip.name}",
            scale=_GIZMO_SIZE * self._size,
            line_width=3.0,
            depth_test=False,
            disable_axes=not grip.can_shift,
            disable_sliders=not grip.can_shift,
            disable_rotations=not grip.can_turn,
            position=grip.position,
            wxyz=quaternion(rotation_matrices(grip.rotation)),
        )

        async def on_update(event: Any) -> None:  # a coroutine keeps the order of the events
            if event.phase == "end":  # writing the file takes a while
                await asyncio.to_thread(self.follow, event, grip.name)
            else:
                self.follow(event, grip.name)

        gizmo.on_update(on_update)
        return gizmo


class PosesScene:
    """The posed body and its gizmos, which the parts of the mode share.

    Args:
        bench: The workbench.
        work: Solves poses on a thread.

    Attributes:
        bench: The workbench.
        work: Solves poses on a thread.
        body: The posed body, or None until the body is meshed.
        gizmos: The gizmos, or None until the body is meshed.
        on_grip: Called when a gizmo is moved; set by the part that is shown.
        on_click: Called with each click on the body while clicks are taken.
    """

    def __init__(self, bench: Workbench, work: PreviewWork) -> None:
        self.bench, self.work = bench, work
        self.body: PosedBody | None = None
        self.gizmos: Gizmos | None = None
        self.on_grip: GripCallback = lambda *_: None
        self.on_click: Callable[[Any], None] = lambda _: None
        self._is_shown = False

    @property
    def points(self) -> Float:
        """Points (v, 3) mm of the surface at rest; only with a meshed body."""
        assert self.body is not None
        return self.body.rest

    @property
    def size(self) -> float:
        """The body's largest extent, mm; only with a meshed body."""
        return float(np.ptp(self.points, axis=0).max())

    def load(self) -> None:
        """Load the meshed body of the last build, if there is one."""
        self.clear()
        try:
            preview = load_preview(self.bench.project.device)
        except (DefsenseError, OSError):
            self.work.use(None)
            return
        surface = preview.surface
        self.work.use(preview)
        self._add(surface)

    def clear(self) -> None:
        """Remove the body and its gizmos from the scene."""
        if self.gizmos is not None:
            self.gizmos.place(())
        if self.body is not None:
            self.body.remove()
        self.body = self.gizmos = None

    def show(self, is_shown: bool) -> None:
        """Show the posed body instead of the body of the other modes, or hide it."""
        self._is_shown = is_shown
        if self.body is not None:
            self.body.show(is_shown)
        if self.bench.body is not None:
            self.bench.body.visible = not (is_shown and self.body is not None)
        if not is_shown:
            self.show_grips(())

    def show_grips(self, grips: Sequence[Grip]) -> None:
        """Show gizmos on these grips only, while the mode is shown."""
        if self.gizmos is not None:
            self.gizmos.place(grips if self._is_shown else ())

    def color_regions(self) -> None:
        """Color the device's regions."""
        if self.body is not None:
            regions = self.bench.project.device.regions
            self.body.show_regions(points_in_regions(regions, self.points))

    def show_rest(self) -> None:
        """Show the body at rest."""
        if self.body is not None:
            self.body.move(self.body.rest)

    def _add(self, surface: Surface) -> None:
        self.body = PosedBody(self.bench.server, surface, lambda event: self.on_click(event))
        self.gizmos = Gizmos(self.bench.server, self.size, lambda *args: self.on_grip(*args))
        self.color_regions()
        self.show(self._is_shown)


def rotation_vector(wxyz: Float, previous: Float) -> Float:
    """Return the rotation vector of a quaternion that is closest to the previous one.

    The user may therefore turn a gizmo beyond half a turn.

    Args:
        wxyz: The quaternion w, x, y, z.
        previous: Rotation vector (3,) rad before.

    Returns:
        Rotation vector (3,) rad.
    """
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    vector = Rotation.from_quat([x, y, z, w]).as_rotvec()
    angle = float(np.linalg.norm(vector))
    previous_angle = float(np.linalg.norm(previous))
    if angle < _MIN_ANGLE_RAD:
        if previous_angle < np.pi:
            return np.zeros(3)
        whole_turns = round(previous_angle / (2 * np.pi))
        return np.asarray(previous / previous_angle * 2 * np.pi * whole_turns)
    axis = vector / angle
    turns = round((float(previous @ axis) - angle) / (2 * np.pi))
    return np.asarray(axis * (angle + 2 * np.pi * turns))
