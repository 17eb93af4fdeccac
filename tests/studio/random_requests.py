"""Random requests of the whole protocol, most of them valid and without sense."""

from __future__ import annotations

import random

from msgspec import inspect

from defsense_fab.studio.messages.catalogue import REQUESTS

NAMES = (
    *("", " ", "top", "bend", "base", "tip", "cord", "nope", "..", "../../../etc/passwd", "/etc"),
    *("a\x00b", "\x1b[31m", "line\nbreak", "\"'\\", "\U0001f600", "\u202ex", "CON", "x" * 300),
    *("=1+1", "a.b", "[x]", "#c", "]", "twin", "none", "twin:speed=0", "__class__", "%s%n", "rest"),
)
KEYS = (
    *("mesh.edge_length", "mesh.accuracy", "design.sensors", "design.decoder", "design.planes"),
    *("fabrication.wall", "fabrication.copies", "material.shore", "cord.diameter", "name"),
    *("body.script", "body.time_limit", "a.b.c", "."),
)
NUMBERS = (
    *(0, -0.0, 1, -1, 0.5, 1e-9, 5e-324, 1e308, -1e308, 1e16, 3.4e39, 1e9, 12.345, -5, 99999),
    *(2**31, 2**53, 2**63, -(2**63), 10**18),
)


class RandomRequests:
    """Makes requests from the declared types of their fields.

    Args:
        seed: Seed of the random numbers.
        known: Names that exist, by the fields that take them.
        without: Kinds that are not made.
    """

    def __init__(self, seed, known=None, without=()):
        self.random, self.known = random.Random(seed), known or {}
        self._kinds = [k for k in REQUESTS if k.__struct_config__.tag not in without]
        self._numbers = 0

    def next(self):
        """Return a request as JSON content."""
        self._numbers += 1
        kind = self.random.choice(self._kinds)
        content = {"kind": kind.__struct_config__.tag, "id": self._numbers}
        for field in inspect.type_info(kind).fields:
            if field.name != "id" and (field.required or self.random.random() < 0.7):
                content[field.encode_name] = self._value(field.type, field.name)
        return content

    def _value(self, kind, name):
        choose = self.random.choice
        match kind:
            case inspect.UnionType(types=types):
                return self._value(choose(types), name)
            case inspect.LiteralType(values=values):
                return choose(values)
            case inspect.ListType(item_type=item):
                is_nested = isinstance(item, inspect.ListType)
                if name == "axes" and is_nested and self.random.random() < 0.5:
                    return [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
                return [self._value(item, name) for _ in range(choose((0, 1, 2, 2, 3, 3, 3, 9)))]
            case inspect.DictType(key_type=key, value_type=value):
                names = [self._value(key, "pose") for _ in range(choose((0, 1, 2, 3)))]
                return {name: self._value(value, "") for name in names}
            case inspect.BoolType():
                return choose((True, False))
            case inspect.IntType():
                return choose((0, 1, 2, -1, 5, 100, 2**31, 2**63, -(2**63)))
            case inspect.FloatType():
                is_usual = self.random.random() < 0.7
                return self.random.uniform(-60, 160) if is_usual else choose(NUMBERS)
            case inspect.StrType():
                return self._text(name)
            case inspect.NoneType():
                return None
        raise TypeError(kind)

    def _text(self, name):
        if name == "key":
            return self.random.choice(KEYS)
        known = self.known.get(name)
        if known and self.random.random() < 0.75:
            return self.random.choice(known)
        return self.random.choice(NAMES)
