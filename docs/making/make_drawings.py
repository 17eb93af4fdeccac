"""Draw the sections and plots of the pages on making devices, as SVG files.

python docs/making/make_drawings.py [NAME...]
"""

from __future__ import annotations

import sys
from html import escape
from math import cos, radians, sin
from pathlib import Path

import matplotlib as mpl

HERE = Path(__file__).parent
INK, SOFT = "#1b262c", "#5c6b74"
LOWER, UPPER, AIR = "#dfe8d8", "#e8dfd0", "#ffffff"
CORD, WIRE, FERRULE, GLUE, METAL = "#161616", "#c1121f", "#c9a227", "#2a9d3a", "#b9c3ca"
FONT_PX = 16
mpl.use("svg")
mpl.rcParams |= {"svg.hashsalt": "defsense", "svg.fonttype": "none", "font.size": 12}


class Svg:
    """Shapes and labels of a drawing, in pixels."""

    def __init__(self, width, height):
        self.size = width, height
        self.elements = []

    def shape(self, name, fill="none", stroke=INK, line=1.5, **attributes):
        """Add an SVG element; its attributes are written as they are."""
        words = " ".join(f'{key.replace("_", "-")}="{value}"' for key, value in attributes.items())
        style = f'fill="{fill}" stroke="{stroke}" stroke-width="{line}"'
        self.elements.append(f"<{name} {words} {style}/>")

    def box(self, x, y, width, height, fill, stroke=INK, radius=0):
        """Add a rectangle."""
        self.shape("rect", fill, stroke, x=x, y=y, width=width, height=height, rx=radius)

    def path(self, d, stroke=INK, width=1.5, fill="none", **attributes):
        """Add a path."""
        self.shape("path", fill, stroke, width, **({"stroke_linecap": "round"} | attributes), d=d)

    def arrow(self, start, end, both=False, color=SOFT):
        """Add a line with an arrowhead at its end, or at both ends."""
        self.path("M{:g},{:g} L{:g},{:g}".format(*start, *end), color)
        for tip, tail in ((end, start), (start, end))[: 2 if both else 1]:
            dx, dy = tip[0] - tail[0], tip[1] - tail[1]
            length = (dx * dx + dy * dy) ** 0.5
            ux, uy = dx / length, dy / length
            a = tip[0] - 9 * ux + 4 * uy, tip[1] - 9 * uy - 4 * ux
            b = tip[0] - 9 * ux - 4 * uy, tip[1] - 9 * uy + 4 * ux
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (tip, a, b))
            self.shape("polygon", color, color, 1, points=points)

    def text(self, x, y, text, anchor="start", color=INK, bold=False):
        """Add one or more lines of text; y is the baseline of the first."""
        weight = ' font-weight="bold"' if bold else ""
        for k, line in enumerate(text.split("\n")):
            self.elements.append(
                f'<text x="{x:g}" y="{y + 20 * k:g}" text-anchor="{anchor}" fill="{color}"'
                f"{weight}>{escape(line)}</text>"
            )

    def label(self, x, y, text, at, anchor="start"):
        """Add a text with a line from it to a place."""
        gap = {"start": -5, "end": 5, "middle": 0}[anchor]
        drop = 0 if anchor != "middle" else (10 if at[1] > y else -12)
        self.path(f"M{x + gap:g},{y - 5 + drop:g} L{at[0]:g},{at[1]:g}", SOFT, 1)
        self.shape("circle", SOFT, "none", cx=at[0], cy=at[1], r=3)
        self.text(x, y, text, anchor)

    def write(self, name, title):
        """Write the drawing next to this file."""
        width, height = self.size
        (HERE / f"{name}.svg").write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"'
            f' width="{width}" height="{height}" font-family="sans-serif" font-size="{FONT_PX}">'
            f"<title>{escape(title)}</title>"
            f'<rect width="100%" height="100%" fill="{AIR}"/>{"".join(self.elements)}</svg>\n',
            encoding="utf-8",
        )


def channel():
    """Draw the section through a joint, at right angles to the cord."""
    svg = Svg(700, 300)
    x, y, r = 300, 150, 42
    svg.box(170, 40, 260, 110, UPPER)
    svg.box(170, 150, 260, 110, LOWER)
    svg.shape("circle", AIR, cx=x, cy=y, r=r)
    svg.shape("circle", CORD, CORD, cx=x, cy=y + 3, r=r - 5)
    svg.arrow((x, y + r), (x, 260), both=True)
    svg.text(x + 8, 234, "wall")
    svg.label(455, 75, "upper part", (395, 75))
    svg.label(455, 155, "cut: the glued faces", (410, 150))
    svg.label(455, 235, "lower part", (395, 235))
    svg.label(140, 95, "channel", (x - 31, y - 30), "end")
    svg.label(140, 155, "cord", (x - 20, y), "end")
    svg.label(140, 255, "skin", (200, 260), "end")
    svg.write("channel", "Section through a joint, with the channel of a cord")


