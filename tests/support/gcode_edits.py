"""Damage conductive traces in the text of a G-code file with relative extrusion (M83).

The edits are made line by line and share nothing with the reader under test.
"""

from __future__ import annotations

import numpy as np


def _number(line, letter):
    for word in line.split(";")[0].split()[1:]:
        if word[0] == letter:
            return float(word[1:])
    return None


def _part_in_box(a, b, low, high):
    """Return the shares of the start and end of the part of a line in a box, or None."""
    t0, t1 = 0.0, 1.0
    for p, q, lo, hi in zip(a, b, low, high, strict=True):
        if abs(q - p) < 1e-9:
            if not lo <= p <= hi:
                return None
            continue
        u, v = sorted(((lo - p) / (q - p), (hi - p) / (q - p)))
        t0, t1 = max(t0, u), min(t1, v)
    return (t0, t1) if t1 - t0 > 1e-6 else None


def _edit(text, tool, low, high, change):
    """Replace the parts of extrusions of a tool that are in a box by `change(end, extrusion)`."""
    out, position, active = [], np.zeros(3), 0
    for line in text.splitlines():
        if line[:1] == "T" and line[1:].strip().isdigit():
            active = int(line[1:])
        if not line.startswith(("G0 ", "G1 ")):
            out.append(line)
            continue
        target = position.copy()
        for i, letter in enumerate("XYZ"):
            value = _number(line, letter)
            target[i] = position[i] if value is None else value
        e = _number(line, "E")
        moves = np.linalg.norm(target - position) > 0
        part = None
        if active == tool and e is not None and e > 0 and moves:
            part = _part_in_box(position, target, low, high)
        if part is None:
            out.append(line)
        else:
            t0, t1 = part
            at = [position + t * (target - position) for t in (t0, t1)]
            if t0 > 0:
                out.append(f"G1 X{at[0][0]:.3f} Y{at[0][1]:.3f} E{e * t0:.5f}")
            out += change(at[1], e * (t1 - t0))
            if t1 < 1:
                out.append(f"G1 X{target[0]:.3f} Y{target[1]:.3f} E{e * (1 - t1):.5f}")
        position = target
    return "\n".join(out) + "\n"


def remove_extrusion(text, tool, low, high):
    """Return the text with all extrusion of a tool in a box (nozzle positions) as travel."""
    return _edit(text, tool, low, high, lambda end, _: [f"G1 X{end[0]:.3f} Y{end[1]:.3f}"])


def swap_tool(text, tool, other, low, high):
    """Return the text with the extrusions of a tool in a box printed by another."""
    return _edit(
        text,
        tool,
        low,
        high,
        lambda end, e: [f"T{other}", f"G1 X{end[0]:.3f} Y{end[1]:.3f} E{e:.5f}", f"T{tool}"],
    )


def add_extrusion(text, tool, start, end, z, e_per_mm=0.0339):
    """Return the text with one more bead of a tool in the layer of nozzle height z."""
    lines, active, height, last = text.splitlines(), 0, 0.0, None
    for number, line in enumerate(lines):
        if line[:1] == "T" and line[1:].strip().isdigit():
            active = int(line[1:])
        if not line.startswith(("G0 ", "G1 ")):
            continue
        value = _number(line, "Z")
        height = height if value is None else value
        x, y, e = (_number(line, letter) for letter in "XYE")
        extrudes = e is not None and e > 0 and x is not None and y is not None
        if extrudes and active == tool and abs(height - z) < 1e-6:
            last = number, x, y
    assert last is not None
    number, x, y = last
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    lines[number + 1 : number + 1] = [
        f"G1 X{start[0]:.3f} Y{start[1]:.3f}",
        f"G1 X{end[0]:.3f} Y{end[1]:.3f} E{e_per_mm * length:.5f}",
        f"G1 X{x:.3f} Y{y:.3f}",
    ]
    return "\n".join(lines) + "\n"
