"""What the parameters of a body's script are, read from its text: nothing of it is run."""

from __future__ import annotations

import ast
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ...core.errors import BodyError

# A body's script as text: what may run when the body is made.

#: What Python imports.
_SUFFIXES = (".py", ".pyc", ".so", ".pyd")


@dataclass(frozen=True)
class ScriptText:
    """The script at `path`, and the programs beside it, by their names in its folder."""

    path: Path
    files: tuple[tuple[str, bytes], ...]

    @property
    def digest(self) -> str:
        """SHA-256 of all files with their names."""
        whole = hashlib.sha256()
        for name, content in self.files:
            for part in (name.encode(errors="surrogateescape"), content):
                whole.update(len(part).to_bytes(8, "little") + part)
        return whole.hexdigest()


def read_script(path: Path) -> ScriptText:
    """The script first, then whatever else may run with it: what it imports from its own folder,
    and what lies there by a name that any library may import, as its folder is searched first.
    Raises BodyError where it cannot be read."""
    try:
        files = {path.name: path.read_bytes()}
        waiting = [path.name, *_importable(path.parent)]
    except OSError as error:
        raise BodyError(
            f"{path}: cannot be read: {error.strerror}; give another script", code="file-unreadable"
        ) from None
    while waiting:
        name = waiting.pop()
        if name not in files:
            try:
                files[name] = (path.parent / name).read_bytes()
            except OSError:
                continue  # an import will not find it either
        waiting += [n for n in _imported(path.parent, name, files[name]) if n not in files]
    first = (path.name, files.pop(path.name))
    return ScriptText(path, (first, *sorted(files.items())))


def _importable(folder: Path) -> list[str]:
    """Modules that lie in the folder, and packages with all that is in them."""
    found = []
    for entry in folder.iterdir():
        if entry.suffix in _SUFFIXES and entry.is_file():
            found.append(entry.name)
        elif any((entry / f"__init__{suffix}").is_file() for suffix in _SUFFIXES):
            inside = [p for p in entry.rglob("*") if p.suffix in _SUFFIXES and p.is_file()]
            found += [p.relative_to(folder).as_posix() for p in inside]
    return found


def _imported(folder: Path, importer: str, content: bytes) -> list[str]:
    """Files of the folder that the text of `importer` imports; none of what is no Python."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        return []
    modules = set[Path]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {Path(*alias.name.split(".")) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = Path(importer).parents
            base = parents[min(node.level, len(parents)) - 1] if node.level else Path()
            place = base.joinpath(*(node.module or "").split("."))
            modules |= {place, *(place / alias.name for alias in node.names)}
    found = []
    for module in modules:
        places = (module, *module.parents)[:-1]
        names = [n for p in places for n in (p / "__init__.py", p.parent / f"{p.name}.py")]
        found += [n.as_posix() for n in names if (folder / n).is_file()]
    return sorted(found)


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
