"""Messages of the step Body: the body and its parameters, materials, and fields of the device."""

from __future__ import annotations

from typing import ClassVar, Literal

from ...workflow.view import Event, Problem, Record, Request

FieldKind = Literal["number", "whole", "switch", "choice", "text"]
CatalogueName = Literal["material", "cord", "trace", "printer"]
FieldValue = float | bool | str | None


class Parameter(Record, frozen=True, kw_only=True):
    """A parameter of the body's script.

    Attributes:
        name: Its name.
        kind: What kind of value it takes.
        unit: Unit of a number.
        value: Its value now; None if it has none.
        default: Its value without an entry in `device.toml`; None if it has none.
        low: Lower end of a number's slider, or None.
        high: Upper end of a number's slider, or None.
        step: Step of a number's slider.
        min: Smallest number that the script accepts, or None.
        max: Largest number that the script accepts, or None.
        choices: Values of a choice.
        is_set: Whether `device.toml` has an entry.
    """

    name: str
    kind: FieldKind
    unit: str
    value: FieldValue
    default: FieldValue
    low: float | None
    high: float | None
    step: float
    min: float | None
    max: float | None
    choices: list[str]
    is_set: bool


class BodyParameters(Event, frozen=True, kw_only=True):
    """Where the body comes from, and the parameters of its script.

    Attributes:
        file: Name of the file.
        source: Kind of the file.
        parameters: The parameters that have fields.
        other: Names of parameters that only an editor can set in `device.toml`.
        unknown: Names that `device.toml` sets and the script does not accept.
        problem: Why the script cannot be read, or None.
    """

    file: str
    source: Literal["script", "step", "mesh"]
    parameters: list[Parameter]
    other: list[str]
    unknown: list[str]
    problem: Problem | None


class BodyStatus(Event, frozen=True, kw_only=True):
    """The newest body.

    Attributes:
        state: "idle" if it is up to date, "making", "waiting" for another job, "stopped" by the
            user, "not-agreed" if the script may not run yet, or "failed".
        text: The state in one sentence; empty if there is nothing to report.
        problem: Why the body could not be made, or None.
        size: Extents (3,) of the newest body, mm; None if none has been made.
        volume: Its volume, mm³.
        is_preview: Whether the body differs from that of the last build, and is sent as the arrays
            "body-preview".
    """

    state: Literal["idle", "making", "waiting", "stopped", "not-agreed", "failed"]
    text: str
    problem: Problem | None
    size: list[float] | None
    volume: float
    is_preview: bool


class CatalogueColumn(Record, frozen=True, kw_only=True):
    """A column of a catalogue.

    Attributes:
        label: Its heading.
        unit: Unit of its numbers.
    """

    label: str
    unit: str


class CatalogueRow(Record, frozen=True, kw_only=True):
    """A row of a catalogue.

    Attributes:
        name: Its name.
        values: Numbers and words by column; None where it has none.
        note: What kind of values these are, such as "measured"; empty for none.
        source: Where the numbers come from.
    """

    name: str
    values: list[float | str | None]
    note: str
    source: str


class Catalogue(Record, frozen=True, kw_only=True):
    """Materials, cords, filaments of traces, or printers.

    Attributes:
        name: What it lists.
        columns: Its columns.
        rows: Its rows.
    """

    name: CatalogueName
    columns: list[CatalogueColumn]
    rows: list[CatalogueRow]


class Catalogues(Event, frozen=True, kw_only=True):
    """All catalogues."""

    catalogues: list[Catalogue]


class CatalogueChoice(Record, frozen=True, kw_only=True):
    """A row of a catalogue that the device uses.

    Attributes:
        catalogue: The catalogue.
        name: Name of the row.
        values: Values of the device by column, which may differ from those of the row.
        is_custom: Whether the catalogue has no such row.
        changed: Labels of the columns whose numbers `device.toml` replaces.
    """

    catalogue: CatalogueName
    name: str
    values: list[float | str | None]
    is_custom: bool
    changed: list[str]


class DeviceField(Record, frozen=True, kw_only=True):
    """A key of `device.toml`, as it is declared, with its value.

    Attributes:
        key: Its dotted name.
        label: Its label.
        kind: What kind of value it takes.
        unit: Unit of its numbers.
        description: What it means.
        value: Its value in `device.toml`; None without the key.
        default: Value that holds without the key; None if it depends on other values.
        default_text: That value in words; empty if there is none.
        low: Smallest number, or None.
        high: Largest number, or None.
        is_low_open: Whether `low` itself is not accepted.
        is_high_open: Whether `high` itself is not accepted.
        choices: Texts that are accepted.
        can_reset: Whether the key can be removed.
    """

    key: str
    label: str
    kind: FieldKind
    unit: str
    description: str
    value: FieldValue
    default: FieldValue
    default_text: str
    low: float | None
    high: float | None
    is_low_open: bool
    is_high_open: bool
    choices: list[str]
    can_reset: bool


class FieldGroup(Record, frozen=True, kw_only=True):
    """Fields under one heading.

    Attributes:
        title: The heading.
        fields: Fields that many devices change.
        more: Fields that few devices change.
    """

    title: str
    fields: list[DeviceField]
    more: list[DeviceField]


class DeviceFields(Event, frozen=True, kw_only=True):
    """The choices of catalogues, and the fields of the device."""

    choices: list[CatalogueChoice]
    groups: list[FieldGroup]


class SetParameter(Request, frozen=True, kw_only=True):
    """Set a parameter of the body's script; the body follows."""

    name: str
    value: float | bool | str


class ResetParameter(Request, frozen=True, kw_only=True):
    """Remove a parameter from `device.toml`, so that the script's default holds."""

    name: str


class MakeBody(Request, frozen=True, kw_only=True):
    """Make the body in the background, after asking whether its script may run."""


class StopBody(Request, frozen=True, kw_only=True):
    """Stop making the body, and keep the previous one."""


class ChooseRow(Request, frozen=True, kw_only=True):
    """Choose a row of a catalogue; values that replaced those of the previous row are removed."""

    catalogue: CatalogueName
    name: str


class SetField(Request, frozen=True, kw_only=True):
    """Set a key of `device.toml`."""

    key: str
    value: float | bool | str


class ResetField(Request, frozen=True, kw_only=True):
    """Remove a key from `device.toml`, so that its default holds."""

    key: str


class MisfitState(Record, frozen=True, kw_only=True):
    """A cord, region or pose that does not fit the newest body.

    Attributes:
        kind: What it is.
        name: Its name.
        text: What is wrong, in one sentence.
        at: Where (3,), mm; empty for a pose that uses a region outside the body.
    """

    kind: Literal["cord", "region", "pose"]
    name: str
    text: str
    at: list[float]


class BodyFit(Event, frozen=True, kw_only=True):
    """Whether cords, regions and poses fit the newest body.

    Attributes:
        text: What does not fit a body that has changed, in one sentence; empty for nothing.
        can_fit: Whether `FitToBody` can move them, as the body that they fitted is known.
        misfits: What does not fit.
    """

    text: str
    can_fit: bool
    misfits: list[MisfitState]


class FitToBody(Request, frozen=True, kw_only=True):
    """Fit to the newest body what no longer fits it.

    It moves as the bounding box of the body has changed, and cords keep the limits if possible.
    """

    lane: ClassVar[str] = "search"
