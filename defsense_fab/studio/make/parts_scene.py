"""The parts of a built device in three dimensions, apart or together, as a step of the guide."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...report.pictures.sheet import COLORS
from ...report.guide.assembly.steps import GuideStep, Joint
from ...runtime.view.cord_mesh import tube_faces, tube_vertices
from .built_device import BuiltDevice

# Every browser's camera flies to a place.

_NEAR = 0.45  # of the body's size, from the place
_FRAMES, _PAUSE = 15, 0.03  # s between them


def approach(place: Float, middle: Float, camera: Float, size: float) -> Float:
    """Where a camera (3,) mm goes to see a place (3,) mm of a body around `middle` of that size:
    out along the way from the middle, and a little to where the camera was."""
    out = place - middle
    back = camera - place
    way = _unit(out) + 0.8 * _unit(back)
    if np.linalg.norm(way) < 1e-6:
        way = np.array([0.3, -1.0, 0.5])
    return np.asarray(place + _NEAR * size * _unit(way))


def fly(server: Any, place: Float, middle: Float, size: float, pause: float = _PAUSE) -> int:
    """Takes half a second; how many browsers there were."""
    clients = list(server.get_clients().values())
    begun = [np.asarray(c.camera.position, float) for c in clients]
    looked = [np.asarray(c.camera.look_at, float) for c in clients]
    ends = [approach(place, middle, p, size) for p in begun]
    for k in range(1, _FRAMES + 1):
        share = k / _FRAMES
        eased = share * share * (3 - 2 * share)
        for client, p, look, end in zip(clients, begun, looked, ends, strict=True):
            with client.atomic():
                client.camera.position = tuple(p + eased * (end - p))
                client.camera.look_at = tuple(look + eased * (place - look))  # last
        time.sleep(pause)
    return len(clients)


def _unit(way: Float) -> Float:
    length = float(np.linalg.norm(way))
    return np.zeros(3) if length < 1e-9 else way / length


_CORD, _WIRE, _PIN = (230, 140, 30), (31, 119, 180), (240, 228, 180)
_FAINT = 0.25  # opacity of parts that a step is not about
_STEPS = 60  # points of a cord's tube


class PartsScene:
    """Call it with the workbench's `drawing` lock taken."""

    def __init__(self, server: Any, built: BuiltDevice, cord: float, wire: float) -> None:
        """Cords and wires of these radii, mm; nothing is shown until `show`."""
        self._scene, self._built = server.scene, built
        self._cord, self._wire = cord, wire
        self._parts, self._labels = dict[str, Any](), dict[str, Any]()
        self._extras: list[Any] = []
        self._ways: dict[str, Float] = {}
        for k, (name, surface) in enumerate(built.parts.items()):
            self._parts[name] = self._scene.add_mesh_simple(
                f"/parts/{name}", surface.vertices.astype(np.float32),
                surface.faces.astype(np.uint32), color=_rgb(COLORS[k % len(COLORS)]),
                flat_shading=True, side="double", visible=False,
            )  # fmt: skip
            self._labels[name] = self._scene.add_label(
                f"/part_names/{name}", name, anchor="center-center", visible=False
            )

    def show(self, step: GuideStep | None, number: int, apart: float) -> None:
        """All parts, or a step and its `number` in the guide, from 0 on; `apart` from 0 to 1.
        Before the first joint there are parts alone, behind the last the device."""
        self.hide()
        joint = None if step is None else step.joint
        joined = step is not None and any(s.joint for s in self._built.steps[:number])
        cords = () if not joined else tuple(s.name for s in self._built.layout.sensors)
        if joint is None:
            self._ways = (
                dict(self._built.apart) if not cords else {n: np.zeros(3) for n in self._parts}
            )
        else:
            lifted = {n: joint.lift * joint.opens for n in joint.upper}
            self._ways = {n: lifted.get(n, np.zeros(3)) for n in (*joint.lower, *joint.upper)}
            cords = joint.cords
        faint = bool(cords) and joint is None
        for name in self._ways:
            self._parts[name].visible = self._labels[name].visible = True
            self._parts[name].opacity = _FAINT if faint else None
        self._add_cords(cords)
        if joint is not None:
            self._add_joint(joint)
        self.move(apart)

    def move(self, apart: float) -> None:
        """How far the parts are apart, from 0 to 1."""
        for name, way in self._ways.items():
            self._parts[name].position = tuple((apart * way).tolist())
            middle = self._built.parts[name].bounds.mean(axis=0)
            self._labels[name].position = tuple((middle + apart * way).tolist())

    def fade(self) -> None:
        """Let what lies inside be seen, until the next `show`."""
        for part in self._parts.values():
            part.opacity = _FAINT

    def hide(self) -> None:
        """Show nothing."""
        for handle in (*self._parts.values(), *self._labels.values()):
            handle.visible = False
        for handle in self._extras:
            handle.remove()
        self._extras, self._ways = [], {}

    def remove(self) -> None:
        """For good."""
        self.hide()
        for handle in (*self._parts.values(), *self._labels.values()):
            handle.remove()
        self._parts, self._labels = {}, {}

    def _add_cords(self, names: tuple[str, ...]) -> None:
        paths = {s.name: s.points for s in self._built.layout.sensors}
        for name in names:
            self._add_tube(f"/step/cord/{name}", paths[name], self._cord, _CORD)

    def _add_joint(self, joint: Joint) -> None:
        import trimesh

        for k, wire in enumerate(joint.wires):
            self._add_tube(f"/step/wire/{k}", wire, self._wire, _WIRE)
        for k, pin in enumerate(joint.pins):
            half = pin.depth * joint.opens / np.linalg.norm(joint.opens)
            mesh = trimesh.creation.cylinder(
                pin.socket / 2, segment=[pin.center - half, pin.center + half]
            )
            self._extras.append(
                self._scene.add_mesh_simple(
                    f"/step/pin/{k}", np.asarray(mesh.vertices, np.float32),
                    np.asarray(mesh.faces, np.uint32), color=_PIN, flat_shading=True,
                )
            )  # fmt: skip

    def _add_tube(self, name: str, path: Float, radius: float, color: tuple[int, int, int]) -> None:
        some = np.linspace(0, len(path) - 1, min(_STEPS, len(path))).round().astype(int)
        vertices = tube_vertices(path[some], radius).astype(np.float32)
        self._extras.append(
            self._scene.add_mesh_simple(
                name, vertices, tube_faces(len(some)).astype(np.uint32), color=color, side="double"
            )
        )


def _rgb(color: str) -> tuple[int, int, int]:
    """Of "#rrggbb"."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue
