"""Draw the pictures of the page on layouts.

    python docs/layout/make_pictures.py [DEVICE]

The drawings need nothing. DEVICE is the folder of a built device, whose cords are drawn as well.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
INK, SOFT, BODY, EDGE = "#1b262c", "#52616b", "#dfe6ea", "#8fa3b0"
LONGER, SAME, SHORTER = "#d1495b", "#8a8f94", "#00798c"
HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {w} {h}" width="{w}" height="{h}" '
    'font-family="DejaVu Sans, Arial, sans-serif" font-size="15" fill="' + INK + '">'
    '<rect width="{w}" height="{h}" fill="white"/>'
)


def polyline(points, color, width, is_closed=False, fill="none"):
    """Return a line through points (n, 2), pixels."""
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    kind = "polygon" if is_closed else "polyline"
    return (
        f'<{kind} points="{text}" fill="{fill}" stroke="{color}" stroke-width="{width}"'
        ' stroke-linejoin="round" stroke-linecap="round"/>'
    )


def text(x, y, words, color=INK, anchor="start", weight="normal"):
    """Return a line of text."""
    return (
        f'<text x="{x:.0f}" y="{y:.0f}" fill="{color}" text-anchor="{anchor}"'
        f' font-weight="{weight}">{words}</text>'
    )


def save(name, size, parts):
    """Write an SVG file."""
    content = HEAD.format(w=size[0], h=size[1]) + "".join(parts) + "</svg>\n"
    (HERE / f"{name}.svg").write_text(content, encoding="utf-8")


def draw_bend():
    """Draw a straight bar and a bent one from the side, each with three cords."""
    length, half, offset, angle = 250.0, 34.0, 24.0, np.radians(60)
    radius = length / angle
    cords = ((offset, LONGER), (0.0, SAME), (-offset, SHORTER))
    parts = [text(40, 30, "at rest", weight="bold"), text(390, 30, "bent by 60°", weight="bold")]
    left, middle = 40.0, 120.0
    corners = [
        (left, middle - half), (left + length, middle - half),
        (left + length, middle + half), (left, middle + half),
    ]  # fmt: skip
    parts.append(polyline(corners, EDGE, 1.5, True, BODY))
    parts += [
        polyline([(left, middle - y), (left + length, middle - y)], color, 4) for y, color in cords
    ]

    def bent(height):
        turn = np.linspace(0, angle, 40)
        r = radius + height
        return np.column_stack([390 + r * np.sin(turn), middle + radius - r * np.cos(turn)])

    outline = np.concatenate([bent(half), bent(-half)[::-1]])
    parts.append(polyline(outline, EDGE, 1.5, True, BODY))
    for height, color in cords:
        parts.append(polyline(bent(height), color, 4))
        change = 100 * height / radius
        words = f"{change:+.0f} %".replace("-", "−") if height else "0 %"
        place = "outer" if height > 0 else "inner" if height else "middle"
        parts.append(text(590, 96 - 0.9 * height, f"{place} {words}", color, weight="bold"))
    parts.append(text(40, 250, "Change of length: longer outside, the same in the middle,", SOFT))
    parts.append(text(40, 272, "shorter inside", SOFT))
    save("bend", (720, 290), parts)


def draw_twist():
    """Draw the side of a bar at rest and twisted, with a cord along the axis and a diagonal one."""
    length, height, shift = 260.0, 84.0, 52.0
    parts = [
        text(40, 30, "side of a bar at rest", weight="bold"),
        text(390, 30, "twisted: the side is sheared", weight="bold"),
    ]
    for x, by in ((40.0, 0.0), (390.0, shift)):

        def place(u, v, x=x, by=by):
            return x + length * u, 160 - height * v - by * u + by / 2

        corners = [place(*p) for p in ((0, 0), (1, 0), (1, 1), (0, 1))]
        parts.append(polyline(corners, EDGE, 1.5, True, BODY))
        parts.append(polyline([place(0, 0), place(1, 1)], LONGER, 4))
        parts.append(polyline([place(0, 0.5), place(1, 0.5)], SAME, 4))
    ratio = np.hypot(length, height + shift) / np.hypot(length, height) - 1
    axial = np.hypot(length, shift) / length - 1
    parts += [
        text(664, 62, f"+{100 * ratio:.0f} %", LONGER, weight="bold"),
        text(664, 102, f"+{100 * axial:.0f} %", SAME, weight="bold"),
        text(40, 226, "The diagonal cord changes much more than the one along the axis,", SOFT),
        text(40, 248, "and becomes shorter when the twist is in the other direction", SOFT),
    ]  # fmt: skip
    save("twist", (720, 264), parts)


def draw_loop():
    """Draw the loop of the search."""
    boxes = (
        ("cord paths", "splines in planes"),
        ("signals", "in each state, with noise"),
        ("decoder", "best map to the surface"),
        ("expected error", "in held-out states"),
    )
    width, height, gap, top = 150.0, 66.0, 30.0, 24.0
    parts = [
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7"'
        f' markerHeight="7" orient="auto"><path d="M0,0 L8,4 L0,8 z"'
        f' fill="{SOFT}"/></marker></defs>'
    ]
    for k, (title, words) in enumerate(boxes):
        x = 12 + k * (width + gap)
        parts.append(
            f'<rect x="{x}" y="{top}" width="{width}" height="{height}" rx="6" fill="{BODY}"'
            f' stroke="{EDGE}" stroke-width="1.5"/>'
        )
        parts.append(text(x + width / 2, top + 28, title, anchor="middle", weight="bold"))
        parts.append(
            text(x + width / 2, top + 50, words, SOFT, "middle").replace(
                "<text", '<text font-size="11.5"'
            )
        )
        if k:
            parts.append(
                f'<path d="M{x - gap + 2},{top + height / 2} H{x - 3}" stroke="{SOFT}"'
                ' stroke-width="2" marker-end="url(#tip)"/>'
            )
    first, last, low = 12 + width / 2, 12 + 3 * (width + gap) + width / 2, top + height
    parts.append(
        f'<path d="M{last},{low} V{low + 34} H{first} V{low + 4}" fill="none" stroke="{SOFT}"'
        ' stroke-width="2" marker-end="url(#tip)"/>'
    )
    words = "move the paths to where the error is smaller"
    parts.append(text((first + last) / 2, low + 56, words, SOFT, "middle"))
    save("loop", (714, 160), parts)


def draw_routing(folder):
    """Draw the cords of a built device next to the drawn ones."""
    import defsense_fab as df

    picture = df.optimize(df.simulate(df.Device.load(folder))).picture()
    (HERE / "routing.png").write_bytes(picture.png)
    shrink(HERE / "routing.png")


def shrink(path):
    """Reduce the colors of a PNG file."""
    from PIL import Image

    with Image.open(path) as image:
        reduced = image.convert("RGB").quantize(128, dither=Image.Dither.NONE)
    reduced.save(path, optimize=True)


if __name__ == "__main__":
    draw_bend()
    draw_twist()
    draw_loop()
    for device in sys.argv[1:]:
        draw_routing(device)
