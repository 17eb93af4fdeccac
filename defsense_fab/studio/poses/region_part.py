"""The regions of the body: add one by a rectangle, and move it by a gizmo or its corners."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere
from ...core.errors import DeviceError
from ...workflow.design.region_points import (
    RegionProblem,
    find_region_problems,
    fit_box,
    points_in_regions,
)
from ...workflow.view import View, in_rectangle
from ..edits.edit import free_name
from ..edits.poses import remove_region, rename_region, set_box, shift_region
from ..workbench.controls import NONE, on_user
from .grips import Grip, shape_center, shift_shape
from .poses_scene import PosesScene, region_color

_ADDS, _REFITS = "adds a region", "replaces the chosen region"
_NOT_MESHED = "Mesh the body first. Regions hold points of its surface."
_BOX_COLOR = (120, 120, 130)
_SHAPE_NAMES = {Box: "box", Sphere: "sphere", HalfSpace: "half space", Cylinder: "cylinder"}
_INSTRUCTIONS = (
    "Hold **Shift** and drag a rectangle over the body. A box is fitted to all points of the"
    " surface in the rectangle, including those on the far side."
)


class RegionPart:
    """The controls of the chosen region.

    Args:
        scene: The body and its gizmos.

    Attributes:
        chosen: Name of the chosen region, or None.
        problems: Problems of the shown regions, each once.
        grip_position: Position (3,) mm of the gizmo before the current drag, or None.
    """

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self.chosen: str | None = None
        self.problems: tuple[RegionProblem, ...] = ()
        self.grip_position: Float | None = None
        self._outline: Any = None

    @property
    def new_name(self) -> str:
        """The name in the field, which `rename` gives to the chosen region."""
        return str(self._name.value).strip()

    @new_name.setter
    def new_name(self, name: str) -> None:
        self._name.value = name

    @property
    def corners(self) -> tuple[Float, Float]:
        """The shown corners (3,) mm of the chosen box."""
        return np.asarray(self._low.value, float), np.asarray(self._high.value, float)

    @property
    def replaces_chosen(self) -> bool:
        """Whether a rectangle replaces the chosen region; otherwise it adds one."""
        return bool(self._rectangle.value == _REFITS)

    @replaces_chosen.setter
    def replaces_chosen(self, value: bool) -> None:
        self._rectangle.value = _REFITS if value else _ADDS

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, button = self._bench.server.gui, self._bench.button
        self._text = gui.add_markdown("")
        gui.add_markdown(_INSTRUCTIONS)
        self._rectangle = gui.add_dropdown(
            "Rectangle", (_ADDS, _REFITS), hint="Choose what a rectangle does"
        )
        self._list = gui.add_dropdown("Region", (NONE,), hint="Choose the region with a gizmo")
        on_user(self._list, self._choose_from_list)
        self._name = gui.add_text("Name", "", hint="Name the region. Poses follow the name")
        actions = {"Rename": self.rename, "Delete": self.delete}
        self._bench.button_row(
            "Region", actions, "Rename or delete the chosen region, unless a pose uses it"
        )
        self._low = gui.add_vector3(
            "Low corner (mm)", (0, 0, 0), step=0.5, hint="Set the lowest x, y and z, at rest"
        )
        self._high = gui.add_vector3(
            "High corner (mm)", (1, 1, 1), step=0.5, hint="Set the highest x, y and z, at rest"
        )
        for corner in (self._low, self._high):
            on_user(corner, lambda _: self.set_corners(*self.corners))
        self._convert = button(
            "Convert to a box", "Fit a box to the points in the region", self.convert_to_box
        )

    def redraw(self, is_shown: bool) -> None:
        """Show the device's regions, and a gizmo on the chosen one if the part is shown."""
        regions = self._bench.project.device.regions
        if self.chosen not in regions:
            self.chosen = None
        shape = None if self.chosen is None else regions[self.chosen]
        self._list.options = (NONE, *regions)
        self._list.value = self.chosen or NONE
        self._name.value = self.chosen or ""
        for corner in (self._low, self._high):
            corner.visible = isinstance(shape, Box)
        if isinstance(shape, Box):
            self._low.value = tuple(shape.low.tolist())
            self._high.value = tuple(shape.high.tolist())
        self._convert.visible = shape is not None and not isinstance(shape, Box)
        self._describe(dict(regions))
        self._draw_box(shape if is_shown else None)
        if is_shown:
            self._scene.show_rest()
            self._show_grip(shape)

    def choose(self, name: str | None) -> None:
        """Put the gizmo on a region."""
        self.chosen = name
        self.redraw(True)

    def follow_rectangle(self, event: Any) -> None:
        """Fit a region to a rectangle that the user has drawn in a browser."""
        low, high = np.asarray(event.screen_min), np.asarray(event.screen_max)
        self.select(View.of(event.client.camera), low, high)

    def select(self, view: View, low: Float, high: Float) -> None:
        """Fit a box to the surface points in a rectangle, as a new region or the chosen one.

        Args:
            view: The camera.
            low: Lower corner (2,) of the rectangle, as shares of the picture.
            high: Upper corner (2,).
        """
        if self._scene.body is None:
            self._bench.status.show(_NOT_MESHED, "not-meshed")
            return
        points = self._scene.points
        inside = in_rectangle(self._scene.body.vertices, view, low, high)
        if not inside.any():
            self._bench.status.show(
                "The rectangle contains no point of the surface. Draw it over the body.",
                "rectangle-empty",
            )
            return
        box = fit_box(points[inside], self._scene.size)
        name = self.chosen if self.replaces_chosen else None
        if name is None:
            name = free_name("region", self._bench.project.device.regions)
        self.chosen = name
        if self._bench.apply(set_box(name, box.low, box.high)):
            in_box = box.contains(points)
            outside = int((in_box & ~inside).sum())
            note = f", {outside} of them outside the rectangle" if outside else ""
            self._bench.status.show(
                f"`{name}` holds {int(in_box.sum())} points of the surface{note}.", "region-set"
            )

    def follow_grip(self, _: str, position: Float, __: Float, has_ended: bool) -> None:
        """Move the chosen region with its gizmo; write it once the user releases the gizmo.

        Args:
            position: Position (3,) mm of the gizmo.
            has_ended: Whether the user has released it.
        """
        regions = dict(self._bench.project.device.regions)
        if self.chosen not in regions or self.grip_position is None:
            return
        shift = np.round(position - self.grip_position, 1)
        if not has_ended:
            regions[self.chosen] = shift_shape(regions[self.chosen], shift)
            self._describe(regions)
            self._draw_box(regions[self.chosen])
            if self._scene.body is not None:
                self._scene.body.show_regions(points_in_regions(regions, self._scene.points))
        elif not shift.any() or not self._bench.apply(shift_region(self.chosen, shift)):
            self._scene.color_regions()
            self.redraw(True)

    def rename(self) -> None:
        """Rename the chosen region to the name in the field."""
        name = self.new_name
        if self.chosen is None:
            self._show_no_region()
        elif not name.replace("_", "").replace("-", "").isalnum():
            self._bench.status.show(
                "Name the region with letters, digits, - and _ only.", "name-invalid"
            )
        elif name != self.chosen:
            before, self.chosen = self.chosen, name
            if not self._bench.apply(rename_region(before, name)):
                self.chosen = before

    def delete(self) -> None:
        """Delete the chosen region."""
        if self.chosen is None:
            self._show_no_region()
        else:
            self._bench.apply(remove_region(self.chosen))

    def convert_to_box(self) -> None:
        """Replace the chosen region by a box around its points.

        Raises:
            DeviceError: The region holds no point of the surface.
        """
        if self._scene.body is None:
            self._bench.status.show(_NOT_MESHED, "not-meshed")
            return
        if self.chosen is None:
            self._show_no_region()
            return
        points = self._scene.points
        inside = self._bench.project.device.regions[self.chosen].contains(points)
        if not inside.any():
            raise DeviceError(
                "holds no surface point to fit a box to",
                code="region-empty",
                where=f"region `{self.chosen}`",
                action="Move it",
            )
        box = fit_box(points[inside], self._scene.size)
        self._bench.apply(set_box(self.chosen, box.low, box.high))

    def set_corners(self, low: Float, high: Float) -> None:
        """Set the chosen region to the box between two corners (3,) mm."""
        if self.chosen is not None and not self._bench.apply(set_box(self.chosen, low, high)):
            self.redraw(True)

    def _choose_from_list(self, name: str) -> None:
        with self._bench.drawing_lock:
            self.choose(None if name == NONE else name)

    def _show_no_region(self) -> None:
        self._bench.status.show("Choose a region first.", "no-region-chosen")

    def _describe(self, regions: dict[str, Shape]) -> None:
        """List regions with their colors, numbers of points, and problems."""
        if self._scene.body is None:
            self.problems, self._text.content = (), _NOT_MESHED
            return
        points = points_in_regions(regions, self._scene.points)
        problems = find_region_problems(points)
        self.problems = tuple(dict.fromkeys(chain.from_iterable(problems.values())))
        lines = []
        for k, (name, shape) in enumerate(regions.items()):
            color = "#{:02x}{:02x}{:02x}".format(*region_color(k))
            count, kind = int(points[name].sum()), _SHAPE_NAMES[type(shape)]
            lines.append(f"- `{color}` **{name}**: {count} points, {kind}")
        lines += ["", *(f"**{problem}**\n" for problem in self.problems)]
        self._text.content = "\n".join(lines) if regions else "There is no region yet."

    def _draw_box(self, shape: Shape | None) -> None:
        """Draw the edges of a box, or nothing for other shapes."""
        if self._outline is not None:
            self._outline.remove()
            self._outline = None
        if isinstance(shape, Box) and self._scene.body is not None:
            self._outline = self._bench.server.scene.add_box(
                "/poses/box",
                color=_BOX_COLOR,
                wireframe=True,
                dimensions=tuple((shape.high - shape.low).tolist()),
                position=tuple(((shape.low + shape.high) / 2).tolist()),
            )

    def _show_grip(self, shape: Shape | None) -> None:
        if shape is None or self._scene.body is None or self.chosen is None:
            self._scene.show_grips(())
            return
        inside = shape.contains(self._scene.points)
        self.grip_position = shape_center(shape, self._scene.points[inside])
        grip = Grip("region", self.grip_position, np.zeros(3), can_shift=True, can_turn=False)
        self._scene.show_grips([grip])
