"""The standard device of a body: two bends of its ends along its longest axis, two cords."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from defsense_fab.core.mesh import Surface

#: Of the body's length, what an end holds; about how many tets it has; their edges, mm.
_END, _TETS, _EDGES = 0.1, 5000, (3.0, 12.0)


def write_device(folder: Path, body: Path, surface: Surface, scale: float = 1.0) -> None:
    """`device.toml` in `folder` for the file `body` there, whose surface (mm, scaled) is given."""
    low, high = surface.bounds
    along = int((high - low).argmax())
    size = float((high - low).max())
    edge = float(np.clip(np.cbrt(8.5 * surface.volume / _TETS), *_EDGES))
    axes = [k for k in range(3) if k != along]
    text = [
        f'schema = 1\nname = "{folder.name}"\n\n[body]\nmesh = "{body.name}"\nscale = {scale}\n',
        '[material]\nname = "silicone-shore-30a"\n',
        f"[mesh]\nedge_length = {edge:.3g}\n\n[regions]",
    ]
    for name, at, sign in (("base", low, -1), ("tip", high, 1)):
        origin, normal = [0.0, 0.0, 0.0], [0, 0, 0]
        origin[along] = float(at[along] - sign * _END * size)
        normal[along] = sign
        text.append(f"{name} = {{ half_space = {{ origin = {origin}, normal = {normal} }} }}")
    for name, k in zip(("nod", "sway"), axes, strict=True):
        axis = [int(i == k) for i in range(3)]
        text.append(
            f'\n[[poses]]\nname = "{name}"\nfixed = ["base"]\n[[poses.handles]]\nregion = "tip"\n'
            f'rotate = {{ axis = {axis}, degrees = 25 }}\ntranslate = "free"'
        )
    text.append(
        '\n[outputs]\nmarkers = 30\nanchor = "base"\n\n[cord]\nname = "rubber-2mm"\nnoise = 0.002\n'
        '\n[fabrication]\nprocess = "fdm-tpu"\n\n[design]\nsensors = 2\n'
    )
    (folder / "device.toml").write_text("\n".join(text))
