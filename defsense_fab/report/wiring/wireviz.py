"""Write the wiring as a file for WireViz, which draws harnesses and lists their materials.

Parts are its connectors: cords and resistors have two pins. Wires are its cables. Designators are
made of letters and digits, as WireViz gives other characters a meaning; names are texts of parts.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from typing import Any

from ...core.device.boards import ADS1115_INPUTS, ADS1115_STRAPS
from ...store.manifest import END_NAMES
from .connections import (
    ADDR,
    GND,
    JUNCTION,
    SCL,
    SDA,
    SUPPLY,
    VDD,
    Connection,
    PartKind,
    Terminal,
    Wire,
    Wiring,
    color_code,
)

_MODULE_PINS = (VDD, GND, SCL, SDA, ADDR, *(f"A{n}" for n in range(ADS1115_INPUTS)))
_RESISTOR_PINS = (JUNCTION, SUPPLY)
_DESIGNATORS = {
    PartKind.BOARD: "BOARD",
    PartKind.MODULE: "ADS",
    PartKind.CORD: "X",
    PartKind.RESISTOR: "R",
    PartKind.GROUND: "GROUND",
    PartKind.SUPPLY: "SUPPLY",
}
_WIRE_COLORS = {Wire.SUPPLY: "RD", Wire.GROUND: "BK", Wire.I2C: "BU"}


def wireviz_file(wiring: Wiring) -> str:
    """Return the content of a WireViz file (YAML) with a device's wiring."""
    pins = _list_pins(wiring)
    content = {
        "metadata": {"title": _as_text(f"{wiring.device}: wiring")},
        "connectors": _list_connectors(wiring, pins),
        **_list_cables(wiring, pins),
    }
    return "\n".join(_to_yaml(content)) + "\n"


def _as_text(text: str) -> str:
    """Return a text for WireViz, which reads texts as HTML."""
    return escape(text, quote=False)


def _list_pins(wiring: Wiring) -> dict[str, list[str]]:
    """Return the names of each connector's pins; rails have one pin per wire, without names."""
    pins: dict[str, list[str]] = {}
    for number in range(1, len(wiring.channels) + 1):
        pins[f"X{number}"] = list(END_NAMES)
        pins[f"R{number}"] = list(_RESISTOR_PINS)
    pins |= {f"ADS{n}": list(_MODULE_PINS) for n in range(1, wiring.module_count + 1)}
    ends = [end for c in wiring.connections for end in (c.start, c.end)]
    pins["BOARD"] = list(dict.fromkeys(e.pin for e in ends if e.kind is PartKind.BOARD))
    return pins


def _list_connectors(wiring: Wiring, pins: dict[str, list[str]]) -> dict[str, dict[str, Any]]:
    connectors: dict[str, dict[str, Any]] = {}
    for number, channel in enumerate(wiring.channels, start=1):
        connectors[f"X{number}"] = {
            "type": wiring.noun.capitalize(),
            "subtype": _as_text(channel.cord),
            "notes": f"{channel.rest:.0f} ohm at rest",
            "color": channel.color,
        }
        connectors[f"R{number}"] = {
            "type": f"Resistor {channel.resistor:g} ohm, 1 %",
            "notes": ", ".join(color_code(channel.resistor)),
        }
    for number in range(1, wiring.module_count + 1):
        connectors[f"ADS{number}"] = {
            "type": "ADS1115",
            "notes": f"address 0x{ADS1115_STRAPS[number - 1][1]:X}",
        }
    connectors["BOARD"] = {"type": wiring.board.title}
    for name, labels in pins.items():
        connectors[name]["pinlabels"] = labels
    for connection in wiring.connections:
        if connection.wire is Wire.ADDRESS:
            name = _designator(connection.start)
            ends = [_MODULE_PINS.index(e.pin) + 1 for e in connection[:2]]
            connectors[name]["loops"] = [ends]
    count = len(wiring.channels) + 1
    connectors["GROUND"] = {"type": "Ground rail", "pincount": count}
    connectors["SUPPLY"] = {"type": f"Supply rail, {wiring.supply_volt:g} V", "pincount": count}
    return connectors


def _designator(terminal: Terminal) -> str:
    name = _DESIGNATORS[terminal.kind]
    has_several = terminal.kind in (PartKind.MODULE, PartKind.CORD, PartKind.RESISTOR)
    return f"{name}{terminal.number}" if has_several else name


def _list_cables(wiring: Wiring, pins: dict[str, list[str]]) -> dict[str, Any]:
    """Return the sections `cables` and `connections`."""
    colors: dict[str, list[str]] = {}
    connections = []
    used_rail_pins = {"GROUND": 0, "SUPPLY": 0}

    def place(terminal: Terminal) -> dict[str, list[int]]:
        name = _designator(terminal)
        if name in used_rail_pins:
            used_rail_pins[name] += 1
            return {name: [used_rail_pins[name]]}
        return {name: [pins[name].index(terminal.pin) + 1]}

    for connection in wiring.connections:
        if connection.wire is Wire.ADDRESS:
            continue
        cable = _name_cable(connection)
        colors.setdefault(cable, []).append(_wire_color(wiring, connection))
        wire = {cable: [len(colors[cable])]}
        connections.append([place(connection.start), wire, place(connection.end)])
    cables = {
        name: {"category": "bundle", "wirecount": len(wires), "colors": wires}
        for name, wires in colors.items()
    }
    return {"cables": cables, "connections": connections}


def _name_cable(connection: Connection) -> str:
    """Return the designator of the cable in which a connection is a wire."""
    start, end, wire = connection
    if wire is Wire.CORD:
        return f"W{start.number}"
    if wire is Wire.SIGNAL:
        return f"W_{_designator(end)}_IN"
    if start.kind is PartKind.MODULE:
        return f"W_ADS{start.number}"
    return "W_SUPPLY" if start.kind is PartKind.RESISTOR else "W_POWER"


def _wire_color(wiring: Wiring, connection: Connection) -> str:
    start, end, wire = connection
    if end.kind is PartKind.GROUND:
        return "BK"
    return _WIRE_COLORS.get(wire) or wiring.channels[start.number - 1].color


def _to_yaml(value: Any, indent: str = "") -> list[str]:
    """Return mappings as lines of YAML; lists of plain values, and what they hold, in one line."""
    lines = []
    for key, item in value.items():
        if isinstance(item, dict):
            lines += [f"{indent}{key}:", *_to_yaml(item, indent + "  ")]
        elif isinstance(item, Sequence) and not isinstance(item, str) and isinstance(item[0], list):
            rows = (f"{indent}  - {json.dumps(row, ensure_ascii=False)}" for row in item)
            lines += [f"{indent}{key}:", *rows]
        else:
            lines.append(f"{indent}{key}: {json.dumps(item, ensure_ascii=False)}")
    return lines
