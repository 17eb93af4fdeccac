"""A mesh whose colours are those of its numbers: no lamp shines on it.

What the page draws is lit, and goes through a curve that a film would have (ACES, as three.js has
it). A glTF material without light, with colours that the curve maps to those wanted, is exact to
some hundredths.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from ...core.arrays import Float, Int

#: Of three.js' ACESFilmicToneMapping: into and out of its space, the curve between.
_INTO = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_P, _Q, _R, _S, _T = 0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081
_EXPOSURE = 0.6
_MOST = 0.985  # where the curve is nearly level, no input is asked for
_FLOAT, _WHOLE = 5126, 5125  # glTF's numbers for types


def unlit_mesh(vertices: Float, triangles: Int, colors: Float) -> bytes:
    """GLB of vertices (v, 3), triangles (t, 3) seen from both sides, and their colours (v, 3) from
    0 to 1 as a screen shows them."""
    parts = [
        np.asarray(vertices, "<f4"),
        np.asarray(_before_the_curve(colors), "<f4"),
        np.asarray(triangles, "<u4").ravel(),
    ]
    chunks = [part.tobytes() for part in parts]
    starts = np.cumsum([0, *map(len, chunks)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": at, "byteLength": len(c)}
        for at, c in zip(starts, chunks, strict=False)
    ]
    accessors: list[dict[str, Any]] = [
        {"bufferView": k, "componentType": _FLOAT, "count": len(parts[k]), "type": "VEC3"}
        for k in range(2)
    ]
    accessors[0] |= {"min": parts[0].min(axis=0).tolist(), "max": parts[0].max(axis=0).tolist()}
    accessors.append(
        {"bufferView": 2, "componentType": _WHOLE, "count": len(parts[2]), "type": "SCALAR"}
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
    whole = 12 + 8 + len(text) + 8 + len(body)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, whole),
            struct.pack("<I4s", len(text), b"JSON"), text,
            struct.pack("<I4s", len(body), b"BIN\0"), body,
        ]
    )  # fmt: skip


def _before_the_curve(colors: Float) -> Float:
    """What three.js has to be given that it shows the colours (v, 3)."""
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    y = np.clip(np.linalg.solve(_OUT, linear.T).T, 0.0, _MOST)
    # y = (x^2 + p x - q) / (r x^2 + s x + t)
    a, b, c = 1 - _R * y, _P - _S * y, -_Q - _T * y
    x = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return np.asarray(np.maximum(np.linalg.solve(_INTO, x.T).T, 0.0) * _EXPOSURE)
