"""Pictures of the steps in which parts are joined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...core.device.device import Device
from ...core.mesh import Surface
from ...store.layout import LayoutRecord
from ...store.manifest import CutCord, Manifest
from ..pictures import views
from ..pictures.sheet import COLORS
from ..pictures.views import View
from .assembly.actions import Action, Kind
from .assembly.bench_work import pulled, reach_of
from .assembly.steps import GuideStep, Joint, Passage, Scene
from .assembly.wording import ENDS, called
from .cord_lines import CordLine, cord_line
from .drawing import Drawing

# What a device is made of as pictures of its assembly show them: parts, pins, cords, wires.

#: Colours of things.
CORD, WIRE, FERRULE = "#161616", "#c1121f", "#c9a227"
THICK, MIDDLE, THIN = "#e76f51", "#f4d35e", "#3a86ff"
GLUE, ARROW = "#2a9d3a", "#f77f00"
#: Of wires and cords that hang out of a picture, mm.
OUT = 24.0


@dataclass(frozen=True)
class DeviceDrawing:
    """Draws what one device is made of, its parts by name."""

    device: Device
    layout: LayoutRecord
    manifest: Manifest
    parts: Mapping[str, Surface]

    def color(self, part: str) -> str:
        return COLORS[list(self.parts).index(part) % len(COLORS)]

    def add_parts(self, drawing: Drawing, names: Sequence[str], shift: Float | None = None) -> None:
        for name in names:
            drawing.part(self.parts[name], self.color(name), shift, name)

    def points(self, names: Sequence[str]) -> Float:
        return np.concatenate([self.parts[n].vertices for n in names])

    def thicknesses(self, joint: Joint) -> dict[float, str]:
        kinds = {p.name: p.diameter for p in self.manifest.pins}
        found = sorted({kinds[p.name] for p in joint.pins})
        middle = dict.fromkeys(found[1:-1], MIDDLE)
        return {found[0]: THIN, **middle, found[-1]: THICK} if len(found) > 1 else {found[0]: THICK}

    def _thicknesses_or_none(self, joint: Joint) -> dict[float, str]:
        return self.thicknesses(joint) if joint.pins else {}

    def add_pegs(self, drawing: Drawing, joint: Joint) -> None:
        kinds, colors = {p.name: p for p in self.manifest.pins}, self._thicknesses_or_none(joint)
        for pin in joint.pins:
            kind = kinds[pin.name]
            drawing.cylinder(pin.center, joint.opens, kind.diameter / 2, kind.length,
                             colors[kind.diameter])  # fmt: skip

    def cord(self, name: str | None) -> CutCord:
        return next(c for c in self.manifest.cords if c.sensor == name)

    def line(self, cord: CutCord) -> CordLine:
        return cord_line(self.layout, cord)

    def add_stretch(self, drawing: Drawing, cord: CutCord, k: int, joint: Joint) -> None:
        """A stretch of a cord in its groove with the ends that it has, and what hangs out."""
        line, r = self.line(cord), self.device.cord.diameter / 2
        part, long = cord.stretches[k], self.device.cord.ferrule_length
        start, stop = part.start, part.stop
        has = line.ends_in(part)
        for end in has:
            record = cord.ends[end]
            out = line.way_out(end)
            middle = line.ferrule(end, long)
            if record.joint == "pocket" and record.after is None:
                depth = record.pocket - long / 2
                total = float(arc_lengths(line.points)[-1])
                start, stop = (depth, stop) if end == 0 else (start, min(stop, total) - depth)
            else:
                middle = middle if record.after is None else record.at + OUT * out
                drawing.rod(np.stack([record.at, middle]), r, CORD)
            if record.after is None:
                self.add_ferrule(drawing, middle, out)
                if not len(record.wire.joints):
                    self.add_wire(
                        drawing, np.stack([middle, record.at + (record.lead + OUT) * out])
                    )
            bare = ", no ferrule yet" if record.after is not None else ""
            drawing.label(middle, f"{ENDS[end]} of {called(cord.sensor)}{bare}")
        inner = line.along(start, stop)
        drawing.rod(inner, r, CORD)
        goes_on = [
            (inner[0], inner[0] - inner[1]) if end == 0 else (inner[-1], inner[-1] - inner[-2])
            for end in (0, 1)
            if end not in has
        ]
        for at, away in goes_on:
            along = away / np.linalg.norm(away)
            drawing.rod(np.stack([at, at + OUT * along]), r, CORD)
            drawing.label(at + 0.7 * OUT * along, f"{called(cord.sensor)} goes on")
        middle = inner[len(inner) // 2]
        above = 0.85 * drawing.view.up + 0.5 * joint.opens
        drawing.arrow(middle + 20.0 * above, middle + 1.5 * above, ARROW)
        drawing.label(middle + 16.0 * above, f"lay {called(cord.sensor)} into its groove")

    def add_ferrule(self, drawing: Drawing, middle: Float, along: Float) -> None:
        c = self.device.cord
        drawing.cylinder(middle, along, c.ferrule_diameter / 2, c.ferrule_length, FERRULE)
        drawing.legend["ferrule"] = FERRULE

    def add_wire(self, drawing: Drawing, line: Float) -> None:
        drawing.rod(line, self.device.fabrication.wire_diameter / 2, WIRE)
        drawing.legend["wire"] = WIRE

    def add_passing(self, drawing: Drawing, joint: Joint, labelled: bool = True) -> None:
        """Cords that come out of the lower parts' face and go on in the upper parts."""
        for cord in self.manifest.cords:
            for j, k in cord.drawn:
                if j != joint.index:
                    continue
                at = cord.stretches[k].start
                two = resample(self.line(cord).points, max(at - 2.0, 0.0), at + 2.0, 2)
                along = (two[1] - two[0]) / np.linalg.norm(two[1] - two[0])
                along = along if along @ joint.opens > 0 else -along
                middle = two.mean(0)
                tip = middle + min(OUT, joint.lift) * along
                drawing.rod(np.stack([middle - 3 * along, tip]),
                            self.device.cord.diameter / 2, CORD)  # fmt: skip
                if labelled:
                    drawing.label(tip, f"{called(cord.sensor)} passes through")
                drawing.legend["cord"] = CORD


