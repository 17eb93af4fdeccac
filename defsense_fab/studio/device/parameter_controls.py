"""A control for each parameter of the body's script."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ...core.device.device import BodySpec
from ...core.errors import BodyError
from ...geometry.bodies.script_source import Parameter, read_parameters

_STEPS = 1000  # of a slider, at least


class ParameterControls:
    """In a `folder` of the panel; `changed(name, value)` is told what a hand does, many times while
    it drags."""

    def __init__(self, gui: Any, folder: Any, changed: Callable[[str, Any], None]) -> None:
        self._gui, self._folder, self._changed = gui, folder, changed
        self._made: tuple[Any, ...] = ()
        self.controls: dict[str, Any] = {}  # by the parameter's name
        self._note: Any = None

    def show(self, spec: BodySpec, held: Callable[[str], bool]) -> None:
        """The controls as the device is now, but for those that a hand still `held`."""
        try:
            parameters, note = self._read(spec)
        except BodyError as error:
            parameters, note = (), f"**{error}**"
        values = {p.name: spec.parameters.get(p.name, p.default) for p in parameters}
        shapes = tuple((p, _range(p, values[p.name])) for p in parameters)
        if self._made != (shapes, note):
            self._make(shapes, values, note)
            self._made = (shapes, note)
        for name, control in self.controls.items():
            if not held(name) and control.value != _shown(control, values[name]):
                control.value = _shown(control, values[name])

    def _read(self, spec: BodySpec) -> tuple[tuple[Parameter, ...], str]:
        if spec.kind != "script":
            return (), f"The body is the file `{spec.path.name}`."
        parameters = read_parameters(spec.path, spec.parameters)
        known = {p.name for p in parameters}
        other = [p.name for p in parameters if p.kind == "other"]
        note = f"Made by `{spec.path.name}`."
        if other:
            note += f" In device.toml only: {_names(other)}."
        lost = [name for name in spec.parameters if name not in known]
        if lost:
            note += f" device.toml sets {_names(lost)}, which its `body` does not name."
        return parameters, note

    def _make(self, shapes: Any, values: dict[str, Any], note: str) -> None:
        for handle in (*self.controls.values(), *filter(None, [self._note])):
            handle.remove()
        self.controls = {}
        with self._folder:
            self._note = self._gui.add_markdown(note)
            for parameter, ends in shapes:
                control = self._control(parameter, ends, values[parameter.name])
                if control is not None:
                    self.controls[parameter.name] = control
                    control.on_update(self._told(parameter))

    def _control(self, p: Parameter, ends: tuple[float, float] | None, value: Any) -> Any:
        label = f"{p.name}, {p.unit}" if p.unit else p.name
        hint = (
            f"Of the script; {p.default!r} by itself" if p.default is not None else "Of the script"
        )
        if ends is not None:
            whole = p.kind == "whole"
            kind = int if whole else float
            step = 1 if whole else 10.0 ** math.floor(math.log10((ends[1] - ends[0]) / _STEPS))
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

    def _told(self, parameter: Parameter) -> Callable[[Any], None]:
        def told(event: Any) -> None:
            if event.client is None:  # set by the page itself
                return
            value = event.target.value
            kinds: dict[str, Callable[[Any], Any]] = {
                "whole": round,
                "number": float,
                "switch": bool,
            }
            self._changed(parameter.name, kinds.get(parameter.kind, str)(value))

        return told


def _range(p: Parameter, value: Any) -> tuple[float, float] | None:
    """The ends of a number's slider."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if p.kind not in ("number", "whole") or not number:
        return None
    low, high = p.bounds(value)
    return (low, high) if high > low else (low, low + 1)


def _shown(control: Any, value: Any) -> Any:
    return type(control.value)(value)


def _names(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
