"""Draw the drawings of the pages on training and running: errors, folds, tags, outputs, memories.

python docs/running/make_drawings.py [NAME...]
"""

import re
import sys
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Rectangle

from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.decoding.error_scale import USABLE_SHARE, VERY_GOOD_SHARE
from defsense_fab.runtime.controls.control_spec import Shaping
from defsense_fab.runtime.outputs.settings import MidiMapping
from defsense_fab.twin.electronics.rubber_cords import (
    CORD_FAMILIES,
    RubberPieces,
    RubberState,
    RubberTraits,
)

HERE = Path(__file__).parent
WIDTH = 8.0  # inch
INK, SOFT, REAL, SHOWN = "#1f2d3a", "#8a97a3", "#1f5fa8", "#e08a1e"
GOOD, FAIR, BAD, PALE = "#2e8b57", "#e0b030", "#c0392b", "#eef2f6"
SKIN, PAPER = "#9fb3c2", "#ffffff"
STYLE = {"font.size": 11, "svg.hashsalt": "defsense", "font.family": "DejaVu Sans"}


def new_figure(height, limits, width=WIDTH):
    """Return a figure and its only axes, without frame and with equal scales."""
    figure = Figure((width, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=limits[0], ylim=limits[1])
    axes.axis("off")
    return figure, axes


def arrow(axes, start, end, color=INK, style="-|>", **options):
    """Draw an arrow between two points."""
    settings = {"mutation_scale": 14, "lw": 1.5, "shrinkA": 0, "shrinkB": 0} | options
    axes.add_patch(FancyArrowPatch(start, end, arrowstyle=style, color=color, **settings))


def box(axes, x, y, width, height, text, color=PALE, ink=INK, **options):
    """Draw a rounded box with a text in its middle."""
    shape = FancyBboxPatch(
        (x, y), width, height, boxstyle="round,pad=0,rounding_size=0.12", fc=color, ec=SOFT, lw=1
    )
    axes.add_patch(shape)
    settings = {"ha": "center", "va": "center", "color": ink} | options
    axes.text(x + width / 2, y + height / 2, text, **settings)


def bent(angle, length=10.0, thickness=1.4, count=60):
    """Return upper and lower outline (2, n, 2) of a bar that is bent by an angle, in radians."""
    s = np.linspace(0, 1, count)
    turn = angle * s
    middle = length * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=1) / angle
    normal = np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    return np.stack([middle + thickness / 2 * normal, middle - thickness / 2 * normal])


def draw_error():
    """Draw the real and the shown surface of a bent bar, and the distances of their points."""
    figure, axes = new_figure(3.7, ((-1.2, 15.2), (-1.7, 5.9)))
    axes.set_aspect("equal")
    real, shown = bent(0.95), bent(0.72)
    axes.fill(*np.concatenate([real[0], real[1, ::-1]]).T, color="#cfdcec", lw=0)
    for outline, color, dash in ((real, REAL, "-"), (shown, SHOWN, (0, (5, 2)))):
        closed = np.concatenate([outline[0], outline[1, ::-1], outline[0, :1]])
        axes.plot(*closed.T, color=color, lw=2, ls=dash)
    axes.add_patch(Rectangle((-0.7, -1.0), 0.7, 2.0, fc="#b9c3ca", ec=INK))
    for k in (15, 25, 35, 45, 54, 59):
        for side in (0, 1):
            a, b = real[side, k], shown[side, k]
            axes.plot(*zip(a, b, strict=True), color=BAD, lw=1.4)
            axes.plot(*a, "o", color=REAL, ms=4.5)
            axes.plot(*b, "o", mfc="white", mec=SHOWN, ms=4.5)
    axes.text(6.4, 5.2, "real surface", color=REAL, ha="right")
    axes.text(10.2, 1.75, "shown surface", color=SHOWN)
    arrow(axes, (11.2, 4.6), real[1, 59] / 2 + shown[1, 59] / 2 + (0.1, 0), BAD)
    axes.text(11.3, 4.7, "distance of a point:\nits error", color=BAD, va="bottom")
    axes.text(-0.35, -1.1, "held", ha="center", va="top", color=INK)
    axes.text(
        4.4, -1.35, "Error of the surface = root mean square of all these distances", color=INK
    )
    return figure


