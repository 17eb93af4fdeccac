"""Controls of the panel: of declared keys of `device.toml`, of options, and their callbacks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from msgspec import inspect

from ...core.device.device_file import DeviceFile
from ...core.schema.fields import Field, field
from ...core.schema.options import options_of

NONE = "none"  # choice of a list that offers nothing, or to choose nothing


def device_field(key: str) -> Field:
    """Return a key of `device.toml` by its dotted name, such as "mesh.edge_length"."""
    return field(DeviceFile, key)


def add_field(
    gui: Any,
    key: str,
    value: Any = None,
    *,
    label: str = "",
    unset: tuple[float, str] | None = None,
    step: float | None = None,
) -> Any:
    """Add the control of a key: a list of choices, a number, or a text.

    Args:
        gui: The viser GUI; the control is added to its open folder.
        key: Dotted name of the key, such as "mesh.edge_length".
        value: Value that is shown; by default that of a file without the key.
        label: Label; by default the name of the key with its unit.
        unset: Number that stands for a file without the key, and its meaning in words.
        step: Step of a number's arrows; by default that of viser, or 1 for whole numbers.

    Returns:
        The handle of the control.
    """
    declared = device_field(key)
    label, hint = label or declared.label, field_hint(declared, unset)
    if value is None:
        value = declared.default if unset is None else unset[0]
    if declared.choices:
        return gui.add_dropdown(label, declared.choices, initial_value=value, hint=hint)
    kind = declared.numbers
    if kind is None:
        return gui.add_text(label, value or "", hint=hint)
    low, high = declared.bounds
    if isinstance(kind, inspect.IntType):
        step = 1
    if unset is not None:
        low = unset[0] if low is None else min(low, unset[0])
    elif kind.gt is not None:
        low = kind.gt + (1 if step == 1 else 1e-3)  # the bound itself is not accepted
    return gui.add_number(label, value, min=low, max=high, step=step, hint=hint)


def field_hint(declared: Field, unset: tuple[float, str] | None = None) -> str:
    """Return a key's description as plain text, with its default.

    Args:
        declared: The key.
        unset: Number that stands for a file without the key, and its meaning in words.
    """
    parts = [declared.description.replace("`", "")]
    if unset is not None:
        parts.append(f"{unset[0]:g}: {unset[1]}.")
    elif declared.default not in (None, "", ()):
        parts.append(f"Default: {declared.default}.")
    return " ".join(parts)


#: Choice that stands for the default of an option that depends on the device.
DEFAULT_CHOICE = "default"


def add_option(
    gui: Any, record: type, name: str, label: str, step: float, value: float | None = None
) -> Any:
    """Add the control of a number or choice of an options record, and return its handle.

    Args:
        gui: The viser GUI; the control is added to its open folder.
        record: The options record.
        name: Name of the option.
        label: Label.
        step: Step of the arrows; not used for a choice.
        value: Number that is shown; by default that of the option.
    """
    option = options_of(record)[name]
    hint = option.description.rstrip(".")
    if option.choices:
        choices = option.choices if option.default else (DEFAULT_CHOICE, *option.choices)
        initial = option.default or DEFAULT_CHOICE
        return gui.add_dropdown(label, choices, initial_value=initial, hint=hint)
    shown = option.default if value is None else value
    return gui.add_number(label, shown, min=option.low, max=option.high, step=step, hint=hint)


def on_user(control: Any, action: Callable[[Any], Any]) -> None:
    """Call the action with each value that a user sets, and not with those of the page itself."""

    def on_update(event: Any) -> None:
        if event.client is not None:
            action(event.target.value)

    if hasattr(control, "on_update"):
        control.on_update(on_update)
    else:  # a group of buttons
        control.on_click(on_update)
