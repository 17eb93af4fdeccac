"""Color scales for color-blind people, their color bars, and meshes in exactly these colors."""

from __future__ import annotations

import html
import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int

#: Blue below zero and orange above (ColorBrewer's RdBu and PuOr); cividis; viridis.
DIVERGING = (
    (5, 48, 97),
    (33, 102, 172),
    (67, 147, 195),
    (146, 197, 222),
    (209, 229, 240),
    (220, 220, 220),
    (254, 224, 182),
    (253, 184, 99),
    (224, 130, 20),
    (179, 88, 6),
    (127, 59, 8),
)
CIVIDIS = (
    (0, 34, 78),
    (18, 53, 112),
    (59, 73, 108),
    (87, 93, 109),
    (112, 113, 115),
    (138, 134, 120),
    (165, 156, 116),
    (195, 179, 105),
    (225, 204, 85),
    (254, 232, 56),
)
VIRIDIS = (
    (68, 1, 84),
    (72, 40, 120),
    (62, 74, 137),
    (49, 104, 142),
    (38, 130, 142),
    (31, 158, 137),
    (53, 183, 121),
    (109, 205, 89),
    (180, 222, 44),
    (253, 231, 37),
)
UNKNOWN_COLOR = (150, 150, 150)
_MIN_GAIN_SPREAD = 0.03  # share of the largest gain; smaller differences must not look large
#: Ends of ranges, times a power of ten; their quarters have few digits.
_ROUND_ENDS = (1.0, 1.2, 1.6, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)
_MINUS = "\u2212"

# Layout of the color bar, in pixels of its drawing.
_BAR_WIDTH, _BAR_HEIGHT, _BAR_MARGIN, _BAR_THICKNESS = 280, 44, 24, 18
_BAR_STEPS = 64
_BAR_TICKS = 5

# ACES tone mapping of three.js (ACESFilmicToneMapping): matrices into and out of its color space,
# and the curve y = (x^2 + p x - q) / (r x^2 + s x + t) between them.
_ACES_INPUT = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_ACES_OUTPUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_ACES_P, _ACES_Q = 0.0245786, 0.000090537
_ACES_R, _ACES_S, _ACES_T = 0.983729, 0.4329510, 0.238081
_ACES_EXPOSURE = 0.6
_MAX_TONE_MAPPED = 0.985  # the curve is nearly level above and cannot be inverted

_GLTF_FLOAT, _GLTF_UINT = 5126, 5125  # component types


@dataclass(frozen=True)
class ColorScale:
    """Colors of the numbers from `low` to `high`.

    Numbers beyond the ends have the color of the end; unknown numbers (NaN) are gray.

    Attributes:
        low: Lower end.
        high: Upper end.
        anchors: RGB colors (0 to 255) at equal distances from `low` to `high`.
    """

    low: float
    high: float
    anchors: tuple[tuple[int, int, int], ...]

    @classmethod
    def symmetric(cls, reach: float) -> ColorScale:
        """Return a scale from -reach to reach, which is rounded up."""
        end = round_up(reach)
        return cls(-end, end, DIVERGING)

    @classmethod
    def from_zero(cls, reach: float) -> ColorScale:
        """Return a scale from 0 to `reach`, which is rounded up."""
        return cls(0.0, round_up(reach), CIVIDIS)

    @classmethod
    def for_gains(cls, values: Float) -> ColorScale:
        """Return a scale for gains: from the smallest to the largest positive number.

        It starts at 0 if the numbers are nearly equal, so that small differences do not look large.
        """
        gains = np.maximum(values[np.isfinite(values)], 0.0)
        high = float(gains.max(initial=0.0)) or 1.0
        low = float(gains.min(initial=high))
        return cls(low if high - low > _MIN_GAIN_SPREAD * high else 0.0, high, VIRIDIS)

    def colors(self, values: Float) -> Float:
        """Return the sRGB colors (n, 3), 0 to 1, of values (n,)."""
        table = np.array(self.anchors) / 255
        is_known = np.isfinite(values)
        share = np.where(is_known, (values - self.low) / (self.high - self.low), 0.0)
        position = np.clip(share, 0, 1) * (len(table) - 1)
        colors = np.stack(
            [np.interp(position, np.arange(len(table)), channel) for channel in table.T], axis=1
        )
        colors[~is_known] = np.array(UNKNOWN_COLOR) / 255
        return colors


def round_up(value: float) -> float:
    """Return the next number with few digits, at least 1e-6."""
    if not np.isfinite(value) or value < 1e-12:
        return 1e-6
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(r for r in (*_ROUND_ENDS, 10.0) if r * power >= value * (1 - 1e-9)) * power)