def pocket():
    """Draw the section along the end of a cord."""
    svg = Svg(760, 300)
    y, butt = 160, {"stroke_linecap": "butt"}
    svg.box(110, 70, 640, 180, LOWER, "none")
    svg.path("M750,70 H110 V250 H750")
    svg.box(108, y - 24, 277, 48, AIR, "none")  # pocket, open at its mouth
    svg.box(385, y - 15, 365, 30, AIR, "none")  # channel
    svg.path(f"M110,{y - 24} H385 V{y - 15} H750 M110,{y + 24} H385 V{y + 15} H750")
    bend = f"M215,{y - 6} C185,{y - 6} 170,{y - 30} 170,69"
    svg.path(bend, INK, 25, **butt)
    svg.path(bend, AIR, 22, **butt)
    svg.box(150, y - 23, 80, 30, AIR, "none")
    svg.path(f"M300,{y} H225 C185,{y} 170,{y - 30} 170,69 V30", WIRE, 9)
    svg.path(f"M320,{y} H750", CORD, 24, **butt)
    svg.box(255, y - 20, 130, 40, FERRULE)
    svg.path(f"M320,{y - 20} V{y + 20}", INK, 1.2, stroke_dasharray="4 3")
    svg.label(215, 45, "wire, leaves through a bend", (170, 50))
    svg.label(340, 95, "ferrule", (320, y - 20), "middle")
    svg.label(215, 285, "pocket", (200, y + 20), "middle")
    svg.label(560, 95, "cord in its channel", (560, y - 12), "middle")
    svg.label(85, 110, "skin", (110, 110), "end")
    svg.label(85, 165, "mouth", (110, y), "end")
    svg.arrow((385, 222), (748, 222))
    svg.text(400, 242, "this part of the cord senses")
    svg.write("pocket", "Section along the end of a cord: wire, bend, pocket, ferrule and cord")


def held_bonded():
    """Draw a held and a bonded cord."""
    svg = Svg(760, 320)
    for top, title in ((40, "held"), (190, "bonded")):
        y = top + 50
        svg.text(20, top - 12, title, bold=True)
        svg.box(20, top, 720, 100, LOWER)
        svg.box(150, y - 14, 460, 28, AIR, INK)
        svg.box(70, y - 22, 90, 44, AIR, INK)
        svg.box(600, y - 22, 90, 44, AIR, INK)
        if title == "bonded":
            svg.box(151, y - 13, 458, 26, GLUE, "none")
        svg.path(f"M20,{y} H90 M670,{y} H740", WIRE, 7, stroke_linecap="butt")
        svg.path(f"M120,{y} H640", CORD, 16)
        svg.box(88, y - 17, 72, 34, FERRULE)
        svg.box(600, y - 17, 72, 34, FERRULE)
    svg.arrow((330, 75), (430, 75), both=True)
    svg.text(380, 66, "slides", "middle")
    svg.label(400, 158, "ferrule rests against the bottom of its pocket", (160, 112), "start")
    svg.label(380, 312, "soft glue along the whole groove", (380, 251), "middle")
    svg.write("held-bonded", "A held cord slides in its channel; a bonded cord is glued")


def beads():
    """Draw how current flows in a level trace and in a steep one."""
    svg = Svg(760, 300)
    svg.text(200, 30, "level trace: along the beads", "middle", bold=True)
    for k in range(4):
        svg.box(40, 150 + 22 * k, 320, 20, "#3b4a54", "#ffffff", 10)
    svg.arrow((60, 130), (340, 130), color=WIRE)
    svg.text(200, 120, "current", "middle", WIRE)
    svg.label(200, 275, "bead, a line of filament", (240, 228), "middle")
    svg.text(570, 30, "steep trace: from layer to layer", "middle", bold=True)
    for k in range(10):
        svg.box(520, 50 + 20 * k, 60, 18, "#3b4a54", "#ffffff", 9)
    svg.arrow((610, 245), (610, 55), color=WIRE)
    svg.text(622, 150, "current", color=WIRE)
    svg.label(505, 285, "bond between two layers", (530, 228), "middle")
    svg.write("beads", "A level trace conducts along its beads, a steep one from layer to layer")


