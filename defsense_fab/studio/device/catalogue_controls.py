"""Controls for entries of the catalogue and for single values of the device."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.device.device import Device
from ...core.storage.package_data import read_rows
from ..edits.body import (
    choose_cord,
    choose_material,
    choose_printer,
    rename_device,
    reset_value,
    set_cord_count,
    set_edge_length,
    set_searches,
    set_value,
)
from ..edits.edit import Edit
from ..workbench.controls import add_field, device_field, on_user

_UNSET_EDGE_MM = 0.0  # shown where the edge length follows from an accuracy
_UNSET_SEARCHES = 0  # shown where the number of searches follows from the number of cords


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
        self.name = add_field(gui, "name", "")
        self.material = gui.add_dropdown(
            "Material",
            tuple(_names_by_label("materials.csv")),
            hint="Choose the material of the body. The number is its modulus at small strains",
        )
        self.cord = gui.add_dropdown(
            "Cord", ("-",), hint="Choose the cord, which sets the diameter and the resistance"
        )
        self.printer = gui.add_dropdown(
            "Printer", ("-",), hint="Choose the printer, which sets clearance, wall and bed"
        )
        self.edge = add_field(
            gui, "mesh.edge_length", unset=(_UNSET_EDGE_MM, "from the accuracy"), step=0.1
        )
        self.cords = add_field(
            gui, "design.sensors", label="Number of cords", unset=(0, "only the drawn cords")
        )
        self.decoder = add_field(gui, "design.decoder")
        searches = device_field("design.searches").default_words
        self.searches = add_field(gui, "design.searches", unset=(_UNSET_SEARCHES, searches))
        for control, file, edit in (
            (self.material, "materials.csv", choose_material),
            (self.cord, "cords.csv", choose_cord),
            (self.printer, "printers.csv", choose_printer),
        ):
            on_user(control, _row_chooser(file, edit, apply))
        on_user(self.decoder, lambda x: apply(_decoder_edit(x)))
        on_user(self.name, lambda x: on_typed("name", str(x)))
        on_user(self.edge, lambda x: on_typed("edge", float(x)))
        on_user(self.cords, lambda x: on_typed("cords", int(x)))
        on_user(self.searches, lambda x: on_typed("searches", int(x)))

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
            names = _names_by_label(file)
            labels = tuple(names)
            chosen = next((x for x in labels if names[x] == name), f"{name} (custom)")
            control.options = labels if chosen in names else (chosen, *labels)
            control.value = chosen
        self.decoder.value = device.decoder
        edge, searches = device.mesh.edge_length, device.searches
        for key, control, value in (
            ("name", self.name, device.name),
            ("edge", self.edge, _UNSET_EDGE_MM if edge is None else edge),
            ("cords", self.cords, len(device.sensors) + device.propose),
            ("searches", self.searches, _UNSET_SEARCHES if searches is None else searches),
        ):
            if not is_pending(key):
                control.value = value


def _decoder_edit(name: str) -> Edit:
    if name == device_field("design.decoder").default:
        return reset_value("design", "decoder")
    return set_value("design", "decoder", name)


def _row_chooser(
    file: str, edit: Callable[[str], Edit], apply: Callable[[Edit], Any]
) -> Callable[[str], None]:
    """Return a function that applies the edit for the row of a catalogue with a label."""

    def choose(label: str) -> None:
        name = _names_by_label(file).get(label)
        if name is not None:  # otherwise it is the custom row of the device
            apply(edit(name))

    return choose


def _names_by_label(file: str) -> dict[str, str]:
    """Return the names of a catalogue's rows by labels with the value that distinguishes them."""
    describe: dict[str, Callable[[dict[str, str]], str]] = {
        "materials.csv": lambda r: f"{float(r['young_modulus']):g} MPa",
        "cords.csv": lambda r: f"{float(r['ohm_per_mm']):g} ohm/mm",
        "printers.csv": lambda r: f"wall {float(r['wall']):g} mm",
    }
    return {f"{name}  {describe[file](row)}": name for name, row in read_rows(file).items()}