def color_bar(scale: ColorScale, title: str, unit: str, note: str) -> str:
    """Return a color bar with numbers below it as HTML.

    Its text has the page's own color, light or dark.

    Args:
        scale: The color scale.
        title: Text above the bar.
        unit: Unit of the numbers; may be empty.
        note: Text below the bar.
    """
    width = _BAR_WIDTH - 2 * _BAR_MARGIN
    step = width / _BAR_STEPS
    middles = scale.low + (np.arange(_BAR_STEPS) + 0.5) / _BAR_STEPS * (scale.high - scale.low)
    rgb = np.rint(255 * scale.colors(middles)).astype(int).tolist()
    boxes = "".join(
        f'<rect x="{_BAR_MARGIN + k * step:.2f}" y="2" width="{step + 0.4:.2f}"'
        f' height="{_BAR_THICKNESS}" fill="rgb({r},{g},{b})"/>'
        for k, (r, g, b) in enumerate(rgb)
    )
    bottom = _BAR_THICKNESS + 2
    ticks = "".join(
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{bottom}" y2="{bottom + 5}" stroke="currentColor"/>'
        f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{label}</text>'
        for x, label in zip(
            np.linspace(_BAR_MARGIN, _BAR_MARGIN + width, _BAR_TICKS),
            tick_labels(scale),
            strict=True,
        )
    )
    unit_text = f" ({html.escape(unit)})" if unit else ""
    return (
        '<div style="padding:0 0.8em;font-size:0.85em">'
        f"<div><b>{html.escape(title)}</b>{unit_text}</div>"
        f'<svg viewBox="0 0 {_BAR_WIDTH} {_BAR_HEIGHT}" width="100%" role="img"'
        f' aria-label="{html.escape(title)}" font-size="11" fill="currentColor">'
        f"{boxes}{ticks}</svg>"
        f'<div style="opacity:0.8">{html.escape(note)}</div></div>'
    )


def tick_labels(scale: ColorScale) -> list[str]:
    """Return the numbers below the color bar, at equal distances from end to end."""
    values = np.linspace(scale.low, scale.high, _BAR_TICKS)
    return [f"{value + 0.0:.3g}".replace("-", _MINUS) for value in values.tolist()]


def unlit_mesh(vertices: Float, triangles: Int, colors: Float) -> bytes:
    """Return a mesh as GLB whose colors on the screen are exact to some hundredths.

    The page lights its meshes and applies the ACES tone mapping of three.js. This mesh has a glTF
    material without light, and its colors are passed through the inverse of the tone mapping.

    Args:
        vertices: (v, 3) mm.
        triangles: (t, 3) indices of vertices; visible from both sides.
        colors: (v, 3) sRGB colors on the screen, 0 to 1.
    """
    parts = [
        np.asarray(vertices, "<f4"),
        np.asarray(_invert_tone_mapping(colors), "<f4"),
        np.asarray(triangles, "<u4").ravel(),
    ]
    chunks = [part.tobytes() for part in parts]
    starts = np.cumsum([0, *map(len, chunks)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(chunk)}
        for start, chunk in zip(starts, chunks, strict=False)
    ]
    accessors: list[dict[str, Any]] = [
        {"bufferView": k, "componentType": _GLTF_FLOAT, "count": len(parts[k]), "type": "VEC3"}
        for k in range(2)
    ]
    accessors[0] |= {"min": parts[0].min(axis=0).tolist(), "max": parts[0].max(axis=0).tolist()}
    accessors.append(
        {"bufferView": 2, "componentType": _GLTF_UINT, "count": len(parts[2]), "type": "SCALAR"}
    )
    attributes = {"POSITION": 0, "COLOR_0": 1}
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "materials": [{"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(chunks)
    size = 12 + 8 + len(text) + 8 + len(body)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, size),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(body), b"BIN\0"),
            body,
        ]
    )


def _invert_tone_mapping(colors: Float) -> Float:
    """Return the linear colors that three.js shows as the sRGB colors (v, 3)."""
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    y = np.clip(np.linalg.solve(_ACES_OUTPUT, linear.T).T, 0.0, _MAX_TONE_MAPPED)
    a, b, c = 1 - _ACES_R * y, _ACES_P - _ACES_S * y, -_ACES_Q - _ACES_T * y
    x = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return np.asarray(np.maximum(np.linalg.solve(_ACES_INPUT, x.T).T, 0.0) * _ACES_EXPOSURE)
