"""The commands `defsense calibrate ...`; the module of a command is imported when it is used."""

from __future__ import annotations

from ..app import command

calibrate = command("calibrate", help="Measure the response of a cord or trace on specimens")
_COMMANDS = (
    ("specimen", "parts", "Write the bending specimen and its jigs for printing"),
    ("coupon", "parts", "Write the fit coupon, which determines your printer's clearance"),
    ("clearance", "parts", "Write the clearance result with the coupon to a device"),
    ("trace-coupon", "traces", "Write the coupon of printed traces for their resistivity"),
    ("resistivity", "traces", "Determine a filament's resistivity from the measured coupon"),
    ("record", "record", "Measure a specimen on its jigs, step by step"),
    ("twin", "response", "Create sessions of a simulated specimen, to try the fit"),
    ("fit", "response", "Fit the cord's response to sessions or tables of readings"),
)
#: Names in the modules that differ from the commands'.
_ATTRIBUTES = {"trace-coupon": "trace_coupon"}
for _order, (_name, _module, _text) in enumerate(_COMMANDS):
    _attribute = _ATTRIBUTES.get(_name, _name)
    calibrate.command(
        f"{__package__}.{_module}:{_attribute}", name=_name, help=_text, sort_key=_order
    )