_STEEP = 0.8  # of a direction's length, upwards
_NEAR = 55.0  # mm, around an end that is shown


@dataclass(frozen=True)
class Pictures(DeviceDrawing):
    """Makes the pictures of one device."""

    def of(self, step: GuideStep, passage: Passage) -> str | None:
        """What a passage of a step shows, if it shows anything."""
        if passage.scene is Scene.END:
            return self._end(passage)
        if step.joint is None:
            return None
        if passage.scene is Scene.PINS:
            return self._pins(step.joint) if step.joint.pins else None
        if passage.scene is Scene.LAY:
            return self._lay(step.joint, passage)
        return self._close(step.joint) if passage.scene is Scene.CLOSE else None

    def _onto_face(self, joint: Joint, tilt: float) -> View:
        """Onto the lower parts' cut face, their longest side across, `tilt` from upright."""
        _, short = _sides_of(self.points(joint.lower), joint.opens)
        return views.looking(joint.opens - tilt * short, short + joint.opens * 0.01)

    def _pins(self, joint: Joint) -> str:
        """The pins above their sockets in the lower parts, the thicker and the thinner ones."""
        drawing = Drawing(self._onto_face(joint, 0.7))
        self.add_parts(drawing, joint.lower)
        for name in joint.lower:
            drawing.label(name, name)
        kinds = {p.name: p for p in self.manifest.pins}
        colors = self.thicknesses(joint)
        for letter, pin in zip(joint.letters, joint.pins, strict=True):
            kind = kinds[pin.name]
            middle = pin.center + (0.75 * kind.length + 7.0) * joint.opens
            color = colors[kind.diameter]
            drawing.cylinder(middle, joint.opens, kind.diameter / 2, kind.length, color)
            foot = middle - kind.length / 2 * joint.opens
            drawing.arrow(foot, pin.center, ARROW)
            drawing.label(middle, f"{letter}: {kind.diameter:g} mm thick")
        for thick, color in sorted(colors.items(), reverse=True):
            drawing.legend[f"pin, {thick:g} mm thick"] = color
        return drawing.png()

    def _lay(self, joint: Joint, passage: Passage) -> str:
        """The lower parts' cut face with what is laid into it."""
        drawing = Drawing(self._onto_face(joint, 0.35))
        self.add_parts(drawing, joint.lower)
        self.add_pegs(drawing, joint)
        for name in dict.fromkeys(a.cord for a, _ in passage.actions if a.cord):
            cord = self.cord(name)
            for k, stretch in enumerate(cord.stretches):
                if stretch.joint == joint.index:
                    self.add_stretch(drawing, cord, k, joint)
        for action, _ in passage.actions:
            self._marks(drawing, action, joint)
        self._wires(drawing, passage)
        self.add_passing(drawing, joint)
        drawing.legend |= {"cord": CORD}
        return drawing.png()

    def _marks(self, drawing: Drawing, action: Action, joint: Joint) -> None:
        """Where a cord is stretched, and where it is glued."""
        if action.kind is Kind.STRETCH:
            cord = self.cord(action.cord)
            free = [k for k, e in enumerate(cord.ends) if e.joint == "free"]
            end = free[-1] if free else 1
            out, at = self.line(cord).way_out(end), cord.ends[end].at
            base = at + (cord.ends[end].lead + 7.0) * out + 3.0 * joint.opens
            drawing.arrow(base, base + 20.0 * out, ARROW)
            drawing.label(base + 12.0 * out, f"stretch {called(cord.sensor)} by"
                          f" {action.amount:.1f} mm")  # fmt: skip
        if action.kind is Kind.GLUE_END and action.end is not None:
            cord = self.cord(action.cord)
            at = cord.ends[action.end].at - 2.5 * self.line(cord).way_out(action.end)
            drawing.ball(at + 0.8 * joint.opens, 1.6, GLUE)
            drawing.label(at + 0.8 * joint.opens, f"glue {called(cord.sensor)}, 5 mm")
            drawing.legend["glue"] = GLUE

    def _wires(self, drawing: Drawing, passage: Passage) -> None:
        for action, _ in passage.actions:
            if action.kind is not Kind.WIRE or action.end is None:
                continue
            cord = self.cord(action.cord)
            line = cord.ends[action.end].wire.line
            assert line is not None
            away = line[-1] - line[-2]
            tail = line[-1:] + 0.6 * OUT * away / np.linalg.norm(away)
            self.add_wire(drawing, np.concatenate([line, tail]))
            if len({a.cord for a, _ in passage.actions}) == 1:  # of several, the colour must do
                drawing.label(tail[0], f"wire of the {ENDS[action.end]}")

    def _close(self, joint: Joint) -> str:
        """The upper parts above the lower ones, and how they go together."""
        long, short = _sides_of(self.points((*joint.lower, *joint.upper)), joint.opens)
        view = views.looking(0.62 * -short + 0.5 * joint.opens + 0.15 * long, joint.opens)
        drawing = Drawing(view)
        lift = joint.lift * joint.opens
        self.add_parts(drawing, joint.lower)
        self.add_parts(drawing, joint.upper, lift)
        self.add_pegs(drawing, joint)
        for name in joint.cords:
            cord = self.cord(name)
            for part in cord.stretches:
                if part.joint == joint.index:
                    inner = self.line(cord).along(part.start, part.stop)
                    drawing.rod(inner, self.device.cord.diameter / 2, CORD)
                    drawing.legend["cord"] = CORD
        for wire in joint.wires:
            self.add_wire(drawing, wire)
        self.add_passing(drawing, joint, labelled=False)
        for name in joint.lower:
            drawing.label(name, name)
        for name in joint.upper:
            drawing.label(name, name)
        self._fall(drawing, joint, view)
        return drawing.png()

    def _fall(self, drawing: Drawing, joint: Joint, view: View) -> None:
        """Arrows beside the parts, in the direction in which the upper ones go down."""
        points = self.points(joint.upper) + joint.lift * joint.opens
        across = points @ view.right
        for k, sign in ((int(across.argmin()), -1), (int(across.argmax()), 1)):
            at = points[k] + sign * 6.0 * view.right
            at = at + (float((points @ joint.opens).mean()) - at @ joint.opens) * joint.opens
            drawing.arrow(at, at - 0.8 * joint.lift * joint.opens, ARROW)

    def _end(self, passage: Passage) -> str | None:
        """Ends that are pulled out of their mouths to be crimped."""
        pulls = [a for a, _ in passage.actions if a.kind is Kind.PULL]
        if not pulls:
            return None
        outs = [self.line(self.cord(a.cord)).way_out(a.end or 0) for a in pulls]
        view = _along(outs[0])
        first = self.cord(pulls[0].cord).ends[pulls[0].end or 0].at
        drawing = Drawing(view, (first, _NEAR))
        self.add_parts(drawing, list(self.parts))
        for action, out in zip(pulls, outs, strict=True):
            cord, end = self.cord(action.cord), action.end or 0
            at, reach = cord.ends[end].at, reach_of(self.device, cord, end)
            middle = at + reach * out
            drawing.rod(np.stack([at - 2 * out, middle]), self.device.cord.diameter / 2, CORD)
            self.add_ferrule(drawing, middle, out)
            self.add_wire(drawing, np.stack([middle, middle + OUT * out]))
            beside = at + 5 * view.up + 2 * out
            drawing.arrow(beside, beside + (reach + 14) * out, ARROW)
            drawing.label(middle, f"pull the {ENDS[end]} of {called(cord.sensor)}:"
                          f" mark {reach:.0f} mm out, stretched by"
                          f" {pulled(self.device, cord, end):.0%}")  # fmt: skip
        drawing.legend = {"cord": CORD, **drawing.legend}
        return drawing.png()


def _sides_of(points: Float, normal: Float) -> tuple[Float, Float]:
    """The longest and the shortest direction (3,) of points across a normal, right-handed: long,
    short, normal."""
    flat = points - points @ normal[:, None] * normal
    long = np.linalg.svd(flat - flat.mean(0), full_matrices=False)[2][0]
    long = long if long @ [1.0, 0.3, 0.2] > 0 else -long
    return long, np.cross(normal, long)


def _along(out: Float) -> View:
    """A view in which what comes out of a body in the direction `out` (3,) is seen from aside."""
    upright = abs(out[2]) < _STEEP
    side = np.cross(out, np.eye(3)[2 if upright else 1])
    up = np.eye(3)[2] if upright else np.cross(side, out) * np.sign(out[2])
    return views.looking(0.5 * out + 0.8 * side / np.linalg.norm(side) + 0.35 * up, up)
