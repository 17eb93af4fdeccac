"""Messages between a page in the browser and this program, and binary messages with arrays.

Requests come from a browser and have a number, which the answer repeats. Events go to browsers at
any time; an event of a kind replaces the last one of that kind, so that a browser that connects
later gets the newest of each. Both are JSON texts whose `kind` tells them apart. Arrays travel as
binary messages: the length of a JSON header, the header, and the numbers.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any, ClassVar

import msgspec
import numpy as np

from ...core.errors import DefsenseError

_ALIGNMENT_BYTES = 8  # at which browsers can place arrays of any type
_TYPES = {"float32": np.float32, "uint32": np.uint32, "uint8": np.uint8}


def _kind(name: str) -> str:
    """Return a class's name in lower case with hyphens."""
    return "".join(f"-{c.lower()}" if c.isupper() else c for c in name).lstrip("-")


class Record(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """A part of a message."""


class Request(Record, frozen=True, kw_only=True, tag_field="kind", tag=_kind):
    """A request of a browser.

    Attributes:
        id: Number of the request, unique in its connection.
        result: Kind of the answer; None for an answer without content.
        lane: Requests of one lane are handled one after another.
    """

    result: ClassVar[type | None] = None
    lane: ClassVar[str] = "edit"

    id: int


class Event(Record, frozen=True, kw_only=True, tag_field="kind", tag=_kind):
    """A message to browsers.

    Attributes:
        is_kept: Whether a browser that connects later gets it.
    """

    is_kept: ClassVar[bool] = True


class Result(Record, frozen=True, kw_only=True):
    """The content of an answer."""


class Problem(Record, frozen=True, kw_only=True):
    """An error, as a page shows it.

    Attributes:
        code: Stable identifier of the error.
        text: The whole text: where, what is wrong, and what to do.
        message: What is wrong and what to do, without the place.
        field: Dotted name of the key of `device.toml` that is wrong; empty if none is.
        cord: Name of the cord that is concerned; empty if none is.
        suggestion: A value of the key that cures it; None if none is known.
    """

    code: str
    text: str
    message: str
    field: str = ""
    cord: str = ""
    suggestion: float | None = None

    @classmethod
    def of(cls, error: Exception) -> Problem:
        """Return an error as a page shows it."""
        if not isinstance(error, DefsenseError):
            text = f"The program failed ({type(error).__name__}: {error})"
            return cls(code="task-failed", text=text, message=text)
        suggested = error.data.get("suggested")
        action = f" {error.action.rstrip('.')}." if error.action else ""
        message = f"{error.problem[:1].upper()}{error.problem[1:].rstrip('.')}.{action}"
        return cls(
            code=error.code,
            text=str(error),
            message=message,
            field=str(error.data.get("key", "")),
            cord=_cord_of(error),
            suggestion=suggested if isinstance(suggested, int | float) else None,
        )


def _cord_of(error: DefsenseError) -> str:
    """Return the cord that an error names, or the first of several; empty if it names none."""
    cords = error.data.get("cords")
    first = cords[0] if isinstance(cords, list | tuple) and cords else ""
    return str(error.data.get("cord") or first)


class Reply(Event, frozen=True, kw_only=True):
    """The answer to a request that sends no arrays.

    Attributes:
        id: Number of the request.
        problem: Why the request was refused, or None.
        result: Content of the kind that the request names.
    """

    is_kept: ClassVar[bool] = False

    id: int
    problem: Problem | None = None
    result: Any = None


class Upload(Request, frozen=True, kw_only=True):
    """Announce a file, whose parts follow as binary messages that begin with this number.

    It is answered once the whole file is received, or refused.

    Attributes:
        name: Name of the file.
        size: Its size in bytes.
    """

    name: str
    size: int


class Arrays(Record, frozen=True, kw_only=True):
    """Named arrays with some facts about them, for a binary message.

    Attributes:
        name: What they describe, such as "body"; arrays of a name replace the last ones.
        arrays: The arrays, of floats or integers; floats are sent with 32 bits.
        facts: Content that is sent along as JSON.
    """

    name: str
    arrays: Mapping[str, Any]
    facts: Mapping[str, Any] = {}


def encode_arrays(message: Arrays, reply_to: int | None = None) -> bytes:
    """Return a binary message.

    Args:
        message: The arrays.
        reply_to: Number of the request that they answer, or None.
    """
    index, parts, at = [], list[bytes](), 0
    for name, values in message.arrays.items():
        array = np.asarray(values)
        kind = "uint8" if array.dtype == np.uint8 else "uint32"
        if array.dtype.kind == "f":
            kind = "float32"
        content = np.ascontiguousarray(array, _TYPES[kind]).astype(
            np.dtype(_TYPES[kind]).newbyteorder("<"), copy=False
        )
        content_bytes = content.tobytes()
        index.append({"name": name, "type": kind, "shape": array.shape, "at": at})
        padding = -len(content_bytes) % _ALIGNMENT_BYTES
        parts += [content_bytes, bytes(padding)]
        at += len(content_bytes) + padding
    header = msgspec.json.encode(
        {
            "kind": "arrays",
            "name": message.name,
            "id": reply_to,
            "arrays": index,
            "facts": message.facts,
        }
    )
    header += b" " * (-(len(header) + 4) % _ALIGNMENT_BYTES)
    return b"".join([struct.pack("<I", len(header)), header, *parts])
