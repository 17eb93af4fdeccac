"""The events of the virtual gamepad, and machines without one."""

import sys
import types

import pytest

from defsense_fab.core.errors import OutputError
from defsense_fab.runtime.outputs.gamepad_output import GamepadOutput, default_mapping, events
from defsense_fab.runtime.outputs.settings import GamepadMapping, GamepadSettings
from tests.runtime.live_frames import frame, frame_before_rest
from tests.support.errors import raises


def test_events():
    mapping = [
        GamepadMapping("bend", axis="x"),
        GamepadMapping("twist", axis="ry"),
        GamepadMapping("bend", button="south", threshold=0.2),
        GamepadMapping("quality", button="start"),
        GamepadMapping("other", axis="z"),
    ]
    got = events(mapping, frame(1))
    assert got == [(3, 0, 8192), (3, 4, -16384), (1, 0x130, 1), (1, 0x13B, 1)]
    far = events(mapping[:2], frame(1, controls={"bend": 9.0, "twist": -9.0}))
    assert [value for *_, value in far] == [32767, -32767]


def test_event_codes_of_the_kernel():
    """They are those of evdev, if it is installed."""
    ecodes = pytest.importorskip("evdev").ecodes
    for axis in GamepadMapping.AXES:
        ((kind, code, _),) = events([GamepadMapping("bend", axis=axis)], frame(1))
        assert (kind, code) == (ecodes.EV_ABS, getattr(ecodes, f"ABS_{axis.upper()}"))
    for button in GamepadMapping.BUTTONS:
        ((kind, code, _),) = events([GamepadMapping("bend", button=button)], frame(1))
        assert (kind, code) == (ecodes.EV_KEY, getattr(ecodes, f"BTN_{button.upper()}"))


def test_default_mapping():
    assert [(m.control, m.axis) for m in default_mapping(frame(1))] == [
        ("bend", "x"),
        ("twist", "y"),
    ]


def test_machine_without_uinput(tmp_path):
    with raises(OutputError, "uinput-missing"):
        GamepadOutput(GamepadSettings(), tmp_path / "uinput")


@pytest.fixture
def evdev(monkeypatch):
    """Replace evdev, which needs a kernel with uinput."""

    class Pad:
        def __init__(self, capabilities, name):
            self.capabilities, self.name, self.written, self.closed = capabilities, name, [], False
            pads.append(self)

        def write(self, *event):
            self.written.append(event)

        def syn(self):
            self.written.append("syn")

        def close(self):
            self.closed = True

    pads, module = [], types.ModuleType("evdev")
    module.UInput, module.UInputError = Pad, type("UInputError", (Exception,), {})
    module.AbsInfo, module.pads = (lambda *numbers: numbers), pads
    monkeypatch.setitem(sys.modules, "evdev", module)
    return module


def test_gamepad_is_plugged_in(evdev, tmp_path):
    (tmp_path / "uinput").touch()
    output = GamepadOutput(GamepadSettings(), tmp_path / "uinput")
    (pad,) = evdev.pads
    output.send(frame_before_rest(1))
    assert pad.written == ["syn"]
    pad.written.clear()
    output.send(frame(2))
    assert pad.written == [(3, 0, 8192), (3, 1, -16384), "syn"]
    assert pad.name == "DefSense gamepad"
    assert set(pad.capabilities) == {1, 3}
    assert len(pad.capabilities[3]) == 6
    output.close()
    assert pad.closed
    GamepadOutput(GamepadSettings(name="Pad 2"), tmp_path / "uinput")
    assert evdev.pads[1].name == "Pad 2"


def test_unknown_control_is_reported(evdev, tmp_path):
    (tmp_path / "uinput").touch()
    settings = GamepadSettings((GamepadMapping("bnd", axis="x"),))
    output = GamepadOutput(settings, tmp_path / "uinput")
    output.send(frame_before_rest(1))  # no control is known yet
    assert output.trouble is None
    output.send(frame(2))
    assert (output.trouble.code, output.trouble.data["controls"]) == ("unknown-control", ["bnd"])


def test_missing_permission_is_reported(evdev, tmp_path):
    def refuse(*_, **__):
        raise evdev.UInputError("not writable")

    evdev.UInput = refuse
    (tmp_path / "uinput").touch()
    with raises(OutputError, "uinput-not-writable"):
        GamepadOutput(GamepadSettings(), tmp_path / "uinput")


def test_without_the_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "evdev", None)
    (tmp_path / "uinput").touch()
    with raises(OutputError, "library-missing"):
        GamepadOutput(GamepadSettings(), tmp_path / "uinput")
