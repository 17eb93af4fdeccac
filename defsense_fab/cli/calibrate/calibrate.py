"""The commands `defsense calibrate ...`; the module of a command is imported when it is used."""

from __future__ import annotations

from ..app import command

calibrate = command("calibrate", help="Measure the response of a cord on specimens")
_COMMANDS = (
    ("specimen", "parts", "Write the bending specimen and its jigs for printing"),
    ("coupon", "parts", "Write the fit coupon, which determines your printer's clearance"),
    ("clearance", "parts", "Write the clearance result with the coupon to a device"),
    ("ports", "board", "List serial ports and show what a read-out board reads"),
    ("record", "board", "Measure a specimen on its jigs, step by step"),
    ("reference", "board", "Measure the reference resistors with a known resistor"),
    ("twin", "response", "Create sessions of a simulated specimen, to try the fit"),
    ("fit", "response", "Fit the cord's response to sessions or tables of readings"),
)
for _order, (_name, _module, _text) in enumerate(_COMMANDS):
    calibrate.command(f"{__package__}.{_module}:{_name}", name=_name, help=_text, sort_key=_order)
