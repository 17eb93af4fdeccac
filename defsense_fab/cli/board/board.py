"""The commands `defsense board ...`; the module of a command is imported when it is used."""

from __future__ import annotations

from ..app import command

board = command("board", help="Set up, check and read the board that measures the cords")
_COMMANDS = (
    ("flash", "flash", "Write the firmware to an Arduino Nano or Uno"),
    ("micropython", "pair", "Write the program for an ESP32 or a Raspberry Pi Pico W to a folder"),
    ("pair", "pair", "Connect a board to Wi-Fi and pair it with this computer"),
    ("ports", "ports", "List serial ports and show what a read-out board reads"),
    ("check", "check", "Check the wiring of a device and state what to repair"),
    ("reference", "ports", "Measure the reference resistors with a known resistor"),
    ("wiring", "wiring", "Draw how the cords of a built device are connected to a board"),
)
for _order, (_name, _module, _text) in enumerate(_COMMANDS):
    board.command(f"{__package__}.{_module}:{_name}", name=_name, help=_text, sort_key=_order)
