"""Describe boundary conditions on a mesh, states of the body, and paths between conditions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.device import PointDrag
from .fibers import Fibers


@dataclass(frozen=True)
class RigidHandle:
    """A set of nodes that moves as one rigid piece.

    Attributes:
        nodes: (k,) node numbers.
        center: (3,) mm, the point of the rest frame that the piece turns about.
        rotation: (3,) rad, prescribed rotation vector; its length may exceed a full turn.
        translation: (3,) mm, prescribed translation of the center, NaN for each coordinate that
            the solver finds.
        free_axes: (f, 3) unit axes about which the solver finds the rotation: none, one (a hinge)
            or all three.
        name: Name of the region, for messages.
        further_translation: (3,) mm, added to the equilibrium position of free coordinates in a
            second solve; NaN where the coordinate stays free.
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
    """Nodes that stay in the plane through their rest positions.

    Attributes:
        nodes: (k,) node numbers.
        normal: (3,) unit normal of the plane.
    """

    nodes: Int
    normal: Float


@dataclass(frozen=True)
class Pressure:
    """A pressure that follows the normal of the deformed surface.

    Attributes:
        faces: (t, 6) node numbers of outward boundary faces: corners, then edges (0,1) (1,2) (2,0).
        value: MPa; positive pushes inwards.
    """

    faces: Int
    value: float


@dataclass(frozen=True)
class BoundaryConditions:
    """All constraints and loads on the nodes of a mesh.

    Attributes:
        fixed: (k,) numbers of the nodes that do not move.
        handles: Rigid pieces with prescribed or free motion.
        slides: Nodes that slide in planes.
        drags: Points that springs pull.
        pressures: Pressures on the surface.
        gravity: (3,) N/mm^3, density times acceleration.
        fibers: Stiff lines in the body, such as printed traces; None if there are none.
    """

    fixed: Int
    handles: tuple[RigidHandle, ...] = ()
    slides: tuple[Slide, ...] = ()
    drags: tuple[PointDrag, ...] = ()
    pressures: tuple[Pressure, ...] = ()
    gravity: Float = field(default_factory=lambda: np.zeros(3))
    fibers: Fibers | None = None

    @property
    def structure(self) -> tuple[object, ...]:
        """Key that is equal for conditions that differ only in the amount of motion and load."""
        return (
            self.fixed.tobytes(),
            tuple(
                (h.nodes.tobytes(), np.isnan(h.translation).tobytes(), h.free_axes.tobytes())
                for h in self.handles
            ),
            tuple((s.nodes.tobytes(), s.normal.tobytes()) for s in self.slides),
            tuple((d.at.tobytes(), d.stiffness) for d in self.drags),
            tuple(p.faces.tobytes() for p in self.pressures),
            None if self.fibers is None else self.fibers.structure,
        )

    def at_rest(self) -> BoundaryConditions:
        """Return conditions of the same structure without any motion or load."""
        return interpolate_conditions(self, self, 0.0, scale=True)


def interpolate_conditions(
    a: BoundaryConditions, b: BoundaryConditions, s: float, scale: bool = False
) -> BoundaryConditions:
    """Interpolate rotation vectors, translations and loads linearly.

    Rotation vectors do not wrap: 270 degrees stay 270.

    Args:
        a: Conditions at s = 0.
        b: Conditions at s = 1, of the same structure.
        s: Share of the way.
        scale: Return b scaled by s, whatever a is.
    """

    def blend(x: Float, y: Float) -> Float:
        return s * y if scale else x + s * (y - x)

    def blend_value(x: float, y: float) -> float:
        return s * y if scale else x + s * (y - x)

    return replace(
        b,
        handles=tuple(
            replace(
                q,
                rotation=blend(p.rotation, q.rotation),
                translation=blend(p.translation, q.translation),
                further_translation=blend(p.further_translation, q.further_translation),
            )
            for p, q in zip(a.handles, b.handles, strict=True)
        ),
        drags=tuple(
            replace(q, by=blend(p.by, q.by)) for p, q in zip(a.drags, b.drags, strict=True)
        ),
        pressures=tuple(
            replace(q, value=blend_value(p.value, q.value))
            for p, q in zip(a.pressures, b.pressures, strict=True)
        ),
        gravity=blend(a.gravity, b.gravity),
    )


@dataclass(frozen=True)
class State:
    """A configuration of the body.

    Attributes:
        u: (n, 3) mm, displacements of the nodes.
        rotations: (h, 3, 3), rotation matrix of each handle.
        translations: (h, 3) mm, translation of each handle's center.
        conditions: The boundary conditions that the prescribed parts satisfy.
    """

    u: Float
    rotations: Float
    translations: Float
    conditions: BoundaryConditions


def continue_handles(state: State) -> tuple[State, BoundaryConditions] | None:
    """Prepare the further translation of handles whose position the solver has found.

    Args:
        state: An equilibrium.

    Returns:
        The equilibrium with those handles prescribed where they are, and the conditions with the
        further translation added; None if no handle has one.
    """
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
    """Return the undeformed state of a mesh of `nodes` nodes."""
    count = len(conditions.handles)
    return State(
        np.zeros((nodes, 3)),
        np.broadcast_to(np.eye(3), (count, 3, 3)).copy(),
        np.zeros((count, 3)),
        conditions.at_rest(),
    )
