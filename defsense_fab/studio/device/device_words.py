"""What is said of a device and its build."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...core.device.device import Device
from ...core.mesh import Surface

#: Of each stage whose result is of the device before, the first of which is told.
_OLD = {
    "body": "The poses were simulated for the body before: simulate them again.",
    "mesh": "The poses were simulated with another mesh or other regions: simulate them again.",
    "simulate": "The material or the poses have changed since: simulate the poses again.",
    "optimize": "The cords were optimised for other settings: optimise them again.",
    "fabricate": "The parts are of the device before: build them again.",
    "report": "The report is of the device before: build everything again.",
}
_THERE = {
    "body": "body",
    "mesh": "mesh",
    "simulate": "poses",
    "optimize": "cords",
    "fabricate": "parts",
    "report": "report",
}


def build_words(states: Mapping[str, str]) -> str:
    """What of the build is out of date, in one sentence; what of it there is otherwise."""
    there = [name for name, state in states.items() if state != "missing"]
    if not {"simulate", "optimize"} & set(there):
        return "Nothing is simulated yet."
    for name, state in states.items():
        if state == "old":
            return f"**{_OLD[name]}**"
    return f"What was made is up to date: {', '.join(_THERE[name] for name in there)}."


def body_words(surface: Surface | None) -> str:
    """Its size and volume."""
    if surface is None:
        return "The body has not been made yet: *Make the body* does it."
    size = " × ".join(f"{x:.4g}" for x in np.ptp(surface.vertices, axis=0))
    return f"{size} mm, {surface.volume / 1000:.4g} cm³"


def material_words(device: Device) -> str:
    """What matters of the material, cord and printer."""
    m, c, f = device.material, device.cord, device.fabrication
    return (
        f"{m.young_modulus:.3g} MPa, Poisson's ratio {m.poisson_ratio:g}; cord of"
        f" {c.diameter:g} mm, {c.ohm_per_mm:g} ohm/mm, bent to {c.min_bend_radius:g} mm at least;"
        f" walls of {f.wall:g} mm, channels {f.clearance:g} mm wider than the cord."
    )
