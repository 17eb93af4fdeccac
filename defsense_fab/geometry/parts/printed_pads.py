"""Make the solids of the pads in which printed traces end on the skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, format_point
from ...core.device.pads import PadSpec
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..channels.cord_channels import Channel
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from ..kernels.surface_queries import signed_distance_of

OUTSIDE_MM = 0.5  # by which solids reach out of the body before they are cut flush
#: Share of a pad's filament that must be in the body, which an edge nearby or a bend of the skin
#: reduces (assumed).
MIN_SHARE_IN_BODY = 0.8
MAX_BEND_MM = 0.3  # of the skin below a pad: three washers' tolerances of 0.1 mm (assumed)
_SIDES = 32


@dataclass(frozen=True)
class PlacedPad:
    """A pad at an end of a trace.

    Attributes:
        spec: The pad.
        axes: Axes (3, 3) in columns; the holes are along the first, the third points out.
        mouth: Middle (3,) of the pad on the skin, mm.
        trace: Name of the trace.
    """

    spec: PadSpec
    axes: Float
    mouth: Float
    trace: str

    @property
    def solid(self) -> Any:
        """The cylinder (manifold3d) without its holes, which reaches out of the body."""
        return self._place(_cylinder(self.spec.diameter, self.spec.depth))

    @property
    def holes(self) -> Any:
        """The holes and their tunnel (manifold3d), which reach out of the body."""
        spec = self.spec
        holes = [
            _cylinder(spec.hole_diameter, spec.hole_depth).translate([x, 0.0, 0.0])
            for x in spec.hole_offsets
        ]
        if len(holes) > 1:
            length = spec.hole_spacing
            tunnel = m3.Manifold.cube([length, spec.hole_diameter, spec.hole_diameter], True)
            middle = spec.hole_depth - spec.hole_diameter / 2
            holes.append(tunnel.translate([0.0, 0.0, -middle]))
        return self._place(triangle_kernel.union(holes))

    @property
    def axis(self) -> Float:
        """Points (n, 3) along the axis from the skin to the bottom, mm."""
        depths = np.linspace(0, self.spec.depth, int(self.spec.depth / 0.25) + 2)
        return np.asarray(self.mouth - depths[:, None] * self.axes[:, 2])

    def check(self, body: Any) -> None:
        """Check that the pad is in the body and not across an edge of it.

        Args:
            body: The body (manifold3d).

        Raises:
            FabricationError: Too much of the pad would be outside.
        """
        full = self._place(_cylinder(self.spec.diameter, self.spec.depth, outside=0.0))
        share = float((full ^ body).volume()) / float(full.volume())
        if share < MIN_SHARE_IN_BODY:
            raise FabricationError(
                f"has only {share:.0%} of its pad of {self.spec.diameter:g} mm, {self.spec.depth:g}"
                f" mm deep, in the body at {format_point(self.mouth)}",
                code="pad-outside",
                where=f"trace {self.trace!r}",
                action="Move that end away from the edge, or use smaller pads ([wires] pad)",
                trace=self.trace,
                share=share,
                at=self.mouth.tolist(),
            )

    def bend(self, body: Surface) -> float:
        """Return how far the skin is from flat at the edge of the pad or its fastener, mm."""
        angles = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
        circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(_SIDES)], axis=1)
        edge = self.mouth + self.spec.room / 2 * circle @ self.axes.T
        return float(signed_distance_of(body).unsigned(edge).max())

    def _place(self, solid: Any) -> Any:
        return triangle_kernel.from_plane_frame(solid, self.axes, self.mouth)


def place_pads(
    channels: Sequence[Channel], body: Surface, spec: PadSpec
) -> list[tuple[PlacedPad, PlacedPad]]:
    """Place the pads of each trace upright on the skin at its mouths.

    Args:
        channels: Lines of the traces.
        body: Surface of the body.
        spec: The pads.
    """
    distances, placed = signed_distance_of(body), []
    for channel in channels:
        mouths = np.array([end.mouth for end in channel.ends])
        normals = body.normals[distances.closest(mouths)[1]]
        first, last = (
            PlacedPad(spec, axes_from_normal(normal), mouth, channel.name)
            for mouth, normal in zip(mouths, normals, strict=True)
        )
        placed.append((first, last))
    return placed


def note_bends(
    pads: Sequence[tuple[PlacedPad, PlacedPad]], body: Surface
) -> dict[str, Float | None]:
    """Return a note with its place (3,) mm for each pad on which a washer does not lie flat.

    Args:
        pads: The pads of all traces.
        body: Surface of the body.
    """
    bends = [(pad, pad.bend(body)) for pair in pads for pad in pair]
    return {
        f"the skin bends by {bend:.1f} mm below the pad of {pad.trace} at"
        f" {format_point(pad.mouth)}. Name a flat region in [wires] exit": pad.mouth
        for pad, bend in bends
        if bend > MAX_BEND_MM
    }


def _cylinder(diameter: float, depth: float, outside: float = OUTSIDE_MM) -> Any:
    """Return a cylinder (manifold3d) from a depth below the skin, which is z = 0, to outside."""
    height, radius = depth + outside, diameter / 2
    return m3.Manifold.cylinder(height, radius, radius, _SIDES).translate([0.0, 0.0, -depth])
