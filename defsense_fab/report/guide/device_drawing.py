"""What a device is made of as pictures of its assembly show them: parts, pins, cords, wires."""

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
from ..colors import COLORS
from .cord_lines import CordLine, cord_line
from .drawing import Drawing
from .hands.steps import Joint
from .hands.words import ENDS, called

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