def draw_scale():
    """Draw the scale of errors, with examples in mm."""
    figure, axes = new_figure(1.9, ((-0.35, 8.4), (-0.62, 1.25)))
    good, usable = 100 * VERY_GOOD_SHARE, 100 * USABLE_SHARE
    parts = ((0, good, GOOD, "very good"), (good, usable, FAIR, "usable"), (usable, 8, BAD, "poor"))
    for low, high, color, name in parts:
        axes.add_patch(Rectangle((low, 0), high - low, 0.42, fc=color, ec="white", lw=2))
        ink = INK if color == FAIR else "white"
        axes.text((low + high) / 2, 0.2, name, ha="center", va="center", color=ink, weight="bold")
    for share in (0, good, usable):
        axes.text(share, -0.12, f"{share:g} %", ha="center", va="top")
    axes.text(8, -0.12, "of the largest movement", ha="right", va="top")
    axes.text(0, -0.4, "0 mm", ha="center", va="top", color=SOFT)
    for share in (good, usable):
        text = f"{0.52 * share:.1f} mm"
        axes.text(share, -0.4, text, ha="center", va="top", color=SOFT)
    axes.text(8, -0.4, "for a movement of 52 mm", ha="right", va="top", color=SOFT)
    arrow(axes, (0.94, 0.86), (0.94, 0.45))
    axes.text(0.94, 0.92, "0.49 mm", ha="center", va="bottom")
    return figure


def draw_errors():
    """Draw where each error is stated, from the design to the use, and what it contains."""
    figure, axes = new_figure(3.5, ((0, 16), (0, 7.0)))
    columns = (
        (0.2, "Design", "report, studio", "expected\nsurface error", "points of\nthe surface"),
        (4.2, "Training", "defsense train", "error of the folds,\nerror of the test", "markers"),
        (8.2, "Evaluation", "defsense evaluate", "RMSE,\ncauses", "markers"),
        (12.2, "Use", "defsense run", "interval of\neach marker", "one moment"),
    )
    for k, (x, title, where, what, of) in enumerate(columns):
        axes.text(x + 1.75, 6.6, title, ha="center", va="center", weight="bold", fontsize=12.5)
        axes.text(x + 1.75, 6.0, where, ha="center", va="center", color=SOFT, fontsize=10)
        box(axes, x, 4.1, 3.5, 1.4, what, color="#dfe9f5")
        axes.text(x + 1.75, 3.65, f"of {of}".replace("\n", " "), ha="center", fontsize=9.5)
        if k < 3:
            arrow(axes, (x + 3.55, 4.8), (x + 3.95, 4.8))
    bars = (
        (0.2, 15.7, "noise of the read-out, tolerances, memory of the cords"),
        (4.2, 11.7, "noise of the cameras"),
        (8.2, 15.7, "drift over hours and days"),
    )
    for k, (low, high, text) in enumerate(bars):
        y = 2.4 - 0.85 * k
        axes.add_patch(Rectangle((low, y), high - low, 0.62, fc="#f6e3c8", ec=SHOWN, lw=1))
        axes.text((low + high) / 2, y + 0.29, text, ha="center", va="center", fontsize=10)
    axes.text(0.2, 0.18, "Orange: what each error contains", color=SOFT, fontsize=10)
    return figure


def draw_folds():
    """Draw a recording that is divided into five folds and the test."""
    figure, axes = new_figure(3.0, ((-0.2, 10.2), (-1.0, 4.35)))
    rng = np.random.default_rng(4)
    t = np.linspace(0, 10, 400)
    y = sum(np.sin(t * w + p) for w, p in zip((2.1, 3.3, 5.2), rng.uniform(0, 6, 3), strict=True))
    axes.plot(t, 3.35 + 0.2 * y, color=REAL, lw=1.3)
    axes.text(0, 4.05, "the recording", va="center")
    for row in range(2):
        y0 = 1.55 - 1.2 * row
        for k in range(5):
            is_tested = k == (0, 3)[row]
            color, text = (SHOWN, "predicted") if is_tested else ("#cfdcec", "fitted")
            axes.add_patch(Rectangle((1.4 * k, y0), 1.4, 0.72, fc=color, ec="white", lw=2))
            ink = "white" if is_tested else INK
            axes.text(
                1.4 * k + 0.7, y0 + 0.35, text, ha="center", va="center", color=ink, fontsize=10
            )
    axes.plot((7, 7), (-0.3, 3.9), color=INK, lw=1, ls=(0, (4, 3)))
    axes.add_patch(Rectangle((7.05, 0.35), 2.95, 1.92, fc="#e3efe6", ec=GOOD, lw=1))
    axes.text(8.5, 1.3, "test:\nnever used\nfor training", ha="center", va="center", color=INK)
    axes.text(3.5, 2.5, "five folds: each is predicted by a model of the others", ha="center")
    axes.text(3.5, -0.05, "first 70 %", ha="center", va="center", color=SOFT)
    axes.text(8.5, -0.05, "last 30 %", ha="center", va="center", color=SOFT)
    arrow(axes, (0, -0.5), (10, -0.5), SOFT)
    axes.text(5, -0.62, "time", ha="center", va="top", color=SOFT, fontsize=9)
    return figure


