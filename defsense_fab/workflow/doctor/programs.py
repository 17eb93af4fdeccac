"""Slicers, and what outputs of the live loop need of the system."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from ...core.machine.optional_libraries import pip_install
from .finding import Finding, judged
from .isolated import call
from .system_libraries import system_command

#: Names of each slicer on PATH, and where macOS has it.
_SLICERS = {
    "PrusaSlicer": ("prusa-slicer", "PrusaSlicer", "prusa-slicer-console"),
    "OrcaSlicer": ("orca-slicer", "OrcaSlicer"),
    "Cura": ("cura", "UltiMaker-Cura", "UltiMaker-Cura.AppImage", "CuraEngine"),
}
_UINPUT = Path("/dev/uinput")


def check_slicers() -> Finding:
    """Any of them will do."""
    found = []
    for slicer, names in _SLICERS.items():
        paths = [p for p in map(shutil.which, names) if p]
        application = Path(f"/Applications/{slicer}.app")
        if sys.platform == "darwin" and application.exists():
            paths.append(str(application))
        found += [f"{slicer} ({path})" for path in paths[:1]]
    told = ", ".join(found) or f"none of {', '.join(_SLICERS)} is on PATH"
    return judged("programs", "slicer", bool(found), told, needed_for="printing the parts here")


def check_gamepad(seconds: float) -> Finding:
    """uinput, and evdev."""
    needed_for = "--output gamepad"
    if sys.platform != "linux" or not _UINPUT.exists():
        command = "sudo modprobe uinput" if sys.platform == "linux" else ""
        return judged("outputs", "gamepad", False, f"there is no {_UINPUT}",
                      command=command, needed_for=needed_for)  # fmt: skip
    if not os.access(_UINPUT, os.W_OK):
        return judged("outputs", "gamepad", False, f"{_UINPUT} is not yours to write",
                      command="sudo setfacl -m u:$USER:rw /dev/uinput",
                      needed_for=needed_for)  # fmt: skip
    trouble = call(__name__.rpartition(".")[0] + ".libraries", "load", "evdev",
                   seconds=seconds).trouble  # fmt: skip
    told = f"evdev: {trouble}" if trouble else f"{_UINPUT} and evdev are there"
    return judged("outputs", "gamepad", not trouble, told,
                  command=pip_install("evdev"),
                  needed_for=needed_for)  # fmt: skip


def check_midi(seconds: float) -> Finding:
    """MIDI of the system."""
    answer = call(__name__, "midi", seconds=seconds)
    told = f"no MIDI here ({answer.trouble})" if answer.trouble else answer.value
    return judged("outputs", "MIDI", not answer.trouble, told,
                  command=system_command(answer.trouble), needed_for="--output midi")  # fmt: skip


def midi() -> str:
    """How many ports other programs have open."""
    import rtmidi

    return f"{rtmidi.MidiOut().get_port_count()} ports of other programs"
