"""A control for each parameter of the body's script."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ...core.device.device import BodySpec
from ...core.errors import BodyError
from ...workflow.starts.body_scripts import Parameter, read_parameters
from ..workbench.controls import on_user

_MIN_SLIDER_STEPS = 1000
#: Converts a control's value by the kind of its parameter; other kinds are texts.
_CONVERTERS: dict[str, Callable[[Any], Any]] = {"whole": round, "number": float, "switch": bool}


class ParameterControls:
    """Controls for the body's parameters in a folder of the panel.

    Args:
        gui: The viser GUI.
        folder: The folder of the panel.
        on_change: Called with a parameter's name and value for each change by the user, many
            times while a slider is dragged.

    Attributes:
        controls: The controls by the parameters' names.
        error: Error in reading the script, or None.
    """

    def __init__(self, gui: Any, folder: Any, on_change: Callable[[str, Any], None]) -> None:
        self._gui, self._folder, self._on_change = gui, folder, on_change
        self._content: tuple[Any, ...] = ()  # the parameters and the note that are shown
        self.controls: dict[str, Any] = {}
        self.error: BodyError | None = None
        self._note: Any = None

    def show(self, spec: BodySpec, is_pending: Callable[[str], bool]) -> None:
        """Show the body's values, except those that the user is still changing."""
        try:
            parameters, note = self._read(spec)
            self.error = None
        except BodyError as error:
            parameters, note, self.error = (), f"**{error}**", error
        values = {p.name: spec.parameters.get(p.name, p.default) for p in parameters}
        ranges = tuple((p, _slider_range(p, values[p.name])) for p in parameters)
        if self._content != (ranges, note):
            self._add_controls(ranges, values, note)
            self._content = (ranges, note)
        for name, control in self.controls.items():
            if not is_pending(name):
                control.value = type(control.value)(values[name])

    def _read(self, spec: BodySpec) -> tuple[tuple[Parameter, ...], str]:
        """Return the script's parameters and a note on the body."""
        if spec.kind != "script":
            return (), f"The body is the file `{spec.path.name}`."
        parameters = read_parameters(spec.path, spec.parameters)
        names = {p.name for p in parameters}
        other = [p.name for p in parameters if p.kind == "other"]
        note = f"Made by `{spec.path.name}`."
        if other:
            note += f" Set in device.toml only: {_join(other)}."
        unknown = [name for name in spec.parameters if name not in names]
        if unknown:
            note += (
                f" device.toml sets {_join(unknown)}, which the script's `body` does not accept."
            )
        return parameters, note

    def _add_controls(self, ranges: Any, values: dict[str, Any], note: str) -> None:
        for handle in (*self.controls.values(), *filter(None, [self._note])):
            handle.remove()
        self.controls = {}
        with self._folder:
            self._note = self._gui.add_markdown(note)
            for parameter, ends in ranges:
                control = self._add_control(parameter, ends, values[parameter.name])
                if control is not None:
                    self.controls[parameter.name] = control
                    on_user(control, self._report(parameter))

    def _add_control(self, p: Parameter, ends: tuple[float, float] | None, value: Any) -> Any:
        label = f"{p.name} ({p.unit})" if p.unit else p.name
        hint = "Parameter of the script"
        if p.default is not None:
            hint += f"; default {p.default!r}"
        if ends is not None:
            is_integer = p.kind == "whole"
            kind = int if is_integer else float
            step = (
                1
                if is_integer
                else 10.0 ** math.floor(math.log10((ends[1] - ends[0]) / _MIN_SLIDER_STEPS))
            )
            low, high = kind(ends[0]), kind(ends[1])
            return self._gui.add_slider(label, low, high, kind(step), kind(value), hint=hint)
        if p.kind == "switch":
            return self._gui.add_checkbox(label, bool(value), hint=hint)
        if p.kind == "choice":
            options = p.choices if value in p.choices else (str(value), *p.choices)
            return self._gui.add_dropdown(label, options, initial_value=str(value), hint=hint)
        if p.kind == "text":
            return self._gui.add_text(label, str(value or ""), hint=hint)
        return None

    def _report(self, parameter: Parameter) -> Callable[[Any], None]:
        convert = _CONVERTERS.get(parameter.kind, str)
        return lambda value: self._on_change(parameter.name, convert(value))


def _slider_range(p: Parameter, value: Any) -> tuple[float, float] | None:
    """Return the ends of a number's slider, or None if the parameter is not a number."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if p.kind not in ("number", "whole") or not is_number:
        return None
    low, high = p.bounds(value)
    return (low, high) if high > low else (low, low + 1)


def _join(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