def jig():
    """Draw a bent specimen on a jig, with the neutral plane and the outer cords."""
    svg = Svg(760, 260)
    cx, cy, r, h = 330, 450, 330, 90
    half = 38

    def arc(radius, start=-half, end=half):
        a, b = (
            (cx + radius * sin(radians(t)), cy - radius * cos(radians(t))) for t in (start, end)
        )
        return f"M{a[0]:.1f},{a[1]:.1f} A{radius:g},{radius:g} 0 0 1 {b[0]:.1f},{b[1]:.1f}"

    def at(radius, degrees):
        return cx + radius * sin(radians(degrees)), cy - radius * cos(radians(degrees))

    svg.path(arc(r + h / 2), LOWER, h, stroke_linecap="butt")
    svg.path(arc(r) + f" L {at(r, half)[0]:.1f},260 L {at(r, -half)[0]:.1f},260 Z",
             INK, 1.5, METAL)  # fmt: skip
    svg.path(arc(r + h), INK)
    for offset in (-30, 30):
        svg.path(arc(r + h / 2 + offset), CORD, 9)
    svg.path(arc(r + h / 2), SOFT, 2, stroke_dasharray="7 5")
    tip = at(r, -17)
    svg.arrow((cx - 55, 260), tip)
    svg.text(cx - 60, 212, "radius r")
    a, b = at(r + h / 2, 12), at(r + h / 2 + 30, 12)
    svg.arrow(a, b, both=True, color=WIRE)
    svg.text(b[0] + 4, b[1] + 26, "a", color=WIRE)
    svg.label(600, 40, "top cord: stretched", at(r + h / 2 + 30, 28))
    svg.label(600, 90, "neutral plane:\nno strain", at(r + h / 2, 34))
    svg.label(600, 150, "bottom cord:\ncompressed", at(r + h / 2 - 30, 36))
    svg.text(cx + 60, 240, "jig", "middle")
    svg.arrow(at(r, -25), at(r + h, -25), both=True)
    svg.text(at(r + h, -25)[0] + 30, at(r + h, -25)[1] + 50, "h")
    svg.write("jig", "The strain of a cord in the bent specimen")


def piece():
    """Draw a cord with its ferrules and wires."""
    svg = Svg(760, 200)
    y = 95
    svg.path(f"M20,{y} C60,{y - 40} 90,{y + 20} 150,{y}", WIRE, 7)
    svg.path(f"M740,{y} C700,{y + 40} 670,{y - 20} 610,{y}", WIRE, 7)
    svg.path(f"M190,{y} H570", CORD, 18)
    for x in (140, 540):
        svg.box(x, y - 15, 80, 30, FERRULE, radius=3)
        svg.path(f"M{x + 22},{y - 15} v30 M{x + 58},{y - 15} v30", INK, 1)
    svg.label(180, 40, "ferrule, crimped", (180, y - 15), "middle")
    svg.label(380, 40, "conductive rubber cord", (380, y - 8), "middle")
    svg.label(660, 40, "wire", (668, y + 1), "middle")
    for x in (180, 580):
        svg.path(f"M{x},{y + 20} V{y + 62}", SOFT, 1)
    svg.arrow((180, y + 52), (580, y + 52), both=True)
    svg.text(380, y + 76, "length between the ferrules, in the cut list", "middle")
    svg.write("piece", "A cord with its two ferrules and wires")


def figure(width, height):
    """Return a figure with one plot."""
    from matplotlib.figure import Figure

    fig = Figure((width, height), layout="constrained")
    axes = fig.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    return fig, axes


def save(fig, name):
    """Write a plot next to this file."""
    fig.savefig(HERE / f"{name}.svg", metadata={"Date": None})


def own_cord():
    """Plot the response of the cord in `docs/guide/your-own.md`."""
    fig, axes = figure(6, 2.8)
    axes.plot([0, 0.8], [0, 0.8 * 1.67], color=INK, lw=2)
    axes.plot([0.6], [1.0], "o", color=WIRE)
    axes.annotate("doubled at 60 %", (0.6, 1.0), (0.25, 1.12), color=WIRE,
                  arrowprops={"arrowstyle": "-", "color": WIRE})  # fmt: skip
    axes.annotate("max_strain", (0.8, 0), (0.8, 0.35), ha="center", color=SOFT,
                  arrowprops={"arrowstyle": "->", "color": SOFT})  # fmt: skip
    axes.set(xlabel="strain", ylabel="(R - R0)/R0", xlim=(0, 0.9), ylim=(0, 1.5))
    save(fig, "own-cord")


#: Errors (mm) of twins after training, unit 1, seed 11: of cords (family `viscoelastic`), of traces
#: with the memory of cords, and of traces with that of published printed sensors (`network`).
MEMORY = {"bar": (0.70, 1.23, 5.07), "joystick": (0.87, 0.97, 4.40)}
BARS = ("rubber cords", "traces, if they had the\nmemory of cords", "traces (network)")


def memory():
    """Plot what the memory of filament costs."""
    fig, axes = figure(7, 3)
    for k, (name, color) in enumerate(zip(BARS, ("#9fb0ba", "#edae49", "#d1495b"), strict=True)):
        values = [errors[k] for errors in MEMORY.values()]
        places = [i + 0.27 * (k - 1) for i in range(len(MEMORY))]
        bars = axes.bar(places, values, 0.25, color=color, label=name)
        axes.bar_label(bars, fmt="%.2f")
    axes.set_xticks(range(len(MEMORY)), list(MEMORY))
    axes.set(ylabel="error, mm", ylim=(0, 6))
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    save(fig, "memory")


DRAWINGS = {
    f.__name__.replace("_", "-"): f
    for f in (channel, pocket, held_bonded, beads, jig, piece, own_cord, memory)
}

if __name__ == "__main__":
    for name in sys.argv[1:] or DRAWINGS:
        DRAWINGS[name]()
