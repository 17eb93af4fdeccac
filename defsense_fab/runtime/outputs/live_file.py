"""`live.toml` and the flags that say the same: outputs and controls, strictly read.

[outputs.osc]                  # --output osc,port=9000
port = 9000
[outputs.midi]                 # --output 'midi,file=a.mid,mapping=[{control="bend",cc=20}]'
file = "a.mid"
mapping = [{ control = "bend", cc = 20 }]
[controls.bend]
formula = "bend_up - bend_down"
minimum = -1
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_type_hints

from ...core.errors import ControlError, DeviceError, OutputError
from ...core.machine.optional_libraries import optional
from ...core.storage.toml_table import Table, is_number, load_toml
from ..controls.control_spec import ControlSpec
from ..controls.shaping import Shaping
from .newest_wins import NewestWins
from .output import Output
from .settings import KINDS, GamepadMapping, MidiMapping, Settings

_RECORDS = (MidiMapping, GamepadMapping)
_CLASSES = {
    "osc": ("osc_output", "OscOutput"),
    "websocket": ("websocket.websocket_output", "WebSocketOutput"),
    "midi": ("midi.midi_output", "MidiOutput"),
    "lsl": ("lsl_output", "LslOutput"),
    "gamepad": ("gamepad_output", "GamepadOutput"),
}


@dataclass(frozen=True)
class LiveSettings:
    """What a `live.toml` asks for; no controls are one for each pose."""

    outputs: tuple[Settings, ...] = ()
    controls: tuple[ControlSpec, ...] = ()


def read_live_file(path: Path) -> LiveSettings:
    """Raises OutputError with file, line, key and what is allowed there."""
    if not path.is_file():
        raise OutputError(f"{path}: no such file; give a live.toml (docs/live-outputs.md)")
    try:
        top = load_toml(path)
        outputs = read_outputs(top.table("outputs", required=False))
        controls = read_controls(top.table("controls", required=False))
        top.done()
    except DeviceError as error:
        raise OutputError(str(error)) from None
    return LiveSettings(outputs, controls)


def read_outputs(table: Table) -> tuple[Settings, ...]:
    """Of the table [outputs]: a table for each output, or a list of tables for several of a kind.
    Raises DeviceError, as `Table` does."""
    found: list[Settings] = []
    for kind in table.data:
        table.choice(kind, kind, list(KINDS), "output")
        several = isinstance(table.data[kind], list)
        tables = table.tables(kind) if several else [table.table(kind)]
        found += [_record(one, KINDS[kind]) for one in tables]
    return tuple(found)


def read_controls(table: Table) -> tuple[ControlSpec, ...]:
    """Of the table [controls]: a formula, or a table with `formula` and how it is shaped. Raises
    DeviceError, as `Table` does."""
    found = []
    for name, value in table.data.items():
        try:
            if isinstance(value, str):
                found.append(ControlSpec(name, table.string(name)))
                continue
            one = table.table(name)
            formula = one.string("formula", name)
            found.append(ControlSpec(name, formula, _record(one, Shaping)))
        except ControlError as error:
            table.fail(name, str(error))
    return tuple(found)


def parse_output(text: str) -> Settings:
    """Of a flag such as "osc,port=9000": the output's kind, and what its table would say. Values
    are TOML's; a word that is no TOML is a text. Raises OutputError."""
    kind, *rest = _split(text)
    if kind not in KINDS:
        near = difflib.get_close_matches(kind, list(KINDS), n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise OutputError(
            f"--output {text}: no output {kind!r}; {hint}there is: {', '.join(KINDS)}"
        )
    data: dict[str, Any] = {}
    hints = get_type_hints(KINDS[kind])
    for part in rest:
        key, equals, value = map(str.strip, part.partition("="))
        if not equals or not key:
            raise OutputError(f"--output {text}: {part!r} is no key=value")
        if key in data:
            raise OutputError(f"--output {text}: {key} is given twice")
        data[key] = _value(value)
        if hints.get(key) == tuple[str, ...] and isinstance(data[key], str):
            data[key] = [data[key]]
    try:
        settings: Settings = _record(Table(data, Path("--output"), "", (kind,)), KINDS[kind])
    except DeviceError as error:
        raise OutputError(str(error)) from None
    return settings


def open_outputs(settings: Iterable[Settings]) -> list[NewestWins]:
    """Each on a thread of its own. One that cannot be opened says why as its `trouble`, and is
    tried again."""
    opened: list[NewestWins] = []
    kinds = {kind: name for name, kind in KINDS.items()}
    for one in settings:
        kind = kinds[type(one)]
        count = sum(o.name.split()[0] == kind for o in opened)
        name = f"{kind} {count + 1}" if count else kind
        opened.append(NewestWins(name, partial(_open, kind, one), one.rate))
    return opened


def _open(kind: str, settings: Settings) -> Output:
    module, name = _CLASSES[kind]
    with optional(OutputError, kind, "live"):
        opener: Callable[[Settings], Output] = getattr(
            import_module(f".{module}", __package__), name
        )
    return opener(settings)


def _record(t: Table, kind: type[Any]) -> Any:
    """The dataclass `kind` of a table, every key and type checked."""
    hints, given = get_type_hints(kind), {}
    for field in fields(kind):
        if t.has(field.name):
            given[field.name] = _read(t, field.name, hints[field.name])
        elif field.default is MISSING:
            t.string(field.name)  # says that it is missing
    t.done()
    try:
        return kind(**given)
    except (OutputError, ControlError) as error:
        t.fail(next((k for k in given if str(error).startswith(k)), None), str(error))


def _read(t: Table, key: str, hint: Any) -> Any:
    if hint is bool:
        return t.boolean(key, False)
    if hint is str:
        return t.string(key)
    if hint is float:
        return t.number(key)
    if hint is int or hint == int | None:
        value = t.raw(key)
        if not is_number(value) or not isinstance(value, int):
            t.fail(key, f"must be a whole number, not {value!r}")
        return value
    (inner, _) = get_args(hint)
    if inner in _RECORDS:
        return tuple(_record(one, inner) for one in t.tables(key))
    return tuple(t.strings(key))


def _split(text: str) -> list[str]:
    """At commas that stand in no bracket and no quotes."""
    parts, depth, quote = [""], 0, ""
    for c in text:
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        if c == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += c
    return [part.strip() for part in parts]


def _value(text: str) -> Any:
    try:
        parsed: Mapping[str, Any] = tomllib.loads(f"x = {text}")
    except tomllib.TOMLDecodeError:
        return text
    # A text with a line's end could bring more keys than the one that was asked for.
    return parsed["x"] if len(parsed) == 1 else text
