"""Controls for what is chosen from the catalogue, and for single values of the device."""

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

_MOST_CORDS = 12
_FROM_ACCURACY = 0.0  # shown where the edge length follows from an accuracy
_BY_CORDS = 0  # shown where the number of cords tells how many searches there are


class CatalogueControls:
    """`do` makes an edit at once; `later(key, value)` takes values that are being typed."""

    def __init__(
        self, gui: Any, do: Callable[[Edit], Any], later: Callable[[str, Any], None]
    ) -> None:
        self._do = do
        self.name = gui.add_text("Name", "", hint="Of the device; printed parts are named by it")
        self.material = gui.add_dropdown("Material", (_words("materials.csv")[0],),
                                         hint="By its modulus at small strain")  # fmt: skip
        self.cord = gui.add_dropdown("Cord", ("-",), hint="Its diameter and resistance")
        self.printer = gui.add_dropdown("Printer", ("-",), hint="Clearance, wall and bed")
        self.edge = gui.add_number("Edge length, mm", 1.0, min=0.0, step=0.1,
                                   hint="Of the mesh; a fifth of the thickness")  # fmt: skip
        self.cords = gui.add_number("Cords", 1, min=0, max=_MOST_CORDS, step=1,
                                    hint="With those drawn; the rest is found")  # fmt: skip
        self.decoder = gui.add_dropdown("Decoder", ("auto", *DECODERS),
                                        hint="Of signals; auto takes the best")  # fmt: skip
        self.searches = gui.add_number("Searches", _BY_CORDS, min=_BY_CORDS, step=1,
                                       hint="Fewer are quicker; 0: as cords need")  # fmt: skip
        self._told(self.material, lambda x: do(choose_material(_name(x))))
        self._told(self.cord, lambda x: do(choose_cord(_name(x))))
        self._told(self.printer, lambda x: do(set_value("fabrication", "process", _name(x))))
        self._told(self.decoder, lambda x: do(_decoder(x)))
        self._told(self.name, lambda x: later("name", str(x)))
        self._told(self.edge, lambda x: later("edge", float(x)))
        self._told(self.cords, lambda x: later("cords", int(x)))
        self._told(self.searches, lambda x: later("searches", int(x)))

    def settled(self, key: str, value: Any) -> Edit | None:
        """What a value that was typed changes; None for a key of another."""
        if key == "name":
            return rename_device(value)
        if key == "edge":
            return set_edge_length(value)
        if key == "searches":
            return set_searches(value)
        return set_cord_count(value) if key == "cords" else None

    def show(self, device: Device, held: Callable[[str], bool]) -> None:
        """As the device is now, but for what a hand still `held`."""
        for control, file, name in (
            (self.material, "materials.csv", device.material.name),
            (self.cord, "cords.csv", device.cord.name),
            (self.printer, "printers.csv", device.fabrication.process),
        ):
            words = _words(file)
            chosen = next((w for w in words if _name(w) == name), f"{name} (as written)")
            options = words if chosen in words else (chosen, *words)
            if tuple(control.options) != options:
                control.options = options
            _set(control, chosen)
        _set(self.decoder, device.decoder)
        edge = device.mesh.edge_length
        for key, control, value in (
            ("name", self.name, device.name),
            ("edge", self.edge, _FROM_ACCURACY if edge is None else edge),
            ("cords", self.cords, len(device.sensors) + device.propose),
            ("searches", self.searches, _BY_CORDS if device.searches is None else device.searches),
        ):
            if not held(key):
                _set(control, value)

    def _told(self, control: Any, action: Callable[[Any], Any]) -> None:
        def told(event: Any) -> None:
            if event.client is not None:  # not set by the page itself
                action(event.target.value)

        control.on_update(told)


def _decoder(name: str) -> Edit:
    return (
        reset_value("design", "decoder") if name == "auto" else set_value("design", "decoder", name)
    )


def _set(control: Any, value: Any) -> None:
    if control.value != value:
        control.value = value


def _name(word: str) -> str:
    return word.split("  ", 1)[0]


def _words(file: str) -> tuple[str, ...]:
    """Rows of the catalogue with what tells them apart."""
    said: dict[str, Callable[[dict[str, str]], str]] = {
        "materials.csv": lambda r: f"{float(r['young_modulus']):g} MPa",
        "cords.csv": lambda r: f"{float(r['ohm_per_mm']):g} ohm/mm",
        "printers.csv": lambda r: f"wall {float(r['wall']):g} mm",
    }
    return tuple(f"{name}  {said[file](row)}" for name, row in read_rows(file).items())
