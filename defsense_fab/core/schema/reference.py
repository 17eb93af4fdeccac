"""Pages, comments and JSON Schemas, made from the declaration of a file."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping
from typing import Any

import msgspec

from .fields import Field, Section, declared_tables, sections, table_fields
from .types import bounds_in_words

_MAX_LISTED_CHOICES = 12
_COMMENT_WIDTH = 88  # columns

_HEADER = re.compile(r"\[+([\w.]+)\]+")
_KEY = re.compile(r"([\w-]+) *=")


def markdown(kind: type) -> str:
    """Return the reference of a declared file: a table of keys for each of its tables."""
    parts = []
    for section in sections(kind):
        title = f"`{section.header}`" if section.path else "Top of the file"
        parts += [f"### {title}\n", "| key | meaning | value | default |", "|---|---|---|---|"]
        for field in section.fields:
            cells = (f"`{field.name}`", field.description, _value(field, section), _default(field))
            parts.append(f"| {' | '.join(cells)} |")
        parts.append("")
    return "\n".join(parts)


def _value(field: Field, section: Section) -> str:
    """Return the type of a key's value, its unit, and what is accepted."""
    if field.tables:
        anchor = "-".join((*section.path, field.name, *field.tables[0])).lower().replace("_", "-")
        return f"[{field.type_words}](#{anchor})"
    if field.choices:
        names = ", ".join(f"`{choice}`" for choice in field.choices)
        is_short = len(field.choices) <= _MAX_LISTED_CHOICES
        listed = names if is_short else f"{len(field.choices)} names"
        return listed if field.type_words == "text in quotes" else f"list of {listed}"
    bounds = bounds_in_words(field.numbers) if field.numbers else ""
    words = field.type_words.replace("|", "\\|")
    return ", ".join(word for word in (words, field.unit, bounds) if word)


def _default(field: Field) -> str:
    if field.default_words:
        return field.default_words
    if field.is_required:
        return "required"
    if field.catalogue_default is not None:
        low, high = field.catalogue_default
        return f"the row's: `{low:g}` to `{high:g}`" if low < high else f"the row's: `{low:g}`"
    if field.default is None:
        return f"`{as_toml(field.choices[0])}`" if field.choices else "none"
    if isinstance(field.default, msgspec.Struct | dict) or field.default == ():
        return "none"
    return f"`{as_toml(field.default)}`"


def as_toml(value: object) -> str:
    """Return a plain value as it is written in a file."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_toml, value))}]"
    return f'"{value}"'


def commented(text: str, kind: type) -> str:
    """Return the text of a file with a comment above each key, where it first appears.

    Keys that have a comment keep it. Tables whose names or number the user chooses have one comment
    for all of them.
    """
    comments: dict[tuple[str, str], str] = {}
    for section in sections(kind):
        table = ".".join(section.path)
        for field in section.fields:
            comments[table, field.name] = _comment(field)
            if field.is_open:
                comments[f"{table}.{field.name}".strip("."), ""] = _comment(field)
    out: list[str] = []
    table = ""
    for line in text.split("\n"):
        place = None
        if match := _HEADER.match(line):
            table = match[1]
            place = (table, "")
        elif match := _KEY.match(line):
            place = (table, match[1])
        words = comments.pop(place, "") if place else ""
        if words and not (out and out[-1].startswith("#")):
            out += textwrap.wrap(words, _COMMENT_WIDTH, initial_indent="# ", subsequent_indent="# ")
        out.append(line)
    return "\n".join(out)


def _comment(field: Field) -> str:
    return f"{field.description} Unit: {field.unit}." if field.unit else field.description


def json_schema(kind: type) -> dict[str, Any]:
    """Return the JSON Schema of a declared file, with which editors check and complete TOML.

    Save it next to the file, and write `#:schema ./device.schema.json` into its first line.
    """
    schema: dict[str, Any] = _for_toml(msgspec.json.schema(kind))
    for table in declared_tables(kind):
        properties = schema["$defs"][table.__name__]["properties"]
        for field in table_fields(table):
            entry = properties[field.name]
            if field.unit:
                entry["description"] = _comment(field)
            if field.choices:
                target = entry["items"] if entry.get("type") == "array" else entry
                target["enum"] = list(field.choices)
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema}


def _for_toml(node: Any) -> Any:
    """Remove null, which TOML does not have, and write lists of fixed length as draft 7 does."""
    if isinstance(node, list | tuple):
        return [_for_toml(item) for item in node]
    if not isinstance(node, Mapping):
        return node
    out = {name: _for_toml(value) for name, value in node.items() if name != "prefixItems"}
    if "prefixItems" in node:
        out["items"] = [_for_toml(item) for item in node["prefixItems"]]
    if "anyOf" in out:
        options = [option for option in out.pop("anyOf") if option != {"type": "null"}]
        out = {**options[0], **out} if len(options) == 1 else {"anyOf": options, **out}
    if out.get("default", "") is None:
        del out["default"]
    return out
