"""A virtual gamepad: games and browsers see controls as sticks and buttons (Linux, uinput)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core.errors import OutputError
from ...core.machine.optional_libraries import optional
from ..frames.live_frame import LiveFrame
from .output import controls_known, signals_of, unknown_controls
from .settings import GamepadMapping, GamepadSettings

_UINPUT = Path("/dev/uinput")
_FULL = 32767
_KEY, _AXIS = 0x01, 0x03  # EV_KEY, EV_ABS of linux/input-event-codes.h
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
_COMPILED = (
    "it is compiled, and needs a C compiler and the kernel's headers"
    " (apt install gcc linux-libc-dev)"
)
_ORDER = ("x", "y", "rx", "ry", "z", "rz")  # sticks first


class GamepadOutput:
    """An `Output` as a gamepad that is plugged in while it is open."""

    name = "gamepad"

    def __init__(self, settings: GamepadSettings, device: Path = _UINPUT) -> None:
        """Raises OutputError where the machine has no uinput, or it is not ours to open."""
        if not device.exists():
            raise OutputError(
                f"{device} does not exist",
                code="uinput-missing",
                where="gamepad",
                action="Load it on Linux (sudo modprobe uinput); elsewhere use osc or midi",
            )
        with optional(OutputError, "gamepad", package="evdev", otherwise=_COMPILED):
            import evdev
        axes = [(code, evdev.AbsInfo(0, -_FULL, _FULL, 16, 0, 0)) for code in _AXES.values()]
        try:
            self._pad = evdev.UInput(
                {_KEY: list(_BUTTONS.values()), _AXIS: axes}, name=settings.name
            )
        except (OSError, evdev.UInputError) as error:
            raise OutputError(
                f"{device} cannot be opened ({error})",
                code="uinput-not-writable",
                where="gamepad",
                action="Give your user access: sudo setfacl -m u:$USER:rw /dev/uinput",
            ) from None
        self._name = settings.name
        self._mapping: Sequence[GamepadMapping] = settings.mapping
        self._asked = [one.control for one in settings.mapping]
        self.trouble: str | None = None

    @property
    def about(self) -> str:
        return f"gamepad: {self._name!r} is plugged in"

    def send(self, frame: LiveFrame) -> None:
        if not self._mapping:
            self._mapping = default_mapping(frame)
        if controls_known(frame):
            self.trouble = unknown_controls("gamepad", self._asked, frame)
        for kind, code, value in events(self._mapping, frame):
            self._pad.write(kind, code, value)
        self._pad.syn()

    def close(self) -> None:
        self._pad.close()


def default_mapping(frame: LiveFrame) -> list[GamepadMapping]:
    """The controls in their order move the sticks, then the triggers."""
    return [
        GamepadMapping(name, axis=axis) for name, axis in zip(frame.controls, _ORDER, strict=False)
    ]


def events(mapping: Sequence[GamepadMapping], frame: LiveFrame) -> list[tuple[int, int, int]]:
    """Type, code and value, as the kernel's input events have them."""
    values, out = signals_of(frame), list[tuple[int, int, int]]()
    for one in mapping:
        if one.control not in values:
            continue
        value = values[one.control]
        if one.axis:
            out.append((_AXIS, _AXES[one.axis], round(_FULL * min(max(value, -1.0), 1.0))))
        else:
            out.append((_KEY, _BUTTONS[one.button], int(value > one.threshold)))
    return out
