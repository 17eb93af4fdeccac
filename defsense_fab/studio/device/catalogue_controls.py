"""Controls for entries of the catalogue and for single values of the device."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.device.device import DECODERS, Device
from ...core.storage.package_data import read_rows
from ..edits.body import (
    choose_cord,
    choose_material,
    rename_device,
    reset_value,
    set_cord_count,
    set_edge_length,
    set_searches,
    set_value,
)
from ..edits.edit import Edit

_MAX_CORDS = 12
_EDGE_FROM_ACCURACY = 0.0  # shown where the edge length follows from an accuracy
_SEARCHES_FROM_CORDS = 0  # shown where the number of cords decides the number of searches


class CatalogueControls:
    """Controls for the name, material, cord, printer, mesh and decoder.

    Args:
        gui: The viser GUI; controls are added to its open folder.
        apply: Applies an edit at once.
        on_typed: Called with a key and a value while the user types.
    """

    def __init__(
        self, gui: Any, apply: Callable[[Edit], Any], on_typed: Callable[[str, Any], None]
    ) -> None:
        self.name = gui.add_text("Name", "", hint="Name the device and its printed parts")
        self.material = gui.add_dropdown(
            "Material", (_labels("materials.csv")[0],), hint="Listed with the small-strain modulus"
        )
        self.cord = gui.add_dropdown("Cord", ("-",), hint="Sets the diameter and the resistance")
        self.printer = gui.add_dropdown("Printer", ("-",), hint="Sets clearance, wall and bed")
        self.edge = gui.add_number(
            "Edge length (mm)", 1.0, min=0.0, step=0.1,
            hint="Set the edge length of the mesh; a fifth of the body's thickness is enough",
        )  # fmt: skip
        self.cords = gui.add_number(
            "Number of cords", 1, min=0, max=_MAX_CORDS, step=1,
            hint="Includes the cords that are drawn; the optimizer finds the others",
        )  # fmt: skip
        self.decoder = gui.add_dropdown(
            "Decoder", ("auto", *DECODERS), hint="Choose how signals are decoded; auto: the best"
        )
        self.searches = gui.add_number(
            "Searches", _SEARCHES_FROM_CORDS, min=_SEARCHES_FROM_CORDS, step=1,
            hint="Limit the searches of the optimizer; 0: depends on the number of cords",
        )  # fmt: skip
        _on_user(self.material, lambda x: apply(choose_material(_name(x))))
        _on_user(self.cord, lambda x: apply(choose_cord(_name(x))))
        _on_user(self.printer, lambda x: apply(set_value("fabrication", "process", _name(x))))
        _on_user(self.decoder, lambda x: apply(_decoder_edit(x)))
        _on_user(self.name, lambda x: on_typed("name", str(x)))
        _on_user(self.edge, lambda x: on_typed("edge", float(x)))
        _on_user(self.cords, lambda x: on_typed("cords", int(x)))
        _on_user(self.searches, lambda x: on_typed("searches", int(x)))

    def edit_for(self, key: str, value: Any) -> Edit | None:
        """Return the edit for a typed value, or None if the key belongs to another control."""
        if key == "name":
            return rename_device(value)
        if key == "edge":
            return set_edge_length(value)
        if key == "searches":
            return set_searches(value)
        return set_cord_count(value) if key == "cords" else None

    def show(self, device: Device, is_pending: Callable[[str], bool]) -> None:
        """Show the device's values, except those that the user is still changing."""
        for control, file, name in (
            (self.material, "materials.csv", device.material.name),
            (self.cord, "cords.csv", device.cord.name),
            (self.printer, "printers.csv", device.fabrication.process),
        ):
            labels = _labels(file)
            chosen = next((x for x in labels if _name(x) == name), f"{name} (custom)")
            options = labels if chosen in labels else (chosen, *labels)
            if tuple(control.options) != options:
                control.options = options
            _set(control, chosen)
        _set(self.decoder, device.decoder)
        edge, searches = device.mesh.edge_length, device.searches
        for key, control, value in (
            ("name", self.name, device.name),
            ("edge", self.edge, _EDGE_FROM_ACCURACY if edge is None else edge),
            ("cords", self.cords, len(device.sensors) + device.propose),
            ("searches", self.searches, _SEARCHES_FROM_CORDS if searches is None else searches),
        ):
            if not is_pending(key):
                _set(control, value)


def _on_user(control: Any, action: Callable[[Any], Any]) -> None:
    """Call the action with each value that a user sets."""

    def on_update(event: Any) -> None:
        if event.client is not None:  # otherwise the page itself has set the value
            action(event.target.value)

    control.on_update(on_update)


def _decoder_edit(name: str) -> Edit:
    if name == "auto":
        return reset_value("design", "decoder")
    return set_value("design", "decoder", name)


def _set(control: Any, value: Any) -> None:
    if control.value != value:
        control.value = value


def _name(label: str) -> str:
    return label.split("  ", 1)[0]


def _labels(file: str) -> tuple[str, ...]:
    """Return the names of a catalogue's rows, each with the value that distinguishes it."""
    describe: dict[str, Callable[[dict[str, str]], str]] = {
        "materials.csv": lambda r: f"{float(r['young_modulus']):g} MPa",
        "cords.csv": lambda r: f"{float(r['ohm_per_mm']):g} ohm/mm",
        "printers.csv": lambda r: f"wall {float(r['wall']):g} mm",
    }
    return tuple(f"{name}  {describe[file](row)}" for name, row in read_rows(file).items())
