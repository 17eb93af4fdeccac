"""Boundary conditions on the nodes of a mesh, and the way from one set of values to another."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import PointDrag


@dataclass(frozen=True)
class RigidHandle:
    """Nodes (k,) that move as one rigid piece, about `center` (3,) mm of the rest frame.

    `rotation` (3,) rad is the prescribed rotation vector, whose length may exceed a turn;
    `free_axes` (f, 3) are the axes about which the solver rotations it instead: none, one (a hinge) or
    all three. `translation` (3,) mm of the centre, NaN for each coordinate that the solver finds;
    once it has, the handle is moved on from there by `further` (3,) mm, NaN where it stays free.
    """

    nodes: Int
    center: Float
    rotation: Float
    translation: Float
    free_axes: Float = field(default_factory=lambda: np.zeros((0, 3)))
    name: str = ""
    further_translation: Float = field(default_factory=lambda: np.full(3, np.nan))


@dataclass(frozen=True)
class Slide:
    """Nodes (k,) that stay in the plane through their rest positions with unit `normal` (3,)."""

    nodes: Int
    normal: Float


@dataclass(frozen=True)
class Pressure:
    """MPa on boundary faces (t, 6) of node indices, corners then edges (0,1) (1,2) (2,0), outward.

    The load follows the deformed surface's normal; positive pushes inwards.
    """

    faces: Int
    value: float


@dataclass(frozen=True)
class BoundaryConditions:
    """`fixed` (k,) nodes stay; `gravity` (3,) is density times acceleration, N/mm^3."""

    fixed: Int
    handles: tuple[RigidHandle, ...] = ()
    slides: tuple[Slide, ...] = ()
    drags: tuple[PointDrag, ...] = ()
    pressures: tuple[Pressure, ...] = ()
    gravity: Float = field(default_factory=lambda: np.zeros(3))

    @property
    def structure(self) -> tuple[object, ...]:
        """Equal for conditions that differ in the amount of motion and load only."""
        return (
            self.fixed.tobytes(),
            tuple(
                (h.nodes.tobytes(), np.isnan(h.translation).tobytes(), h.free_axes.tobytes())
                for h in self.handles
            ),
            tuple((s.nodes.tobytes(), s.normal.tobytes()) for s in self.slides),
            tuple((d.at.tobytes(), d.stiffness) for d in self.drags),
            tuple(p.faces.tobytes() for p in self.pressures),
        )

    def at_rest(self) -> BoundaryConditions:
        """The same structure without any motion or load."""
        return interpolate_conditions(self, self, 0.0, scale=True)


def interpolate_conditions(
    a: BoundaryConditions, b: BoundaryConditions, s: float, scale: bool = False
) -> BoundaryConditions:
    """Linear from a (s = 0) to b (s = 1) in rotation vectors, translations and loads.

    Rotation vectors do not wrap: 270 degrees stay 270. With `scale`, s b regardless of a.
    """

    def mix(x: Float, y: Float) -> Float:
        return s * y if scale else x + s * (y - x)

    def mixed(x: float, y: float) -> float:
        return s * y if scale else x + s * (y - x)

    return replace(
        b,
        handles=tuple(
            replace(
                q,
                rotation=mix(p.rotation, q.rotation),
                translation=mix(p.translation, q.translation),
                further_translation=mix(p.further_translation, q.further_translation),
            )
            for p, q in zip(a.handles, b.handles, strict=True)
        ),
        drags=tuple(replace(q, by=mix(p.by, q.by)) for p, q in zip(a.drags, b.drags, strict=True)),
        pressures=tuple(
            replace(q, value=mixed(p.value, q.value))
            for p, q in zip(a.pressures, b.pressures, strict=True)
        ),
        gravity=mix(a.gravity, b.gravity),
    )


@dataclass(frozen=True)
class State:
    """A configuration of the body: displacements `u` (n, 3) mm, and of each handle its rotation
    `rotations` (h, 3, 3) and its centre's translation `translations` (h, 3) mm, under `conditions`."""

    u: Float
    rotations: Float
    translations: Float
    conditions: BoundaryConditions


def continue_handles(state: State) -> tuple[State, BoundaryConditions] | None:
    """An equilibrium whose handles are to be moved on from where they came to lie: the same with
    them prescribed there, and the conditions to go on to; None where none is."""
    handles = state.conditions.handles
    if not any(np.nan_to_num(h.further_translation).any() for h in handles):
        return None
    held = [
        replace(
            h,
            translation=np.where(np.isnan(h.further_translation), h.translation, shift),
            further_translation=np.full(3, np.nan),
        )
        for h, shift in zip(handles, state.translations, strict=True)
    ]
    further = [
        replace(h, translation=h.translation + np.nan_to_num(f.further_translation))
        for h, f in zip(held, handles, strict=True)
    ]
    return (
        replace(state, conditions=replace(state.conditions, handles=tuple(held))),
        replace(state.conditions, handles=tuple(further)),
    )


def rest_state(conditions: BoundaryConditions, nodes: int) -> State:
    """The undeformed state of a mesh of `nodes` nodes."""
    count = len(conditions.handles)
    return State(
        np.zeros((nodes, 3)),
        np.broadcast_to(np.eye(3), (count, 3, 3)).copy(),
        np.zeros((count, 3)),
        conditions.at_rest(),
    )


def rotation_matrix(vector: Float) -> Float:
    """Rodrigues' formula: rotation vectors (..., 3) rad to matrices (..., 3, 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    k = k.reshape(*vector.shape[:-1], 3, 3)
    half = np.sinc(angle / (2 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * half**2 * k @ k)
