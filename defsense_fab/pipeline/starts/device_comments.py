"""What the keys of a first device.toml mean, written beside them."""

from __future__ import annotations

import re
import textwrap

from ...core.device.device_keys import KEYS

#: Where a beginner is told more than, or other than, the reference does.
_COMMENTS = {
    ("", "schema"): "The version of this file's format. docs/device.md has all keys.",
    ("", "name"): "What the device is called in its report and files.",
    ("body", "script"): "The Python file whose function body() makes the solid, in mm.",
    ("body", "step"): "The file of the solid.",
    ("body", "mesh"): "The file of the closed surface.",
    ("body", "parameters"): "What body() is called with; try others with --set NAME=VALUE.",
    ("body", "scale"): "How many mm a unit of the file is.",
    ("body", "fill_cavities"): "Closed cavities cannot be made; they become solid.",
    ("material", "name"): "A row of data/materials.csv: what the body is made of.",
    ("mesh", "edge_length"): "Of the elements, mm: about a fifth of the thickness. Smaller is"
    " more accurate and slower.",
    ("regions", ""): "Parts of the body, in mm, by which poses hold and move it. A half space is"
    " all that lies beyond `origin` in the direction of `normal`.",
    ("outputs", "markers"): "How many points of the surface are predicted, spread evenly.",
    ("outputs", "anchor"): "The region that stays at its place while the device is recorded.",
    ("cord", "name"): "A row of data/cords.csv: the cord whose resistance tells its stretch.",
    ("cord", "noise"): "Standard deviation of a reading of (R - R0)/R0.",
    ("fabrication", "process"): "A row of data/printers.csv: its walls, clearances and bed.",
    ("design", "sensors"): "How many cords there are to be; their paths are found. More cords"
    " tell more movements apart, and make more parts.",
    ("poses", ""): "What the device is to sense. Each pose holds some regions and moves others:"
    " rotate about their middle by degrees, translate by [x, y, z] mm or freely. Set the degrees"
    " to the most that a hand will do.",
    ("poses.handles", "rotate"): "About the middle of the region, by the right hand; free: as no"
    " moment is left.",
    ("poses.handles", "translate"): "[x, y, z] mm; free: to where no force is left.",
    ("sensors", ""): "A cord as drawn: points in a plane, in mm; `free` says what may be improved.",
    ("states", "ramp"): "Every pose at these fractions.",
    ("states", "mixtures"): "Poses at once, to design for.",
    ("states", "held_out"): "Poses at once that the design does not see: the error is told of"
    " these.",
}
_TABLE = re.compile(r"\[+([\w.]+)\]+")
_KEY = re.compile(r"([\w-]+) *=")
_LINK = re.compile(r"\[([^\]]+)\]\([^)]*\)")


def commented(text: str) -> str:
    """A device's text with a comment above each key that has none, the first time that it is
    there. Names that a person chooses, of regions and parameters, have that of their table."""
    out: list[str] = []
    table, shown, told = "", "", set()
    for line in text.split("\n"):
        place = None
        if match := _TABLE.match(line):
            table, shown = match[1], match[0]
            place = (table, "")
        elif match := _KEY.match(line):
            place = (table, match[1])
        words = _COMMENTS.get(place) or _meaning(shown, place[1]) if place else ""
        if words and place not in told:
            told.add(place)
            if not (out and out[-1].startswith("#")):
                out += textwrap.wrap(words, 88, initial_indent="# ", subsequent_indent="# ")
        out.append(line)
    return "\n".join(out)


def _meaning(table: str, key: str) -> str:
    """Of the reference, as a sentence without links; nothing of keys that it has no words for."""
    words = KEYS.get(table, {}).get(key)
    if words is None:
        return ""
    plain = _LINK.sub(r"\1", words.meaning)
    return f"{plain[0].upper()}{plain[1:]}{f', {words.unit}' if words.unit else ''}."
