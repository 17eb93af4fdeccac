"""Show the error of the device's surface in a state as colors on the surface."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError
from ...report.surface_errors import SurfaceErrors, surface_errors
from ...store.build import Build
from ...store.layout import LayoutRecord, load_layout
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench

_COLOR_MAP = "viridis"  # for color-blind people, and visible on light and dark pages
_BAR_STEPS, _TEXTURE_WIDTH = 16, 256
_OFF = "off"
_NOT_OPTIMIZED = "Optimize the cords first. The map shows the error of the optimized cords."
_NO_STATE = "Choose a state."


class ErrorMap:
    """Show the errors of the last build's report, one state at a time, on one scale.

    Args:
        bench: The workbench.

    Attributes:
        worker: Computes and draws the map.
        bar: The color bar as HTML; empty while no state is shown.
        status: What the panel shows.
        shown_error: Root mean square error of the shown state over the surface, mm, or None.
    """

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._errors: _BuildErrors | None = None
        self._mesh: Any = None
        self._state, self._is_active = _OFF, False
        self.bar, self.status = "", "not-optimized"
        self.shown_error: float | None = None
        self.worker = LatestWorker(self._update, bench.show_error)

    @property
    def is_shown(self) -> bool:
        """Whether the map is in the scene."""
        return self._mesh is not None

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui = self._bench.server.gui
        self._list = gui.add_dropdown(
            "State", (_OFF,), hint="Choose the state whose error is shown on the surface"
        )
        self._list.on_update(self._choose_from_list)
        self._is_deformed = gui.add_checkbox(
            "Deformed", True, hint="Show the deformed surface instead of the surface at rest"
        )
        self._is_deformed.on_update(self._choose_from_list)
        self._bar = gui.add_html("")
        self._text = gui.add_markdown(_NOT_OPTIMIZED)

    def load(self) -> None:
        """Follow another build; its poses are read once a state is chosen."""
        folder = build_folder(self._bench.project.device)
        self._errors = None
        try:
            names = tuple(load_layout(folder).prediction.per_state)
        except (DefsenseError, OSError):
            names = ()
        self._list.options = (_OFF, *(name for name in names if name != "rest"))
        if names:
            self._show_status("no-state", _NO_STATE)
        else:
            self._show_status("not-optimized", _NOT_OPTIMIZED)
        self.choose(_OFF)

    def choose(self, state: str) -> None:
        """Show the error in a state, or nothing for "off"."""
        self._state = self._list.value = state
        self.worker.give(None)

    def enter(self) -> None:
        """Show the map, while the drawing lock is held."""
        self._is_active = True
        self.worker.give(None)

    def leave(self) -> None:
        """Hide the map, while the drawing lock is held."""
        self._is_active = False
        self._remove()

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _choose_from_list(self, event: Any) -> None:
        if event.client is not None:
            self.choose(self._list.value)

    def _update(self, _: None) -> None:
        state, loaded = self._state, self._errors
        if state != _OFF and self._is_active and loaded is None:
            self._show_status("loading", "Reading the poses ...")
            build = Build(build_folder(self._bench.project.device))
            loaded = self._errors = _BuildErrors(surface_errors(build), build.layout)
            self._list.options = (_OFF, *loaded.errors.names)
            self._list.value = state
        with self._bench.drawing_lock:
            self._remove()
            if loaded is not None and state in loaded.errors.names and self._is_active:
                self._draw(loaded, state)
            elif loaded is not None:
                self.bar = self._bar.content = ""
                self._show_status("no-state", _NO_STATE)

    def _draw(self, loaded: _BuildErrors, state: str) -> None:
        errors, index = loaded.errors, loaded.errors.names.index(state)
        is_deformed = self._is_deformed.value
        vertices = errors.rest + errors.moved[index] if is_deformed else errors.rest
        mesh = colored_mesh(vertices, errors.faces, errors.error[index], errors.highest)
        self._mesh = self._bench.server.scene.add_mesh_trimesh("/error_map", mesh)
        if self._bench.body is not None:
            self._bench.body.visible = False
        largest = float(errors.error.max())
        self.bar = self._bar.content = color_bar(errors.highest, largest, "mm, all states")
        prediction = loaded.layout.prediction
        expected = {**prediction.per_state, **prediction.held_out}.get(state)
        mean = errors.mean(index)
        lines = [
            f"State: {html.escape(state)}"
            f" ({'held out of' if errors.held_out[index] else 'used in'} the optimization)",
            f"Error over the surface without noise (RMS): **{mean:.2f} mm**",
            f"Largest error: {float(np.max(errors.error[index])):.2f} mm",
        ]
        if expected is not None:
            lines.append(f"Error at the markers with noise: **{expected:.2f} mm**")
        lines.append("The map shows the cords of the last build; its report has the same numbers.")
        self._show_status("shown", "  \n".join(lines))
        self.shown_error = mean

    def _show_status(self, status: str, text: str) -> None:
        self.status, self.shown_error = status, None
        self._text.content = text

    def _remove(self) -> None:
        if self._mesh is not None:
            self._mesh.remove()
            self._mesh = None
            if self._bench.body is not None:
                self._bench.body.visible = True


@dataclass(frozen=True)
class _BuildErrors:
    errors: SurfaceErrors
    layout: LayoutRecord


def colored_mesh(vertices: Float, faces: Int, values: Float, top: float) -> Any:
    """Return a `trimesh.Trimesh` in the colors of values at its vertices.

    The mesh is emissive and otherwise black, so that light and shade do not change the colors.
    Between vertices the values are interpolated, not the colors.

    Args:
        vertices: (n, 3) mm.
        faces: (f, 3) indices of vertices.
        values: (n,) values from 0 to `top`; larger ones have the color of `top`.
        top: Upper end of the color scale.
    """
    import trimesh
    from PIL import Image

    visual: Any = trimesh.visual

    row = (_color_map()(np.linspace(0, 1, _TEXTURE_WIDTH), bytes=True)[:, :3]).astype(np.uint8)
    image = Image.fromarray(np.repeat(row[None], 2, axis=0))
    share = np.clip(values / max(top, 1e-12), 0, 1)
    # From the middle of the first texel to the middle of the last one.
    u = (0.5 + share * (_TEXTURE_WIDTH - 1)) / _TEXTURE_WIDTH
    material = visual.material.PBRMaterial(
        emissiveTexture=image,
        emissiveFactor=[1.0, 1.0, 1.0],
        baseColorFactor=[0, 0, 0, 255],
        metallicFactor=1.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    texture = visual.TextureVisuals(
        uv=np.stack([u, np.full(len(share), 0.5)], axis=1), material=material
    )
    return trimesh.Trimesh(vertices, faces, visual=texture, process=False)


def color_bar(top: float, largest: float, unit: str) -> str:
    """Return a color bar from 0 to `top` as HTML.

    Args:
        top: Upper end of the color scale.
        largest: Largest value; the bar notes it if it is above `top`.
        unit: Unit of the values, and their scope.
    """
    stops = ", ".join(
        "rgb({}, {}, {})".format(*_color_map()(k / _BAR_STEPS, bytes=True)[:3])
        for k in range(_BAR_STEPS + 1)
    )
    ticks = "".join(f"<span>{top * k / 4:.3g}</span>" for k in range(5))
    beyond = f"; brightest color: up to {largest:.3g}" if largest > top else ""
    return (
        f'<div style="padding: 0 0.8em; font-size: 0.8em"><div style="height: 1em; background:'
        f' linear-gradient(to right, {stops})"></div><div style="display: flex; justify-content:'
        f' space-between">{ticks}</div><div>{unit}{beyond}</div></div>'
    )


def _color_map() -> Callable[..., Any]:
    from matplotlib import colormaps

    return colormaps[_COLOR_MAP]