def draw_tag(axes, x, y, cell, margin=1.0, number=7):
    """Draw a tag with a white margin of so many cells; (x, y) is the corner of its black square."""
    pattern = dictionary("4X4_50").pattern(number) == 0
    n = len(pattern)
    size = cell * (n + 2 * margin)
    axes.add_patch(Rectangle((x - margin * cell, y - margin * cell), size, size, fc=PAPER, lw=0))
    for row, column in np.argwhere(pattern):
        corner = (x + column * cell, y + (n - 1 - row) * cell)
        axes.add_patch(Rectangle(corner, cell * 1.02, cell * 1.02, fc="black", lw=0))
    return n * cell


def draw_tag_margin():
    """Draw a tag with its margin, one without it, and one that is partly covered."""
    figure, axes = new_figure(2.9, ((0, 12), (-0.95, 3.4)))
    axes.set_aspect("equal")
    texts = ("white margin,\none cell wide", "margin cut off", "partly covered")
    for k, text in enumerate(texts):
        x = 4 * k
        axes.add_patch(Rectangle((x + 0.3, 0.1), 3.4, 3.1, fc="#5d6f7d", lw=0))
        cell = 0.34
        draw_tag(axes, x + 2 - 3 * cell, 1.65 - 3 * cell, cell, margin=0.0 if k == 1 else 1.0)
        if k == 2:
            finger = FancyBboxPatch(
                (x + 2.55, 0.1),
                0.75,
                1.7,
                boxstyle="round,pad=0,rounding_size=0.36",
                fc="#e6b899",
                lw=0,
            )
            axes.add_patch(finger)
        mark, color = ("found", GOOD) if k == 0 else ("not found", BAD)
        axes.text(x + 2, -0.12, mark, ha="center", va="top", color=color, weight="bold")
        axes.text(x + 2, -0.45, text.replace("\n", " "), ha="center", va="top", fontsize=10)
    return figure


