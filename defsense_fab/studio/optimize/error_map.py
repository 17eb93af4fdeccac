"""By how much the device misses its own surface in every state, as colours on it."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError
from ...report.surface_errors import surface_errors, SurfaceErrors
from ...store.build import Build
from ...store.layout import LayoutRecord, load_layout
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench

# Numbers as colours, and the bar that tells which is which.

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


_OFF = "off"
_NOTHING = "Nothing is optimised yet: the map is of the optimised cords."


@dataclass(frozen=True)
class _Known:
    errors: SurfaceErrors
    layout: LayoutRecord


class ErrorMap:
    """Of the cords of the last build, by the numbers of its report; one state at a time, on one
    scale for all."""

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._known: _Known | None = None
        self._mesh: Any = None
        self._state, self._entered = _OFF, False
        self.worker = LatestWorker(self._work, bench.show_error)

    def add_panel(self) -> None:
        """The state, and the scale."""
        gui = self._bench.server.gui
        self._list = gui.add_dropdown("State", (_OFF,), hint="Its error on the surface")
        self._list.on_update(lambda event: self._asked(event))
        self._moved = gui.add_checkbox("Deformed", True, hint="Or on the body at rest")
        self._moved.on_update(lambda event: self._asked(event))
        self._bar = gui.add_html("")
        self._told = gui.add_markdown(_NOTHING)

    def load(self) -> None:
        """There is another build; its poses are read when a state is chosen."""
        folder = build_folder(self._bench.project.device)
        self._known = None
        try:
            names = tuple(load_layout(folder).prediction.per_state)
        except (DefsenseError, OSError):
            names = ()
        self._list.options = (_OFF, *(n for n in names if n != "rest"))
        self._told.content = "Choose a state." if names else _NOTHING
        self.choose(_OFF)

    def choose(self, state: str) -> None:
        """Show a state, or nothing."""
        self._state = self._list.value = state
        self.worker.give(None)

    def enter(self) -> None:
        """The caller has the `drawing` lock."""
        self._entered = True
        self.worker.give(None)

    def leave(self) -> None:
        """The caller has the `drawing` lock."""
        self._entered = False
        self._remove()

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _asked(self, event: Any) -> None:
        if event.client is not None:
            self.choose(self._list.value)

    def _work(self, _: None) -> None:
        state, known = self._state, self._known
        if state != _OFF and self._entered and known is None:
            self._told.content = "Reading the poses ..."
            folder = build_folder(self._bench.project.device)
            build = Build(folder)
            known = self._known = _Known(surface_errors(build), build.layout)
            self._list.options = (_OFF, *known.errors.names)
            self._list.value = state
        with self._bench.drawing_lock:
            self._remove()
            if known is not None and state in known.errors.names and self._entered:
                self._draw(known, state)
            elif known is not None:
                self._bar.content, self._told.content = "", "Choose a state."

    def _draw(self, known: _Known, state: str) -> None:
        errors, at = known.errors, known.errors.names.index(state)
        vertices = errors.rest + errors.moved[at] if self._moved.value else errors.rest
        mesh = colored(vertices, errors.faces, errors.error[at], errors.highest)
        self._mesh = self._bench.server.scene.add_mesh_trimesh("/error_map", mesh)
        if self._bench.body is not None:
            self._bench.body.visible = False
        self._bar.content = color_bar(errors.highest, float(errors.error.max()), "mm, all states")
        told = known.layout.prediction
        expected = {**told.per_state, **told.held_out}.get(state)
        noise = "" if expected is None else f"; **{expected:.2f} mm** at the markers with noise"
        seen = "held out of the design" if errors.held_out[at] else "designed for"
        self._told.content = (
            f"{html.escape(state)} ({seen}): **{errors.mean(at):.2f} mm** over the surface without"
            f" noise, at most {float(np.max(errors.error[at])):.2f} mm{noise}. Of the cords of the"
            " last build, as its report has it."
        )

    def _remove(self) -> None:
        if self._mesh is not None:
            self._mesh.remove()
            self._mesh = None
            if self._bench.body is not None:
                self._bench.body.visible = True
