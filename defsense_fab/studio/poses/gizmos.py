"""What hands take hold of in the scene: regions of a pose, points that are pulled, shapes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.camera import rotation_matrices

_SIZE = 0.22  # of the body


@dataclass(frozen=True)
class Grip:
    """One gizmo: what it is called, where it is (3,) mm, its rotation vector (3,) rad, and whether
    it can be shifted and turned."""

    name: str
    position: Float
    rotation: Float
    shifts: bool
    turns: bool


#: Called with a grip's name, where a hand has it (3,) mm, its rotation vector (3,) rad, and whether
#: the hand has let go.
Moved = Callable[[str, Float, Float, bool], None]


class Gizmos:
    """In a viser server's scene. A gizmo that stays is moved and not made anew, so that one person
    keeps hold of it while another lets go."""

    def __init__(self, server: Any, size: float, moved: Moved) -> None:
        """For a body of a `size` mm."""
        self._scene, self._size, self._moved = server.scene, size, moved
        self._made: dict[tuple[str, bool, bool], Any] = {}
        self._turned: dict[str, Float] = {}  # rotation vectors, which count whole turns

    def place(self, grips: Sequence[Grip]) -> None:
        """These, and no others."""
        wanted = {(g.name, g.shifts, g.turns): g for g in grips if g.shifts or g.turns}
        for key in [key for key in self._made if key not in wanted]:
            self._made.pop(key).remove()
        for key, grip in wanted.items():
            self._turned[grip.name] = grip.rotation
            if key not in self._made:
                self._made[key] = self._add(grip)
            gizmo = self._made[key]
            gizmo.position, gizmo.wxyz = tuple(grip.position.tolist()), quaternion(grip.rotation)

    def _add(self, grip: Grip) -> Any:
        gizmo = self._scene.add_transform_controls(
            f"/grips/{grip.name}", scale=_SIZE * self._size, line_width=3.0, depth_test=False,
            disable_axes=not grip.shifts, disable_sliders=not grip.shifts,
            disable_rotations=not grip.turns, position=tuple(grip.position.tolist()),
            wxyz=quaternion(grip.rotation),
        )  # fmt: skip

        async def moved(event: Any) -> None:  # in their order, which threads would not keep
            if event.phase == "end":  # it is written: that takes a while
                await asyncio.to_thread(self._dragged, event, grip.name)
            else:
                self._dragged(event, grip.name)

        gizmo.on_update(moved)
        return gizmo

    def _dragged(self, event: Any, name: str) -> None:
        if event.client is None and event.client_id is None:  # set by the page itself
            return
        near = self._turned.get(name, np.zeros(3))
        rotation = rotation_vector(np.asarray(event.target.wxyz, float), near)
        self._turned[name] = rotation
        position = np.asarray(event.target.position, float)
        self._moved(name, position, rotation, event.phase == "end")


def quaternion(rotation: Float) -> tuple[float, float, float, float]:
    """w, x, y, z of a rotation vector (3,) rad."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation_matrices(rotation)).as_quat().tolist()
    return w, x, y, z


def rotation_vector(wxyz: Float, near: Float) -> Float:
    """Of a quaternion w, x, y, z, the vector (3,) rad that is nearest to another, so that a hand
    may turn on beyond half a turn."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    vector = Rotation.from_quat([x, y, z, w]).as_rotvec()
    angle = float(np.linalg.norm(vector))
    size = float(np.linalg.norm(near))
    if angle < 1e-9:
        if size < np.pi:
            return np.zeros(3)
        return np.asarray(near / size * 2 * np.pi * round(size / (2 * np.pi)))
    axis = vector / angle
    turns = round((float(near @ axis) - angle) / (2 * np.pi))
    return np.asarray(axis * (angle + 2 * np.pi * turns))


def tidy(rotation: Float) -> tuple[Float, float]:
    """Axis (3,) and degrees of a rotation vector as a person writes them: to a tenth of a degree,
    and about a coordinate axis where that is within a degree of it."""
    angle = float(np.linalg.norm(rotation))
    if angle < 1e-6:
        return np.array([0.0, 0.0, 1.0]), 0.0
    axis = rotation / angle
    main = int(np.abs(axis).argmax())
    degrees = round(float(np.rad2deg(angle)), 1)
    if abs(axis[main]) > np.cos(np.deg2rad(1.0)):
        return np.eye(3)[main], degrees * float(np.sign(axis[main]))
    return axis, degrees