def draw_camera(axes, x, y, angle):
    """Draw a camera at a point that looks in a direction, in radians."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    body = np.array([[-0.9, -0.32], [-0.15, -0.32], [-0.15, 0.32], [-0.9, 0.32]])
    lens = np.array([[-0.15, -0.14], [0.12, -0.26], [0.12, 0.26], [-0.15, 0.14]])
    for shape in (body, lens):
        axes.fill(*(shape @ turn.T + (x, y)).T, color=INK)


def draw_depth():
    """Draw how two cameras and one camera find the position of a tag."""
    figure, axes = new_figure(2.75, ((0, 16), (-0.35, 5.15)))
    axes.set_aspect("equal")
    for left, sources in ((0, (0.9, 3.5)), (8.3, (2.2,))):
        tag = np.array([left + 6.0, 2.2])
        for y in sources:
            eye = np.array([left + 1.1, y])
            draw_camera(axes, *eye, np.arctan2(*(tag - eye)[::-1]))
            axes.plot(*zip(eye + 0.12, tag, strict=True), color=REAL, lw=1.1)
        size = (0.22, 0.28) if len(sources) > 1 else (1.25, 0.2)
        angle = np.linspace(0, 2 * np.pi, 60)
        axes.fill(
            tag[0] + size[0] * np.cos(angle), tag[1] + size[1] * np.sin(angle), color="#f3c48a"
        )
        axes.add_patch(Circle(tag, 0.09, color=INK))
        title = "several cameras" if len(sources) > 1 else "one camera"
        axes.text(left + 0.2, 4.75, title, weight="bold", va="center")
    axes.text(5.5, 0.85, "lines of sight\ncross at the tag", ha="center", va="center", fontsize=10)
    axes.text(
        13.9, 0.85, "distance only from\nthe size of the tag", ha="center", va="center", fontsize=10
    )
    axes.text(8.0, -0.1, "orange: where the tag may be", ha="center", color=SOFT, fontsize=10)
    return figure


def draw_outputs():
    """Draw what the outputs connect to."""
    figure, axes = new_figure(3.3, ((0, 16), (0, 6.6)))
    box(axes, 0.1, 2.65, 2.5, 1.3, "device\nand board", color="#dfe9f5")
    box(axes, 3.7, 2.65, 2.8, 1.3, "defsense run", color="#dfe9f5", weight="bold")
    arrow(axes, (2.65, 3.3), (3.65, 3.3))
    rows = (
        ("osc", "Blender, TouchDesigner, Max, Pure Data"),
        ("websocket", "browsers, Node-RED, Unity"),
        ("midi", "Ableton Live, synthesizers, MIDI files"),
        ("lsl", "LabRecorder, OpenViBE, MATLAB"),
        ("gamepad", "games (Linux)"),
    )
    for k, (name, programs) in enumerate(rows):
        y = 5.55 - 1.25 * k
        arrow(axes, (6.55, 3.3), (7.5, y + 0.4), SOFT, lw=1.2)
        box(axes, 7.55, y, 2.0, 0.8, name, color="#f6e3c8", family="monospace", fontsize=10)
        axes.text(9.8, y + 0.4, programs, va="center", fontsize=10.5)
    return figure


def draw_control():
    """Draw how the keys of a control change its value."""
    figure = Figure((WIDTH, 2.9), layout="constrained")
    panels = figure.subplots(1, 3)
    x = np.linspace(-1, 1, 401)
    examples = (
        ("default", Shaping()),
        ("dead_zone = 0.2, full = 0.8", Shaping(dead_zone=0.2, full=0.8)),
        ("minimum = -1, curve = 2", Shaping(minimum=-1.0, curve=2.0)),
    )
    for axes, (title, shaping) in zip(panels, examples, strict=True):
        axes.plot(x, [shaping(v) for v in x], color=REAL, lw=2)
        axes.axhline(0, color=SOFT, lw=0.7)
        axes.axvline(0, color=SOFT, lw=0.7)
        axes.set(xlim=(-1, 1), ylim=(-1.05, 1.05), xticks=(-1, 0, 1), yticks=(-1, 0, 1))
        axes.set_title(title, fontsize=9, family="monospace")
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("value of the formula", fontsize=10)
        axes.tick_params(labelsize=9)
    panels[0].set_ylabel("control", fontsize=10)
    return figure


def draw_note():
    """Draw when a control starts and ends a note."""
    figure, axes = new_figure(2.5, ((-1.3, 10.2), (-0.62, 1.12)))
    t = np.linspace(0, 10, 500)
    y = 0.36 * (1 - np.cos(2 * np.pi * t / 5)) + 0.1 * np.sin(t * 3.1) * np.sin(t / 3)
    mapping = MidiMapping("squeeze", note=60)
    high, low = mapping.threshold, mapping.threshold - mapping.hysteresis
    axes.plot(t, y, color=REAL, lw=2)
    labels = ((high, "threshold", 4.3, "bottom"), (low, "threshold - hysteresis", 6.6, "top"))
    for level, text, x, side in labels:
        axes.plot((0, 10), (level, level), color=SOFT, lw=1, ls=(0, (4, 3)))
        axes.text(-0.1, level, f"{level:.1f}", ha="right", va="center", color=SOFT, fontsize=9)
        axes.text(x, level, text, va=side, color=SOFT, fontsize=9)
    sounds, started = False, 0.0
    for now, value in zip(t, y, strict=True):
        if not sounds and value > high:
            sounds, started = True, now
        elif sounds and value < low:
            sounds = False
            box(axes, started, -0.45, now - started, 0.22, "note", color="#f6e3c8", fontsize=10)
    axes.text(-0.1, 0.0, "control", ha="right", va="center", color=REAL)
    axes.text(-0.1, -0.34, "MIDI", ha="right", va="center")
    return figure


def draw_motion_capture():
    """Draw which files of a motion capture system and of the board are combined."""
    figure, axes = new_figure(2.3, ((0, 16), (0, 4.6)))
    box(axes, 0.1, 2.7, 4.2, 1.4, "motion capture:\nwhere the markers are", color="#dfe9f5")
    box(axes, 0.1, 0.4, 4.2, 1.4, "read-out board:\nresistances of the cords", color="#dfe9f5")
    box(axes, 5.4, 3.0, 2.6, 0.8, "take.c3d", color="#f6e3c8", family="monospace", fontsize=10)
    box(axes, 5.4, 0.7, 2.6, 0.8, "session", color="#f6e3c8", family="monospace", fontsize=10)
    box(axes, 9.4, 1.55, 3.4, 1.4, "capture process:\ncompares the clocks", color="#dfe9f5")
    arrow(axes, (4.35, 3.4), (5.35, 3.4))
    arrow(axes, (4.35, 1.1), (5.35, 1.1))
    arrow(axes, (8.05, 3.4), (9.35, 2.6))
    arrow(axes, (8.05, 1.1), (9.35, 1.9))
    arrow(axes, (12.85, 2.25), (13.7, 2.25))
    box(axes, 13.75, 1.85, 2.1, 0.8, "train", color="#f6e3c8", family="monospace", fontsize=10)
    return figure


#: Cycles of an ideal signal, of which the last one is drawn.
CYCLE_S, CYCLES, RATE_HZ, LARGEST_SIGNAL = 10.0, 6, 50.0, 0.2


def draw_families():
    """Draw signals of the three families of memory over those of ideal cords."""
    figure = Figure((WIDTH, 2.9), layout="constrained")
    panels = figure.subplots(1, 3, sharex=True)
    time = np.arange(0, CYCLE_S * CYCLES, 1 / RATE_HZ)
    kept = time >= CYCLE_S * (CYCLES - 1)
    for axes, (name, family) in zip(panels, CORD_FAMILIES.items(), strict=True):
        ideal = LARGEST_SIGNAL / 2 * (1 - np.cos(2 * np.pi * time / CYCLE_S))
        traits = RubberTraits(family(), noise=0.0, contact=0.0)
        rng = np.random.default_rng(3)
        pieces = RubberPieces.draw(traits, np.array([1000.0]), rng)
        state = RubberState.new(traits, 1)
        response, _ = pieces.respond(time, ideal[:, None], state.memory)
        signal = np.asarray(response)[kept, 0]
        half = len(signal) // 2
        axes.plot(100 * ideal[kept], 100 * ideal[kept], color=SOFT, lw=1, ls=(0, (4, 3)))
        axes.plot(100 * ideal[kept][:half], 100 * signal[:half], color=REAL, lw=1.8)
        axes.plot(100 * ideal[kept][half:], 100 * signal[half:], color=SHOWN, lw=1.8)
        axes.set_title(name, fontsize=11, family="monospace")
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_xlabel("ideal signal, %", fontsize=10)
        axes.tick_params(labelsize=9)
    panels[0].set_ylabel("measured signal, %", fontsize=10)
    labels = (("stretched", REAL, "-"), ("released", SHOWN, "-"), ("without memory", SOFT, "--"))
    handles = [matplotlib.lines.Line2D([], [], color=c, ls=ls, label=t) for t, c, ls in labels]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=10)
    return figure


DRAWINGS = {
    "error": draw_error,
    "scale": draw_scale,
    "errors": draw_errors,
    "folds": draw_folds,
    "tag-margin": draw_tag_margin,
    "depth": draw_depth,
    "outputs": draw_outputs,
    "families": draw_families,
    "control": draw_control,
    "note": draw_note,
    "motion-capture": draw_motion_capture,
}


def main():
    """Draw all, or those that are named."""
    with matplotlib.rc_context(STYLE):
        for name in sys.argv[1:] or DRAWINGS:
            path = HERE / f"{name}.svg"
            DRAWINGS[name]().savefig(path, metadata={"Date": None})
            text = path.read_text(encoding="utf-8")
            path.write_text(re.sub(r"[ \t]+$", "", text, flags=re.MULTILINE), encoding="utf-8")


if __name__ == "__main__":
    main()
