"""Present controls as a virtual gamepad to games and browsers (Linux, uinput)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core.errors import OutputError
from ...core.machine.optional_libraries import optional
from ..frames.live_frame import LiveFrame, Note
from .output import has_all_controls, mappable_values, unknown_controls_note
from .settings import GamepadMapping, GamepadSettings

_UINPUT = Path("/dev/uinput")
_AXIS_RANGE = 32767
_AXIS_FUZZ = 16  # smaller changes are filtered by the kernel
_EV_KEY, _EV_ABS = 0x01, 0x03  # of linux/input-event-codes.h
_AXES = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}  # ABS_X ...
_BUTTONS = {  # BTN_SOUTH ...
    "south": 0x130,
    "east": 0x131,
    "north": 0x133,
    "west": 0x134,
    "tl": 0x136,
    "tr": 0x137,
    "select": 0x13A,
    "start": 0x13B,
}
_DEFAULT_AXES = ("x", "y", "rx", "ry", "z", "rz")  # sticks first
_NEEDS_COMPILER = (
    "it is compiled, and needs a C compiler and the kernel's headers"
    " (apt install gcc linux-libc-dev)"
)


class GamepadOutput:
    """An `Output` as a gamepad that is plugged in while it is open.

    Args:
        settings: Name and mapping of the gamepad.
        device: The device file of uinput.

    Attributes:
        trouble: A note on mapped controls that the device does not have, or None.

    Raises:
        OutputError: The machine has no uinput, or the user may not open it.
    """

    name = "gamepad"

    def __init__(self, settings: GamepadSettings, device: Path = _UINPUT) -> None:
        if not device.exists():
            raise OutputError(
                f"{device} does not exist",
                code="uinput-missing",
                where="gamepad",
                action="Load it on Linux (sudo modprobe uinput); elsewhere use osc or midi",
            )
        with optional(OutputError, "gamepad", package="evdev", otherwise=_NEEDS_COMPILER):
            import evdev
        info = evdev.AbsInfo(0, -_AXIS_RANGE, _AXIS_RANGE, _AXIS_FUZZ, 0, 0)
        capabilities = {
            _EV_KEY: list(_BUTTONS.values()),
            _EV_ABS: [(code, info) for code in _AXES.values()],
        }
        try:
            self._pad = evdev.UInput(capabilities, name=settings.name)
        except (OSError, evdev.UInputError) as error:
            raise OutputError(
                f"{device} cannot be opened ({error})",
                code="uinput-not-writable",
                where="gamepad",
                action="Give your user access: sudo setfacl -m u:$USER:rw /dev/uinput",
            ) from None
        self._name = settings.name
        self._mapping: Sequence[GamepadMapping] = settings.mapping
        self._mapped_controls = [entry.control for entry in settings.mapping]
        self.trouble: Note | None = None

    @property
    def about(self) -> str:
        """Description of the gamepad."""
        return f"gamepad: {self._name!r} is plugged in"

    def send(self, frame: LiveFrame) -> None:
        """Move the axes and buttons to the values of a frame."""
        if not self._mapping:
            self._mapping = default_mapping(frame)
        if has_all_controls(frame):
            self.trouble = unknown_controls_note("gamepad", self._mapped_controls, frame)
        for kind, code, value in events(self._mapping, frame):
            self._pad.write(kind, code, value)
        self._pad.syn()

    def close(self) -> None:
        """Unplug the gamepad."""
        self._pad.close()


def default_mapping(frame: LiveFrame) -> list[GamepadMapping]:
    """Map the controls, in their order, to the sticks, then to the triggers."""
    names = zip(frame.controls, _DEFAULT_AXES, strict=False)
    return [GamepadMapping(name, axis=axis) for name, axis in names]


def events(mapping: Sequence[GamepadMapping], frame: LiveFrame) -> list[tuple[int, int, int]]:
    """Return type, code and value of the kernel's input events of a frame.

    Args:
        mapping: What each control moves.
        frame: The frame; controls that it does not have are left out.
    """
    values, result = mappable_values(frame), list[tuple[int, int, int]]()
    for entry in mapping:
        if entry.control not in values:
            continue
        value = values[entry.control]
        if entry.axis:
            position = round(_AXIS_RANGE * min(max(value, -1.0), 1.0))
            result.append((_EV_ABS, _AXES[entry.axis], position))
        else:
            result.append((_EV_KEY, _BUTTONS[entry.button], int(value > entry.threshold)))
    return result
