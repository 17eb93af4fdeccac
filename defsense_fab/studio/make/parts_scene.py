"""Show the parts of a built device, exploded or assembled, and fly cameras to a point."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...workflow.fabrication.assembly_guide import PART_COLORS, AssemblyGuide, GuideStep, Joint
from ..workbench.cord_tubes import Color, add_tube

_CORD_COLOR, _WIRE_COLOR, _PIN_COLOR = (230, 140, 30), (31, 119, 180), (240, 228, 180)
_FAINT_OPACITY = 0.25  # of parts that hide what a step is about
_VIEW_DISTANCE = 0.45  # of a camera from its target, times the body's size
_FLIGHT_FRAMES, _FLIGHT_FRAME_S = 15, 0.03  # half a second in all


class PartsScene:
    """The parts in a viser server's scene; hidden until `show`.

    Call the methods while the workbench's `drawing_lock` is held.

    Args:
        server: The viser server.
        guide: The assembly guide of the device.
        cord_radius: Radius of the cords, mm.
        wire_radius: Radius of the wires, mm.
    """

    def __init__(
        self, server: Any, guide: AssemblyGuide, cord_radius: float, wire_radius: float
    ) -> None:
        self._scene, self._guide = server.scene, guide
        self._cord_radius, self._wire_radius = cord_radius, wire_radius
        self._parts, self._labels = dict[str, Any](), dict[str, Any]()
        self._extras: list[Any] = []
        self._shifts: dict[str, Float] = {}
        for k, (name, surface) in enumerate(guide.parts.items()):
            self._parts[name] = self._scene.add_mesh_simple(
                f"/parts/{name}",
                surface.vertices,
                surface.faces,
                color=_parse_color(PART_COLORS[k % len(PART_COLORS)]),
                flat_shading=True,
                side="double",
                visible=False,
            )
            self._labels[name] = self._scene.add_label(
                f"/part_names/{name}", name, anchor="center-center", visible=False
            )

    @property
    def positions(self) -> dict[str, Float]:
        """Displacement (3,) mm of each part, by name."""
        return {name: np.asarray(handle.position) for name, handle in self._parts.items()}

    @property
    def visible_parts(self) -> set[str]:
        """Names of the parts that are visible."""
        return {name for name, handle in self._parts.items() if handle.visible}

    @property
    def faint_parts(self) -> set[str]:
        """Names of the parts that are nearly transparent."""
        return {n for n, handle in self._parts.items() if handle.opacity == _FAINT_OPACITY}

    @property
    def extras(self) -> set[str]:
        """Names in the scene of the cords, wires and pins of the shown step."""
        return {handle.name for handle in self._extras}

    def show(self, step: GuideStep | None, index: int, explosion: float) -> None:
        """Show all parts, or a step of the guide.

        Steps before the first joint show the exploded parts, steps after it the assembled device.

        Args:
            step: The step, or None for all parts.
            index: Index of the step in the guide.
            explosion: Share of the exploded view, from 0 (assembled) to 1.
        """
        self.hide()
        joint = None if step is None else step.joint
        is_joined = step is not None and any(s.joint for s in self._guide.steps[:index])
        cords = () if not is_joined else tuple(s.name for s in self._guide.layout.sensors)
        if joint is not None:
            lifted = {n: joint.lift * joint.opens for n in joint.upper}
            self._shifts = {n: lifted.get(n, np.zeros(3)) for n in (*joint.lower, *joint.upper)}
            cords = joint.cords
        elif cords:
            self._shifts = {n: np.zeros(3) for n in self._parts}
        else:
            self._shifts = dict(self._guide.shifts)
        is_faint = bool(cords) and joint is None
        for name in self._shifts:
            self._parts[name].visible = self._labels[name].visible = True
            self._parts[name].opacity = _FAINT_OPACITY if is_faint else None
        self._add_cords(cords)
        if joint is not None:
            self._add_joint(joint)
        self.explode(explosion)

    def explode(self, explosion: float) -> None:
        """Move the parts to a share of the exploded view, from 0 (assembled) to 1."""
        for name, shift in self._shifts.items():
            self._parts[name].position = tuple((explosion * shift).tolist())
            middle = self._guide.parts[name].bounds.mean(axis=0)
            self._labels[name].position = tuple((middle + explosion * shift).tolist())

    def fade(self) -> None:
        """Make the parts nearly transparent until the next `show`."""
        for part in self._parts.values():
            part.opacity = _FAINT_OPACITY

    def hide(self) -> None:
        """Hide everything."""
        for handle in (*self._parts.values(), *self._labels.values()):
            handle.visible = False
        for handle in self._extras:
            handle.remove()
        self._extras, self._shifts = [], {}

    def remove(self) -> None:
        """Remove everything from the scene."""
        self.hide()
        for handle in (*self._parts.values(), *self._labels.values()):
            handle.remove()
        self._parts, self._labels = {}, {}

    def _add_cords(self, names: tuple[str, ...]) -> None:
        paths = {s.name: s.points for s in self._guide.layout.sensors}
        for name in names:
            self._add_tube(f"/step/cord/{name}", paths[name], self._cord_radius, _CORD_COLOR)

    def _add_joint(self, joint: Joint) -> None:
        import trimesh

        for k, wire in enumerate(joint.wires):
            self._add_tube(f"/step/wire/{k}", wire, self._wire_radius, _WIRE_COLOR)
        for k, pin in enumerate(joint.pins):
            half = pin.depth * joint.opens / np.linalg.norm(joint.opens)
            mesh = trimesh.creation.cylinder(
                pin.socket / 2, segment=[pin.center - half, pin.center + half]
            )
            self._extras.append(
                self._scene.add_mesh_simple(
                    f"/step/pin/{k}",
                    np.asarray(mesh.vertices, np.float32),
                    np.asarray(mesh.faces, np.uint32),
                    color=_PIN_COLOR,
                    flat_shading=True,
                )
            )

    def _add_tube(self, name: str, path: Float, radius: float, color: Color) -> None:
        self._extras.append(add_tube(self._scene, name, path, radius, color, side="double"))


def view_position(target: Float, middle: Float, camera: Float, size: float) -> Float:
    """Return the position (3,) mm from which a camera sees a point of a body.

    It is outwards from the body's middle, and a little towards the camera's present position.

    Args:
        target: The point (3,) mm.
        middle: Middle of the body (3,) mm.
        camera: Present position of the camera (3,) mm.
        size: Size of the body, mm.
    """
    direction = _unit_vector(target - middle) + 0.8 * _unit_vector(camera - target)
    if np.linalg.norm(direction) < 1e-6:
        direction = np.array([0.3, -1.0, 0.5])
    return np.asarray(target + _VIEW_DISTANCE * size * _unit_vector(direction))


def fly_to(
    server: Any, target: Float, middle: Float, size: float, frame_s: float = _FLIGHT_FRAME_S
) -> int:
    """Fly the cameras of all browsers to a point; this takes half a second.

    Args:
        server: The viser server.
        target: The point (3,) mm.
        middle: Middle of the body (3,) mm.
        size: Size of the body, mm.
        frame_s: Time of each frame, s.

    Returns:
        The number of browsers.
    """
    clients = list(server.get_clients().values())
    starts = [np.asarray(c.camera.position, float) for c in clients]
    look_ats = [np.asarray(c.camera.look_at, float) for c in clients]
    ends = [view_position(target, middle, start, size) for start in starts]
    for k in range(1, _FLIGHT_FRAMES + 1):
        share = k / _FLIGHT_FRAMES
        eased = share * share * (3 - 2 * share)
        for client, start, look_at, end in zip(clients, starts, look_ats, ends, strict=True):
            with client.atomic():
                client.camera.position = tuple(start + eased * (end - start))
                # last, because the position changes it too
                client.camera.look_at = tuple(look_at + eased * (target - look_at))
        time.sleep(frame_s)
    return len(clients)


def _unit_vector(vector: Float) -> Float:
    length = float(np.linalg.norm(vector))
    return np.zeros(3) if length < 1e-9 else vector / length


def _parse_color(color: str) -> Color:
    """Return the RGB values of "#rrggbb"."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue
