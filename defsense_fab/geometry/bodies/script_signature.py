"""What the parameters of a body's script are, read from its text: nothing of it is run."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ...core.errors import BodyError

Kind = Literal["number", "whole", "switch", "text", "choice", "other"]
#: Parts of a default between which a number may lie where the script does not say.
LEAST, MOST = 0.2, 3.0
_KINDS: dict[str, Kind] = {"float": "number", "int": "whole", "bool": "switch", "str": "text"}
_TWO = 2


@dataclass(frozen=True)
class Parameter:
    """`default` is None where the script has none, or none that can be read; `low` and `high` are
    the script's bounds of a number, or None, and `unit` what it is in; `choices` of a choice."""

    name: str
    kind: Kind
    default: Any = None
    low: float | None = None
    high: float | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()

    def bounds(self, value: float) -> tuple[float, float]:
        """Between what a number may be set where it is `value` now: the script's bounds, or a fifth
        to three times its default; never without `value`."""
        base = self.default if _is_number(self.default) else value
        ends = sorted((LEAST * base, MOST * base)) if base else (-10.0, 10.0)
        if self.kind == "whole":
            ends = (math.floor(ends[0]), math.ceil(ends[1]))
        low = ends[0] if self.low is None else self.low
        high = ends[1] if self.high is None else self.high
        return min(low, value), max(high, value)


def read_parameters(path: Path, given: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Of `body` in the script, in its order; `given` are the values that the device has, by which
    those without default and annotation are known. Raises BodyError where the script cannot be
    read, is no Python, or has no function `body`."""
    try:
        tree = ast.parse(path.read_bytes(), str(path))
    except SyntaxError as error:
        raise BodyError(
            f"{path.name}:{error.lineno}: is no Python ({error.msg}); mend that line",
            code="script-syntax",
            line=error.lineno,
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise BodyError(f"{path}: cannot be read: {error}", code="file-unreadable") from None
    found = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "body"]
    if not found:
        raise BodyError(
            f"{path.name}: defines no function body(...); add one that returns a solid",
            code="no-body-function",
        )
    arguments = found[-1].args
    plain = [*arguments.posonlyargs, *arguments.args]
    defaults: list[ast.expr | None] = [None] * (len(plain) - len(arguments.defaults))
    defaults += arguments.defaults
    pairs = [*zip(plain, defaults, strict=True)]
    pairs += zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    return tuple(_parameter(a, d, given.get(a.arg)) for a, d in pairs)


def _parameter(argument: ast.arg, default: ast.expr | None, given: Any) -> Parameter:
    value = _literal(default)
    kind, extra, unit = _annotated(argument.annotation)
    if kind is None:
        kind = _kind_of(value)
    if kind == "other" and value is None:  # whole numbers of device.toml may stand for others
        kind = "number" if _is_number(given) else _kind_of(given)
    low = high = None
    choices: tuple[str, ...] = ()
    if kind == "text" and isinstance(extra, tuple) and all(isinstance(x, str) for x in extra):
        kind, choices = "choice", extra
    elif kind in ("number", "whole") and isinstance(extra, tuple) and len(extra) == _TWO:
        low, high = (float(x) if _is_number(x) else None for x in extra)
        if low is not None and high is not None and low >= high:
            low = high = None
    if unit is None:
        unit = "mm" if kind == "number" else ""
    return Parameter(argument.arg, kind, value, low, high, unit, choices)


def _annotated(annotation: ast.expr | None) -> tuple[Kind | None, Any, str | None]:
    """Its kind, what Annotated or Literal says besides, and the unit of Annotated."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        try:
            annotation = ast.parse(annotation.value, mode="eval").body
        except (SyntaxError, ValueError):
            return None, None, None
    if isinstance(annotation, ast.Subscript):
        name = _last(annotation.value)
        inside = annotation.slice
        parts = inside.elts if isinstance(inside, ast.Tuple) else [inside]
        if name == "Annotated" and len(parts) >= _TWO:
            said = [_literal(p) for p in parts[1:]]
            unit = next((x for x in said if isinstance(x, str)), None)
            bounds = next((x for x in said if isinstance(x, tuple)), None)
            return _annotated(parts[0])[0], bounds, unit
        if name == "Literal":
            values = tuple(_literal(p) for p in parts)
            texts = all(isinstance(v, str) for v in values)
            return ("text", values, None) if texts else (None, None, None)
    return _KINDS.get(_last(annotation)), None, None


def _last(node: ast.expr | None) -> str:
    """float of typing.float, float."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _kind_of(value: Any) -> Kind:
    kinds: dict[type, Kind] = {bool: "switch", int: "whole", float: "number", str: "text"}
    return kinds.get(type(value), "other")


def _literal(node: ast.expr | None) -> Any:
    """Its value where it is written as one, None otherwise."""
    if node is None:
        return None
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
