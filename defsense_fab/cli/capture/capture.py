"""The command group `defsense capture`: markers, cameras, recordings, tracks."""

from __future__ import annotations

from ..app import command

_STEPS = {
    "markers": ("sheets", "Write the tags of a device for printing, and where to glue them"),
    "board": ("sheets", "Write the ChArUco board for calibrating the cameras"),
    "camera": (
        "camera",
        "Calibrate cameras with a printed board, arrange them, check them\n\nThe board is one of"
        " 'defsense capture board'. A SOURCE is a connected camera (0, /dev/video0), a video, or a"
        " folder of images. The single source twin (twin:webcam,seed=1,cameras=2) stands for"
        " simulated cameras that see a board.",
    ),
    "record": ("record", "Record a device's movement and signals, step by step"),
    "process": ("process", "Convert videos, or a recorded session, to tracks of the tags"),
    "convert": (
        "convert",
        "Convert tracks to another format, such as that of a motion-capture system",
    ),
}

capture = command("capture")
for _order, (_name, (_module, _text)) in enumerate(_STEPS.items()):
    capture.command(f"{__package__}.{_module}:{_name}", name=_name, help=_text, sort_key=_order)
