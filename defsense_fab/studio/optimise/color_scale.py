"""Numbers as colours, and the bar that tells which is which."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float, Int

_NAME = "viridis"  # told apart by the colour-blind, and seen on light and dark pages
_STEPS, _TEXELS = 16, 256  # of the bar, and of the colours on a surface


def colored(vertices: Float, faces: Int, values: Float, top: float) -> Any:
    """A trimesh.Trimesh of vertices (n, 3) mm and faces (f, 3) in the colours of values (n,)
    between 0 and `top`; those above have its colour. It shines by itself and is black besides, so
    that light and shade do not change what the bar tells; between vertices values are interpolated,
    not colours."""
    import trimesh
    from PIL import Image

    looks: Any = trimesh.visual

    row = (_map()(np.linspace(0, 1, _TEXELS), bytes=True)[:, :3]).astype(np.uint8)
    image = Image.fromarray(np.repeat(row[None], 2, axis=0))
    share = np.clip(values / max(top, 1e-12), 0, 1)
    middle = (0.5 + share * (_TEXELS - 1)) / _TEXELS  # of the first texel to that of the last
    material = looks.material.PBRMaterial(
        emissiveTexture=image, emissiveFactor=[1.0, 1.0, 1.0], baseColorFactor=[0, 0, 0, 255],
        metallicFactor=1.0, roughnessFactor=1.0, doubleSided=True,
    )  # fmt: skip
    visual = looks.TextureVisuals(
        uv=np.stack([middle, np.full(len(share), 0.5)], axis=1), material=material
    )
    return trimesh.Trimesh(vertices, faces, visual=visual, process=False)


def color_bar(top: float, largest: float, unit: str) -> str:
    """HTML: from 0 to `top`, and up to which number what is beyond has the last colour."""
    stops = ", ".join(
        "rgb({}, {}, {})".format(*_map()(k / _STEPS, bytes=True)[:3]) for k in range(_STEPS + 1)
    )
    ticks = "".join(f"<span>{top * k / 4:.3g}</span>" for k in range(5))
    beyond = f"; the brightest up to {largest:.3g}" if largest > top else ""
    return (
        f'<div style="padding: 0 0.8em; font-size: 0.8em"><div style="height: 1em; background:'
        f' linear-gradient(to right, {stops})"></div><div style="display: flex; justify-content:'
        f' space-between">{ticks}</div><div>{unit}{beyond}</div></div>'
    )


def _map() -> Callable[..., Any]:
    from matplotlib import colormaps

    return colormaps[_NAME]
