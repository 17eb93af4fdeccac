"""Draw the pictures of the steps in which parts are joined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...core.device.device import Device
from ...core.mesh import Surface
from ...store.layout import LayoutRecord
from ...store.manifest import END_NAMES, CordEnd, CutCord, Manifest, part_label
from ..pictures import views
from ..pictures.sheet import COLORS
from ..pictures.views import View
from .actions import Action, ActionKind
from .drawing import Drawing
from .instructions import cord_label, pulled_reach, pulled_strain
from .plan import joint_of_end
from .steps import GuideStep, Illustration, Joint, Passage
from .templates import CordLine, cord_line, glueless_lines

_CORD_COLOR, _WIRE_COLOR, _FERRULE_COLOR = "#161616", "#7b2cbf", "#c9a227"
_THICK_PIN_COLOR, _MIDDLE_PIN_COLOR, _THIN_PIN_COLOR = "#e76f51", "#f4d35e", "#3a86ff"
_GLUE_COLOR, _GLUELESS_COLOR, _ARROW_COLOR = "#2a9d3a", "#e00000", "#f77f00"
_RED_LINE_RADIUS_MM = 0.5
_LOOSE_LENGTH_MM = 24.0  # of cords and wires that hang out of the parts
_END_VIEW_RADIUS_MM = 55.0  # around a pulled end
_MAX_UPWARD_SHARE = 0.8  # of an end's direction, above which it is drawn as upright


@dataclass(frozen=True)
class JointPictures:
    """Draws the pictures of one device's steps.

    Attributes:
        device: The device.
        layout: Layout of its cords.
        manifest: The manifest of its parts.
        parts: Surfaces of its parts, by name.
    """

    device: Device
    layout: LayoutRecord
    manifest: Manifest
    parts: Mapping[str, Surface]

    def draw(self, step: GuideStep, passage: Passage) -> str | None:
        """Draw the picture of a passage; return a PNG data URI, or None if it has no picture."""
        if passage.illustration is Illustration.END:
            return self._draw_pulled_ends(passage)
        if step.joint is None:
            return None
        if passage.illustration is Illustration.PINS:
            return self._draw_pins(step.joint) if step.joint.pins else None
        if passage.illustration is Illustration.LAY:
            return self._draw_insertion(step.joint, passage)
        if passage.illustration is Illustration.CLOSE:
            return self._draw_closing(step.joint)
        return None

    def _draw_pins(self, joint: Joint) -> str:
        """Draw the pins above their sockets in the lower parts, colored by diameter."""
        drawing = Drawing(self._face_view(joint, 0.7))
        self._add_parts(drawing, joint.lower)
        for name in joint.lower:
            drawing.label(name, part_label(name))
        kinds = {p.name: p for p in self.manifest.pins}
        colors = self._pin_colors(joint)
        for letter, pin in zip(joint.letters, joint.pins, strict=True):
            kind = kinds[pin.name]
            middle = pin.center + (0.75 * kind.length + 7.0) * joint.opens
            color = colors[kind.diameter]
            drawing.cylinder(middle, joint.opens, kind.diameter / 2, kind.length, color)
            foot = middle - kind.length / 2 * joint.opens
            drawing.arrow(foot, pin.center, _ARROW_COLOR)
            drawing.label(middle, f"{letter}: {kind.diameter:g} mm thick")
        for diameter, color in sorted(colors.items(), reverse=True):
            drawing.legend[f"pin, {diameter:g} mm thick"] = color
        return drawing.png()

    def _draw_insertion(self, joint: Joint, passage: Passage) -> str:
        """Draw the face of the lower parts with the cords and wires that are inserted into it."""
        drawing = Drawing(self._face_view(joint, 0.35))
        self._add_parts(drawing, joint.lower)
        self._add_inserted_pins(drawing, joint)
        for name in dict.fromkeys(a.cord for a, _ in passage.actions if a.cord):
            cord = self._cord(name)
            for k, stretch in enumerate(cord.stretches):
                if stretch.joint == joint.index:
                    self._add_stretch(drawing, cord, k, joint)
        for action, _ in passage.actions:
            if action.kind is ActionKind.STRETCH:
                self._mark_stretching(drawing, action, joint)
            if action.kind is ActionKind.GLUE_END and action.end is not None:
                self._mark_glue(drawing, self._cord(action.cord), action.end, joint)
        self._add_routed_wires(drawing, passage)
        self._add_passing_cords(drawing, joint)
        drawing.legend |= {"cord": _CORD_COLOR}
        return drawing.png()

    def _draw_closing(self, joint: Joint) -> str:
        """Draw the upper parts above the lower ones, with arrows along which they close."""
        short = np.cross(joint.opens, joint.across)
        view = views.looking(0.62 * -short + 0.5 * joint.opens + 0.15 * joint.across, joint.opens)
        drawing = Drawing(view)
        self._add_parts(drawing, joint.lower)
        self._add_parts(drawing, joint.upper, joint.lift * joint.opens)
        self._add_inserted_pins(drawing, joint)
        for name in joint.cords:
            cord = self._cord(name)
            for stretch in cord.stretches:
                if stretch.joint == joint.index:
                    points = self._line(cord).along(stretch.start, stretch.stop)
                    drawing.rod(points, self.device.cord.diameter / 2, _CORD_COLOR)
                    drawing.legend["cord"] = _CORD_COLOR
        for wire in joint.wires:
            self._add_wire(drawing, wire)
        self._mark_glueless(drawing, joint)
        self._add_passing_cords(drawing, joint, has_labels=False)
        for name in (*joint.lower, *joint.upper):
            drawing.label(name, part_label(name))
        self._add_closing_arrows(drawing, joint, view)
        return drawing.png()

    def _draw_pulled_ends(self, passage: Passage) -> str | None:
        """Draw the ends that are pulled out of their mouths to be crimped."""
        pulls = [a for a, _ in passage.actions if a.kind is ActionKind.PULL]
        if not pulls:
            return None
        directions = [self._line(self._cord(a.cord)).way_out(a.end or 0) for a in pulls]
        view = _view_from_aside(directions[0])
        center = self._cord(pulls[0].cord).ends[pulls[0].end or 0].at
        drawing = Drawing(view, (center, _END_VIEW_RADIUS_MM))
        self._add_parts(drawing, list(self.parts))
        for action, out in zip(pulls, directions, strict=True):
            cord, end = self._cord(action.cord), action.end or 0
            mouth, reach = cord.ends[end].at, pulled_reach(self.device, cord, end)
            middle = mouth + reach * out
            line = np.stack([mouth - 2 * out, middle])
            drawing.rod(line, self.device.cord.diameter / 2, _CORD_COLOR)
            self._add_ferrule(drawing, middle, out)
            self._add_wire(drawing, np.stack([middle, middle + _LOOSE_LENGTH_MM * out]))
            arrow_start = mouth + 5 * view.up + 2 * out
            drawing.arrow(arrow_start, arrow_start + (reach + 14) * out, _ARROW_COLOR)
            drawing.label(
                middle,
                f"pull the {END_NAMES[end]} of {cord_label(cord.sensor)}: mark {reach:.0f} mm out,"
                f" stretched by {pulled_strain(self.device, cord, end):.0%}",
            )
        drawing.legend = {"cord": _CORD_COLOR, **drawing.legend}
        return drawing.png()

    def _face_view(self, joint: Joint, tilt: float) -> View:
        """Return a view of the lower parts' face, its longest side across, tilted from upright."""
        short = np.cross(joint.opens, joint.across)
        return views.looking(joint.opens - tilt * short, short + joint.opens * 0.01)

    def _cord(self, name: str | None) -> CutCord:
        return next(c for c in self.manifest.cords if c.sensor == name)

    def _line(self, cord: CutCord) -> CordLine:
        return cord_line(self.layout, cord)

    def _vertices(self, names: Sequence[str]) -> Float:
        return np.concatenate([self.parts[n].vertices for n in names])

    def _add_parts(
        self, drawing: Drawing, names: Sequence[str], shift: Float | None = None
    ) -> None:
        order = list(self.parts)
        for name in names:
            color = COLORS[order.index(name) % len(COLORS)]
            drawing.part(self.parts[name], color, shift, name)

    def _pin_colors(self, joint: Joint) -> dict[float, str]:
        """Return a color for each diameter of the joint's pins."""
        kinds = {p.name: p.diameter for p in self.manifest.pins}
        diameters = sorted({kinds[p.name] for p in joint.pins})
        if not diameters:
            return {}
        if len(diameters) == 1:
            return {diameters[0]: _THICK_PIN_COLOR}
        middle = dict.fromkeys(diameters[1:-1], _MIDDLE_PIN_COLOR)
        return {diameters[0]: _THIN_PIN_COLOR, **middle, diameters[-1]: _THICK_PIN_COLOR}

    def _add_inserted_pins(self, drawing: Drawing, joint: Joint) -> None:
        kinds, colors = {p.name: p for p in self.manifest.pins}, self._pin_colors(joint)
        for pin in joint.pins:
            kind = kinds[pin.name]
            color = colors[kind.diameter]
            drawing.cylinder(pin.center, joint.opens, kind.diameter / 2, kind.length, color)

    def _add_stretch(self, drawing: Drawing, cord: CutCord, k: int, joint: Joint) -> None:
        """Add stretch `k` of a cord in its groove, with its ends and the loose cord beyond it."""
        line, radius = self._line(cord), self.device.cord.diameter / 2
        stretch, label = cord.stretches[k], cord_label(cord.sensor)
        start, stop = stretch.start, stretch.stop
        ends_here = line.ends_in(stretch)
        for end in ends_here:
            record = cord.ends[end]
            if record.joint == "pocket" and record.after is None:
                depth = record.pocket - self.device.cord.ferrule_length / 2
                total = float(arc_lengths(line.points)[-1])
                start, stop = (depth, stop) if end == 0 else (start, min(stop, total) - depth)
            middle = self._add_end(drawing, line, end, record)
            bare = ", no ferrule yet" if record.after is not None else ""
            drawing.label(middle, f"{END_NAMES[end]} of {label}{bare}")
        points = line.along(start, stop)
        drawing.rod(points, radius, _CORD_COLOR)
        for end in (0, 1):
            if end in ends_here:
                continue
            at, inner = (points[0], points[1]) if end == 0 else (points[-1], points[-2])
            outward = (at - inner) / np.linalg.norm(at - inner)
            drawing.rod(np.stack([at, at + _LOOSE_LENGTH_MM * outward]), radius, _CORD_COLOR)
            drawing.label(at + 0.7 * _LOOSE_LENGTH_MM * outward, f"rest of {label}")
        middle = points[len(points) // 2]
        above = 0.85 * drawing.view.up + 0.5 * joint.opens
        drawing.arrow(middle + 20.0 * above, middle + 1.5 * above, _ARROW_COLOR)
        drawing.label(middle + 16.0 * above, f"insert {label} into its groove")

    def _add_end(self, drawing: Drawing, line: CordLine, end: int, record: CordEnd) -> Float:
        """Add an end of a cord with its ferrule and wire; return the place (3,) of its label."""
        out = line.way_out(end)
        middle = line.ferrule(end, self.device.cord.ferrule_length)
        is_late = record.after is not None
        if record.joint != "pocket" or is_late:
            middle = record.at + _LOOSE_LENGTH_MM * out if is_late else middle
            tail = np.stack([record.at, middle])
            drawing.rod(tail, self.device.cord.diameter / 2, _CORD_COLOR)
        if not is_late:
            self._add_ferrule(drawing, middle, out)
            if not len(record.wire.joints):
                tip = record.at + (record.lead + _LOOSE_LENGTH_MM) * out
                self._add_wire(drawing, np.stack([middle, tip]))
        return middle

    def _add_ferrule(self, drawing: Drawing, middle: Float, direction: Float) -> None:
        cord = self.device.cord
        radius, length = cord.ferrule_diameter / 2, cord.ferrule_length
        drawing.cylinder(middle, direction, radius, length, _FERRULE_COLOR)
        drawing.legend["ferrule"] = _FERRULE_COLOR

    def _add_wire(self, drawing: Drawing, line: Float) -> None:
        drawing.rod(line, self.device.fabrication.wire_diameter / 2, _WIRE_COLOR)
        drawing.legend["wire"] = _WIRE_COLOR

    def _add_passing_cords(self, drawing: Drawing, joint: Joint, has_labels: bool = True) -> None:
        """Add the cords that leave the face of the lower parts and continue in the upper parts."""
        for cord in self.manifest.cords:
            for j, k in cord.drawn:
                if j != joint.index:
                    continue
                start = cord.stretches[k].start
                pair = resample(self._line(cord).points, max(start - 2.0, 0.0), start + 2.0, 2)
                direction = (pair[1] - pair[0]) / np.linalg.norm(pair[1] - pair[0])
                direction = direction if direction @ joint.opens > 0 else -direction
                middle = pair.mean(0)
                tip = middle + min(_LOOSE_LENGTH_MM, joint.lift) * direction
                line = np.stack([middle - 3 * direction, tip])
                drawing.rod(line, self.device.cord.diameter / 2, _CORD_COLOR)
                if has_labels:
                    drawing.label(tip, f"{cord_label(cord.sensor)} passes through")
                drawing.legend["cord"] = _CORD_COLOR

    def _mark_stretching(self, drawing: Drawing, action: Action, joint: Joint) -> None:
        """Add an arrow along which a cord is stretched."""
        cord = self._cord(action.cord)
        here = [k for k in (0, 1) if joint_of_end(cord, k) == joint.index] or [0, 1]
        end = max(here, key=lambda k: (cord.ends[k].joint == "free", k))
        out = self._line(cord).way_out(end)
        base = cord.ends[end].at + (cord.ends[end].lead + 7.0) * out + 3.0 * joint.opens
        drawing.arrow(base, base + 20.0 * out, _ARROW_COLOR)
        text = f"stretch {cord_label(cord.sensor)} by {action.amount:.1f} mm"
        drawing.label(base + 12.0 * out, text)

    def _mark_glueless(self, drawing: Drawing, joint: Joint) -> None:
        """Mark in red where glue must stay away: along grooves of held cords, and in rings."""
        for line in glueless_lines(self.device, self.layout, self.manifest, joint):
            drawing.rod(line, _RED_LINE_RADIUS_MM, _GLUELESS_COLOR)
            drawing.legend["no glue between or inside these lines"] = _GLUELESS_COLOR
        for spot in self.manifest.assembly[joint.index].glueless:
            drawing.label(spot.at, f"no glue within {ceil(spot.reach)} mm")

    def _mark_glue(self, drawing: Drawing, cord: CutCord, end: int, joint: Joint) -> None:
        """Add a drop of glue at an end of a cord."""
        middle = cord.ends[end].at - 2.5 * self._line(cord).way_out(end) + 0.8 * joint.opens
        drawing.ball(middle, 1.6, _GLUE_COLOR)
        drawing.label(middle, f"glue {cord_label(cord.sensor)}, 5 mm")
        drawing.legend["glue"] = _GLUE_COLOR

    def _add_routed_wires(self, drawing: Drawing, passage: Passage) -> None:
        has_one_cord = len({a.cord for a, _ in passage.actions}) == 1
        for action, _ in passage.actions:
            if action.kind is not ActionKind.WIRE or action.end is None:
                continue
            line = self._cord(action.cord).ends[action.end].wire.line
            assert line is not None
            direction = line[-1] - line[-2]
            tail = line[-1:] + 0.6 * _LOOSE_LENGTH_MM * direction / np.linalg.norm(direction)
            self._add_wire(drawing, np.concatenate([line, tail]))
            if has_one_cord:  # wires of several cords are too close to each other for labels
                drawing.label(tail[0], f"wire of the {END_NAMES[action.end]}")

    def _add_closing_arrows(self, drawing: Drawing, joint: Joint, view: View) -> None:
        """Add arrows next to the parts, in the direction in which the upper ones move."""
        points = self._vertices(joint.upper) + joint.lift * joint.opens
        across = points @ view.right
        height = float((points @ joint.opens).mean())
        for k, sign in ((int(across.argmin()), -1), (int(across.argmax()), 1)):
            start = points[k] + sign * 6.0 * view.right
            start = start + (height - start @ joint.opens) * joint.opens
            drawing.arrow(start, start - 0.8 * joint.lift * joint.opens, _ARROW_COLOR)


def _view_from_aside(out: Float) -> View:
    """Return a view from the side of a cord that leaves the body in the direction `out` (3,)."""
    is_level = abs(out[2]) < _MAX_UPWARD_SHARE
    side = np.cross(out, np.eye(3)[2 if is_level else 1])
    up = np.eye(3)[2] if is_level else np.cross(side, out) * np.sign(out[2])
    return views.looking(0.5 * out + 0.8 * side / np.linalg.norm(side) + 0.35 * up, up)
