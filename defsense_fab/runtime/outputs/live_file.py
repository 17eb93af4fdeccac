"""Read `live.toml`, and texts that hold the same: outputs and controls of the live loop.

[outputs.osc]                  # osc,port=9000
port = 9000
[outputs.midi]                 # midi,file=a.mid,mapping=[{control="bend",cc=20}]
file = "a.mid"
mapping = [{ control = "bend", cc = 20 }]
[controls.bend]
formula = "bend_up - bend_down"
minimum = -1
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ...core.errors import ControlError, OutputError
from ...core.machine.optional_libraries import optional
from ...core.schema.declare import Problem, Table, key, unknown_choice
from ...core.schema.document import Document, load_document
from ...core.schema.fields import table_fields
from ..controls.control_spec import ControlSpec, Shaping
from .output import LatestFrameSender, Output
from .settings import (
    KINDS,
    GamepadSettings,
    LslSettings,
    MidiSettings,
    OscSettings,
    Settings,
    WebSocketSettings,
)

_CLASSES = {
    "osc": ("osc_output", "OscOutput"),
    "websocket": ("websocket_output", "WebSocketOutput"),
    "midi": ("midi_output", "MidiOutput"),
    "lsl": ("lsl_output", "LslOutput"),
    "gamepad": ("gamepad_output", "GamepadOutput"),
}


class ControlTable(Shaping, frozen=True):
    """A control: its formula, and how its value is shaped."""

    formula: Annotated[
        str | None,
        key(
            "Formula of the device's poses, and of the controls above it.",
            default="the control's name",
        ),
    ] = None


class OutputsTable(Table, frozen=True):
    """The outputs: a table for each, or a list of tables for several of a kind."""

    osc: Annotated[OscSettings | list[OscSettings] | None, key("Open Sound Control.")] = None
    websocket: Annotated[
        WebSocketSettings | list[WebSocketSettings] | None, key("WebSocket server.")
    ] = None
    midi: Annotated[MidiSettings | list[MidiSettings] | None, key("MIDI.")] = None
    lsl: Annotated[LslSettings | list[LslSettings] | None, key("Lab Streaming Layer.")] = None
    gamepad: Annotated[GamepadSettings | list[GamepadSettings] | None, key("Virtual gamepad.")] = (
        None
    )


class LiveFile(Table, frozen=True):
    """All keys of `live.toml`."""

    outputs: Annotated[OutputsTable, key("Where frames go.")] = msgspec.field(
        default_factory=OutputsTable
    )
    controls: Annotated[
        dict[str, ControlTable | str],
        key(
            "Controls by name: a formula alone, or a table.",
            default="one for each pose",
        ),
    ] = msgspec.field(default_factory=dict)


@dataclass(frozen=True)
class LiveSettings:
    """The content of a `live.toml`.

    Attributes:
        outputs: Settings of the outputs, in the order of the file.
        controls: The controls; empty for one of each pose.
        path: The file, for messages; None without one.
    """

    outputs: tuple[Settings, ...] = ()
    controls: tuple[ControlSpec, ...] = ()
    path: Path | None = None


def read_live_file(path: Path) -> LiveSettings:
    """Read a `live.toml`.

    Raises:
        OutputError: with file, line and key, for everything that is wrong in it.
    """
    if not path.is_file():
        raise OutputError(
            "no such file",
            code="file-not-found",
            where=path,
            action="Give a live.toml (docs/live-toml.md)",
        )
    document = load_document(path, OutputError)
    declared = document.read(LiveFile)
    outputs: list[Settings] = []
    for kind in document.values.get("outputs", {}):  # in the order of the file
        settings = getattr(declared.outputs, kind)
        outputs += settings if isinstance(settings, list) else [settings]
    controls, problems = [], []
    for name, table in declared.controls.items():
        try:
            controls.append(_control(name, table))
        except ControlError as error:
            problem = Problem((), error.problem, error.code, error.action, error.data)
            problems.append(problem.below("controls", name))
    if problems:
        document.refuse(problems)
    return LiveSettings(tuple(outputs), tuple(controls), path)


def _control(name: str, table: ControlTable | str) -> ControlSpec:
    if isinstance(table, str):
        return ControlSpec(name, table)
    shaping = {f: getattr(table, f) for f in Shaping.__struct_fields__}
    return ControlSpec(name, table.formula or name, Shaping(**shaping))


def parse_output(text: str) -> Settings:
    """Read an output from one line, such as `osc,port=9000`.

    Args:
        text: The kind of output, and the keys of its table as key=value, separated by commas.
            Values are TOML; a word that is not TOML is a text.

    Raises:
        OutputError: for everything that is wrong in it.
    """
    where = f"output {text!r}"
    kind, *rest = _split(text)
    if kind not in KINDS:
        problem = unknown_choice((), kind, KINDS, "output", "unknown-output")
        raise OutputError(
            problem.text, code=problem.code, where=where, action=problem.action, **problem.data
        )
    lists = {f.name for f in table_fields(KINDS[kind]) if f.type_words == "list of texts"}
    values: dict[str, Any] = {}
    for part in rest:
        name, equals, value = map(str.strip, part.partition("="))
        if not equals or not name:
            raise OutputError(f"{part!r} is not key=value", code="not-key-value", where=where)
        if name in values:
            raise OutputError(
                f"{name} is given twice", code="key-repeated", where=where, action="Give it once"
            )
        values[name] = _value(value)
        if name in lists and isinstance(values[name], str):
            values[name] = [values[name]]
    document = Document({kind: values}, Path("output"), "", OutputError)
    settings, problems = document.try_reading(KINDS[kind], values, (kind,))
    if settings is None:
        document.refuse(problems)
    return settings


def open_outputs(settings: Iterable[Settings]) -> list[LatestFrameSender]:
    """Open outputs, each on its own thread.

    An output that cannot be opened gives the reason as its `trouble`, and is tried again.
    """
    opened: list[LatestFrameSender] = []
    kinds = {kind: name for name, kind in KINDS.items()}
    for one in settings:
        kind = kinds[type(one)]
        count = sum(o.name.split()[0] == kind for o in opened)
        name = f"{kind} {count + 1}" if count else kind
        opened.append(LatestFrameSender(name, partial(_open, kind, one), one.rate))
    return opened


def _open(kind: str, settings: Settings) -> Output:
    module, name = _CLASSES[kind]
    with optional(OutputError, kind, "live"):
        opener: Callable[[Settings], Output] = getattr(
            import_module(f".{module}", __package__), name
        )
    return opener(settings)


def _split(text: str) -> list[str]:
    """Split a text at the commas outside of brackets and quotes."""
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
    # A text with a line break could hold more keys than x.
    return parsed["x"] if len(parsed) == 1 else text
