"""Draw the cross-section of a pad of a printed trace, in millimetres, as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from ...core.device.pads import PadSpec

_PX_PER_MM = 26.0
_BODY, _FILAMENT, _METAL, _THREAD = "#e8dfd0", "#3b4a54", "#b9c3ca", "#c0392b"
_INK, _AIR = "#1b262c", "#ffffff"
_HALF_WIDTH_MM = 5.6  # of the body that is shown
_BELOW_MM, _ABOVE_MM = 1.9, 1.0  # around the pad and the fastener
_LABELS_MM = 6.4  # to the right of the body
_STEM_MM = 1.2  # width of the trace below the pad
_LABEL_STEP_MM = 0.72
_FONT_PX = 15


class _Drawing:
    """SVG elements in millimetres, with x from the pad's axis and z up from the skin."""

    def __init__(self, top: float, bottom: float) -> None:
        self._top, self._bottom = top, bottom
        self._elements: list[str] = []

    def rectangle(
        self, x: tuple[float, float], z: tuple[float, float], color: str, outline: str = _INK
    ) -> None:
        (left, right), (low, high) = x, z
        a, b = self._place(left, high), self._place(right, low)
        self._elements.append(
            f'<rect x="{a[0]:.1f}" y="{a[1]:.1f}" width="{b[0] - a[0]:.1f}"'
            f' height="{b[1] - a[1]:.1f}" fill="{color}" stroke="{outline}" stroke-width="1"/>'
        )

    def line(self, points: Sequence[tuple[float, float]], color: str, width: float) -> None:
        places = " ".join("{:.1f},{:.1f}".format(*self._place(*p)) for p in points)
        self._elements.append(
            f'<polyline points="{places}" fill="none" stroke="{color}" stroke-width="{width:g}"/>'
        )

    def text(self, at: tuple[float, float], text: str, anchor: str = "start") -> None:
        x, y = self._place(*at)
        self._elements.append(
            f'<text x="{x:.1f}" y="{y + _FONT_PX / 3:.1f}" text-anchor="{anchor}"'
            f' fill="{_INK}">{escape(text)}</text>'
        )

    def as_svg(self, title: str) -> str:
        width = (2 * _HALF_WIDTH_MM + _LABELS_MM) * _PX_PER_MM
        height = (self._top - self._bottom) * _PX_PER_MM
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}"'
            f' width="{width:.0f}" height="{height:.0f}" font-family="sans-serif"'
            f' font-size="{_FONT_PX}"><title>{escape(title)}</title>'
            f'<rect width="100%" height="100%" fill="{_AIR}"/>{"".join(self._elements)}</svg>\n'
        )

    def _place(self, x: float, z: float) -> tuple[float, float]:
        return (x + _HALF_WIDTH_MM) * _PX_PER_MM, (self._top - z) * _PX_PER_MM


def draw_pad(pad: PadSpec) -> str:
    """Return the cross-section of a pad with its fastener and sizes, as the text of an SVG file.

    The sizes are those of the solids that are printed.

    Args:
        pad: The pad.
    """
    top = max([0.6, *(f.high for f in pad.fasteners)]) + _ABOVE_MM
    bottom = -pad.depth - _BELOW_MM
    drawing = _Drawing(top, bottom)
    radius = pad.diameter / 2
    drawing.rectangle((-_HALF_WIDTH_MM, _HALF_WIDTH_MM), (bottom, 0.0), _BODY)
    drawing.rectangle((-_STEM_MM / 2, _STEM_MM / 2), (bottom, -pad.depth), _FILAMENT)
    drawing.rectangle((-radius, radius), (-pad.depth, 0.0), _FILAMENT)
    _draw_holes(drawing, pad)
    for fastener in pad.fasteners:
        half = fastener.diameter / 2
        drawing.rectangle((-half, half), (fastener.low, fastener.high), _METAL)
    if pad.hole_spacing:
        _draw_thread(drawing, pad)
    _draw_depths(drawing, pad)
    _draw_labels(drawing, pad, top)
    return drawing.as_svg(f"Pad for {pad.name}: cross-section, mm")


def _draw_holes(drawing: _Drawing, pad: PadSpec) -> None:
    half = pad.hole_diameter / 2
    for x in pad.hole_offsets:
        drawing.rectangle((x - half, x + half), (-pad.hole_depth, 0.0), _AIR, _AIR)
    if pad.hole_spacing:
        low = -pad.hole_depth
        reach = pad.hole_spacing / 2
        drawing.rectangle((-reach, reach), (low, low + pad.hole_diameter), _AIR, _AIR)


def _draw_thread(drawing: _Drawing, pad: PadSpec) -> None:
    """Draw a loop of thread around the bridge between two holes."""
    low = -pad.hole_depth + pad.hole_diameter / 2
    left, right = pad.hole_offsets
    loop = [(left, 0.25), (left, low), (right, low), (right, 0.25), (left, 0.25)]
    drawing.line([*loop, (left - 2.2, 0.6)], _THREAD, 4)


def _draw_depths(drawing: _Drawing, pad: PadSpec) -> None:
    """Draw the depths of the pad and of its holes to the left of them."""
    for x, depth in ((-4.3, pad.depth), (-_HALF_WIDTH_MM + 0.45, pad.hole_depth)):
        drawing.line([(x, 0.0), (x, -depth)], _INK, 1)
        drawing.line([(x - 0.15, -depth), (x + 0.15, -depth)], _INK, 1)
        drawing.line([(x - 0.15, 0.0), (x + 0.15, 0.0)], _INK, 1)
        drawing.text((x + 0.1, -depth - 0.35), f"{depth:g}", "middle")


def _draw_labels(drawing: _Drawing, pad: PadSpec, top: float) -> None:
    """Draw the names and sizes at the right, each with a line to what it names."""
    edge = pad.hole_offsets[-1] + pad.hole_diameter / 2
    holes = f"{len(pad.hole_offsets)} holes" if pad.hole_spacing else "hole"
    targets = [
        ((f.diameter / 2, (f.low + f.high) / 2), f"{f.name} Ø {f.diameter:g}")
        for f in pad.fasteners
    ]
    if pad.hole_spacing:
        bridge = pad.hole_depth - pad.hole_diameter
        targets.append(((pad.hole_offsets[-1], 0.2), "conductive thread"))
        targets.append(((0.5, -bridge / 2), f"bridge, {bridge:.2g} thick"))
    targets += [
        ((edge, 0.1 - pad.hole_depth), f"{holes} Ø {pad.hole_diameter:g}"),
        ((pad.diameter / 2, 0.1 - pad.depth), f"pad Ø {pad.diameter:g}"),
        ((_STEM_MM / 2, -pad.depth - 0.8), "trace"),
        ((_HALF_WIDTH_MM - 0.6, -pad.depth - 1.5), "body"),
    ]
    z, start = top, _HALF_WIDTH_MM + 0.3
    for target, text in sorted(targets, key=lambda item: -item[0][1]):
        z = min(z - _LABEL_STEP_MM, target[1])
        drawing.line([target, (start - 0.1, z)], "#7a868d", 1)
        drawing.text((start, z), text)
