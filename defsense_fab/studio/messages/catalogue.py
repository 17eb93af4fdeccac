"""All messages of the studio's page, and the JSON Schema that the page's types are made from."""

from __future__ import annotations

import inspect
import sys
from types import ModuleType
from typing import Any, Union

import msgspec

from ...workflow.view import Event, Reply, Request, Upload, live_messages
from . import (
    body,
    inside,
    make,
    measure,
    optimize,
    pose_edits,
    poses,
    sensors,
    shell,
    start,
)

MODULES: tuple[ModuleType, ...] = (
    *(shell, start, body, poses, pose_edits, inside, sensors, optimize, make, measure),
    live_messages,
)


def messages(base: type) -> tuple[Any, ...]:
    """Return the messages that derive from a base class, by name."""
    found = {
        value
        for module in MODULES
        for value in vars(module).values()
        if inspect.isclass(value) and issubclass(value, base) and value is not base
    }
    return tuple(sorted(found, key=lambda kind: kind.__name__))


REQUESTS = tuple(sorted({*messages(Request), Upload}, key=lambda kind: kind.__name__))
EVENTS = tuple(sorted({*messages(Event), Reply}, key=lambda kind: kind.__name__))
#: Reads any request of a browser.
DECODER = msgspec.json.Decoder(Union[REQUESTS])  # noqa: UP007 - of a tuple


def schema() -> dict[str, Any]:
    """Return the JSON Schema of all messages.

    The object that it describes has the unions of requests and events, and the result of each
    request by its kind.
    """
    results = {kind.result for kind in REQUESTS if kind.result is not None}
    order = sorted(results, key=lambda kind: kind.__name__)
    (requests, events, *contents), parts = msgspec.json.schema_components(
        [Union[REQUESTS], Union[EVENTS], *order],  # noqa: UP007
        ref_template="#/$defs/{name}",
    )
    content = dict(zip(order, contents, strict=True))
    by_kind = {
        kind.__struct_config__.tag: {"type": "null"}
        if kind.result is None
        else content[kind.result]
        for kind in REQUESTS
    }
    for part in parts.values():  # everything is sent, also what has a default
        if "properties" in part:
            part["required"] = list(part["properties"])
            for value in part["properties"].values():
                value.pop("default", None)
    return {
        "title": "Protocol",
        "type": "object",
        "required": ["request", "event", "results"],
        "properties": {
            "request": requests,
            "event": events,
            "results": {
                "title": "Results",
                "type": "object",
                "required": list(by_kind),
                "properties": by_kind,
                "additionalProperties": False,
            },
        },
        "additionalProperties": False,
        "$defs": parts,
    }


if __name__ == "__main__":
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(schema()), indent=1).decode() + "\n")
