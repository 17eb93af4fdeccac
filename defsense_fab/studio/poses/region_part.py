"""Regions of the body: made by a rectangle, moved by a gizmo, told what is wrong with them."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere
from ...core.errors import DeviceError
from ...optimize.prediction.region_points import find_region_problems, fit_box, points_in_regions
from ...runtime.view.camera import View, in_rectangle
from ..edits.edit import free_name
from ..edits.poses import remove_region, rename_region, set_box, shift_region
from .gizmos import Grip, middle, shifted
from .poses_scene import PosesScene, region_color

NONE = "none"
NEW, REFIT = "makes a region", "fits the chosen region"
_NO_BODY = "Mesh the body first: regions hold points of its surface."
_EDGE = (120, 120, 130)
_KINDS = {Box: "box", Sphere: "sphere", HalfSpace: "half space", Cylinder: "cylinder"}
_HOW = (
    "Hold **Shift** and drag a rectangle over the body: it takes all points of the surface within"
    " it, those behind others too, and a box is fitted to them."
)


class RegionPart:
    """In the panel of the mode."""

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self.chosen: str | None = None
        self._filling = False  # the page sets values, no person does
        self._grip: Float | None = None  # where the gizmo was before a hand took it
        self._outline: Any = None

    def add_panel(self) -> None:
        """Its buttons and words, in the folder that is open."""
        gui, button = self._bench.server.gui, self._bench.button
        self.words = gui.add_markdown("")
        gui.add_markdown(_HOW)
        self._does = gui.add_dropdown("Rectangle", (NEW, REFIT), hint="What Shift and drag does")
        self._list = gui.add_dropdown("Region", (NONE,), hint="It can be moved by its gizmo")
        self._list.on_update(lambda event: self._listed(event))
        self._name = gui.add_text("Name", "", hint="Letters and digits; poses keep to it")
        self._bench.button_row("Region", {
            "Rename": self.rename, "Delete": self.delete,
        }, "Poses follow its name; one that a pose needs stays")  # fmt: skip
        self._low = gui.add_vector3("Low corner", (0, 0, 0), step=0.5, hint="mm, at rest")
        self._high = gui.add_vector3("High corner", (1, 1, 1), step=0.5, hint="mm, at rest")
        for corner in (self._low, self._high):
            corner.on_update(lambda event: self._typed(event))
        self._box = button("Make it a box", "About the points that it holds", self.make_box)

    def redraw(self, shown: bool) -> None:
        """As the device is now; with its gizmo where the part is `shown`."""
        regions = self._bench.project.device.regions
        if self.chosen not in regions:
            self.chosen = None
        shape = None if self.chosen is None else regions[self.chosen]
        self._filling = True
        self._list.options = (NONE, *regions)
        self._list.value = self.chosen or NONE
        self._name.value = self.chosen or ""
        for corner, at in ((self._low, 0), (self._high, 1)):
            corner.visible = isinstance(shape, Box)
            if isinstance(shape, Box):
                corner.value = tuple((shape.low, shape.high)[at].tolist())
        self._box.visible = shape is not None and not isinstance(shape, Box)
        self._filling = False
        self._tell(dict(regions))
        self._draw(shape if shown else None)
        if shown:
            self._scene.rest()
            self._place_grip(shape)

    def choose(self, name: str | None) -> None:
        """Put a gizmo on a region."""
        self.chosen = name
        self.redraw(True)

    def selected(self, event: Any) -> None:
        """A rectangle was drawn on the picture of a browser."""
        low, high = np.asarray(event.screen_min), np.asarray(event.screen_max)
        self.select(View.of(event.client.camera), low, high)

    def select(self, view: View, low: Float, high: Float) -> None:
        """A box about what a rectangle from `low` to `high` (2,) of a picture has of the body."""
        if self._scene.body is None:
            self._bench.show_message(_NO_BODY, "not-meshed")
            return
        points = self._scene.points
        inside = in_rectangle(self._scene.body.vertices, view, low, high)
        if not inside.any():
            self._bench.show_message(
                "The rectangle contains no point of the surface. Draw it over the body.",
                "rectangle-empty",
            )
            return
        box = fit_box(points[inside], self._scene.size)
        regions = self._bench.project.device.regions
        refit = self._does.value == REFIT and self.chosen is not None
        name = self.chosen if refit and self.chosen else free_name("region", regions)
        self.chosen = name
        if self._bench.apply(set_box(name, box.low, box.high)):
            more = int((box.contains(points) & ~inside).sum())
            beside = f", {more} of them beside the rectangle" if more else ""
            count = int(box.contains(points).sum())
            self._bench.show_message(f"`{name}` holds {count} points of the surface{beside}.")

    def moved(self, _: str, position: Float, __: Float, ended: bool) -> None:
        """A hand has the chosen region's gizmo."""
        regions = dict(self._bench.project.device.regions)
        if self.chosen not in regions or self._grip is None:
            return
        by = np.round(position - self._grip, 1)
        if not ended:
            regions[self.chosen] = shifted(regions[self.chosen], by)
            self._tell(regions)
            self._draw(regions[self.chosen])
            if self._scene.body is not None:
                self._scene.body.show_regions(points_in_regions(regions, self._scene.points))
        elif not by.any() or not self._bench.apply(shift_region(self.chosen, by)):
            self._scene.color_regions()
            self.redraw(True)

    def rename(self) -> None:
        """The chosen region, to what is written in the field."""
        name = self._name.value.strip()
        if self.chosen is None:
            self._bench.show_message("Choose a region first.", "no-region-chosen")
        elif not name.replace("_", "").replace("-", "").isalnum():
            self._bench.show_message("Give the region a name of letters, digits, - and _.")
        elif name != self.chosen:
            before, self.chosen = self.chosen, name
            if not self._bench.apply(rename_region(before, name)):
                self.chosen = before

    def delete(self) -> None:
        """The chosen region."""
        if self.chosen is None:
            self._bench.show_message("Choose a region first.", "no-region-chosen")
        else:
            self._bench.apply(remove_region(self.chosen))

    def make_box(self) -> None:
        """The chosen region, whatever its shape, as a box about its points."""
        if self.chosen is None or self._scene.body is None:
            self._bench.show_message(
                _NO_BODY if self._scene.body is None else "Choose a region first.",
                "no-region-chosen",
            )
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
        """The chosen region as a box between two corners (3,) mm."""
        if self.chosen is not None and not self._bench.apply(set_box(self.chosen, low, high)):
            self.redraw(True)

    def _typed(self, event: Any) -> None:
        if event.client is None or self._filling:
            return
        self.set_corners(np.asarray(self._low.value, float), np.asarray(self._high.value, float))

    def _listed(self, event: Any) -> None:
        if event.client is None or self._filling:
            return
        with self._bench.drawing_lock:
            self.choose(None if self._list.value == NONE else self._list.value)

    def _tell(self, regions: dict[str, Shape]) -> None:
        if self._scene.body is None:
            self.words.content = _NO_BODY
            return
        held = points_in_regions(regions, self._scene.points)
        problems = find_region_problems(held)
        lines = []
        for k, (name, shape) in enumerate(regions.items()):
            color = "#{:02x}{:02x}{:02x}".format(*region_color(k))
            lines.append(
                f"- `{color}` **{name}**: {int(held[name].sum())} points, {_KINDS[type(shape)]}"
            )
        lines += [
            "",
            *(f"**{told}**\n" for told in dict.fromkeys(chain.from_iterable(problems.values()))),
        ]
        self.words.content = "\n".join(lines) if regions else "There is no region yet."

    def _draw(self, shape: Shape | None) -> None:
        """The edges of a box."""
        if self._outline is not None:
            self._outline.remove()
            self._outline = None
        if isinstance(shape, Box) and self._scene.body is not None:
            self._outline = self._bench.server.scene.add_box(
                "/poses/box", color=_EDGE, wireframe=True,
                dimensions=tuple((shape.high - shape.low).tolist()),
                position=tuple(((shape.low + shape.high) / 2).tolist()),
            )  # fmt: skip

    def _place_grip(self, shape: Shape | None) -> None:
        if shape is None or self._scene.body is None or self.chosen is None:
            self._scene.grips(())
            return
        inside = shape.contains(self._scene.points)
        self._grip = middle(shape, self._scene.points[inside])
        self._scene.grips([Grip("region", self._grip, np.zeros(3), shifts=True, turns=False)])
