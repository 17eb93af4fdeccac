"""Read a body script as text, without running it: its parameters, and the files that run with
it.
"""

from __future__ import annotations

import ast
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ...core.errors import BodyError
from ...core.storage.files import read_regular

#: Suffixes of files that Python imports.
MODULE_SUFFIXES = (".py", ".pyc", ".so", ".pyd")


@dataclass(frozen=True)
class ScriptText:
    """A body script and the programs next to it.

    Attributes:
        path: The script.
        files: Name in the script's folder and content of each file, the script first.
    """

    path: Path
    files: tuple[tuple[str, bytes], ...]

    @property
    def digest(self) -> str:
        """SHA-256 of all files with their names."""
        hasher = hashlib.sha256()
        for name, content in self.files:
            for part in (name.encode(errors="surrogateescape"), content):
                hasher.update(len(part).to_bytes(8, "little") + part)
        return hasher.hexdigest()


def read_script(path: Path) -> ScriptText:
    """Read a script and all files that may run with it.

    These are the files of its own folder that it imports, and those with names that any library may
    import, since that folder is searched first.

    Raises:
        BodyError: If the script cannot be read.
    """
    try:
        files = {path.name: read_regular(path)}
        queue = [path.name, *_find_importable(path.parent)]
    except OSError as error:
        raise BodyError(
            f"cannot be read: {error.strerror}",
            code="file-unreadable",
            where=path,
            action="Give another script",
        ) from None
    while queue:
        name = queue.pop()
        if name not in files:
            try:
                files[name] = read_regular(path.parent / name)
            except OSError:
                continue  # an import will not find it either
        queue += [n for n in _find_imports(path.parent, name, files[name]) if n not in files]
    first = (path.name, files.pop(path.name))
    return ScriptText(path, (first, *sorted(files.items())))


def _find_importable(folder: Path) -> list[str]:
    """Return the modules of a folder, and all files of its packages."""
    names = []
    for entry in folder.iterdir():
        if entry.suffix in MODULE_SUFFIXES and entry.is_file():
            names.append(entry.name)
        elif any((entry / f"__init__{suffix}").is_file() for suffix in MODULE_SUFFIXES):
            inside = [p for p in entry.rglob("*") if p.suffix in MODULE_SUFFIXES and p.is_file()]
            names += [p.relative_to(folder).as_posix() for p in inside]
    return names


def _find_imports(folder: Path, importer: str, content: bytes) -> list[str]:
    """Return the files of the folder that the text of `importer` imports; none if it is not
    Python.
    """
    try:
        tree = _parse(content)
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
    files = []
    for module in modules:
        places = (module, *module.parents)[:-1]
        names = [n for p in places for n in (p / "__init__.py", p.parent / f"{p.name}.py")]
        files += [n.as_posix() for n in names if (folder / n).is_file()]
    return sorted(files)


Kind = Literal["number", "whole", "switch", "text", "choice", "other"]
#: Range of a number in multiples of its default, if the script does not state one.
MIN_FACTOR, MAX_FACTOR = 0.2, 3.0
_KINDS: dict[str, Kind] = {"float": "number", "int": "whole", "bool": "switch", "str": "text"}
_PAIR = 2


@dataclass(frozen=True)
class Parameter:
    """A parameter of `body` in a script.

    Attributes:
        name: Its name.
        kind: What kind of value it takes.
        default: Its default; None if there is none or it cannot be read.
        low: The script's lower bound of a number, or None.
        high: The script's upper bound of a number, or None.
        unit: Unit of a number.
        choices: Values of a choice.
    """

    name: str
    kind: Kind
    default: Any = None
    low: float | None = None
    high: float | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()

    def bounds(self, value: float) -> tuple[float, float]:
        """Return the range of a number that is `value` now: the script's bounds, or a fifth to
        three times its default. The range always contains `value`.
        """
        base = self.default if _is_number(self.default) else value
        limits = sorted((MIN_FACTOR * base, MAX_FACTOR * base)) if base else (-10.0, 10.0)
        if self.kind == "whole":
            limits = (math.floor(limits[0]), math.ceil(limits[1]))
        low = limits[0] if self.low is None else self.low
        high = limits[1] if self.high is None else self.high
        return min(low, value), max(high, value)


def read_parameters(path: Path, given: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Read the parameters of `body` in a script, in its order.

    Args:
        path: The script.
        given: The device's values, which show the kind of parameters without default and
            annotation.

    Raises:
        BodyError: If the script cannot be read, is not Python, or has no function `body`.
    """
    try:
        tree = _parse(read_regular(path), str(path))
    except SyntaxError as error:
        raise BodyError(
            f"is not valid Python ({error.msg})",
            code="script-syntax",
            where=f"{path.name}:{error.lineno}",
            action="Fix that line",
            line=error.lineno,
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        raise BodyError(f"cannot be read: {error}", code="file-unreadable", where=path) from None
    functions = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "body"]
    if not functions:
        raise BodyError(
            "defines no function body(...)",
            code="no-body-function",
            where=path.name,
            action="Add one that returns a solid",
        )
    arguments = functions[-1].args
    plain = [*arguments.posonlyargs, *arguments.args]
    defaults: list[ast.expr | None] = [None] * (len(plain) - len(arguments.defaults))
    defaults += arguments.defaults
    # Positional-only arguments cannot be set, since parameters are passed by name.
    pairs = [*zip(plain, defaults, strict=True)][len(arguments.posonlyargs) :]
    pairs += zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    return tuple(_parameter(a, d, given.get(a.arg)) for a, d in pairs)


def _parameter(argument: ast.arg, default: ast.expr | None, given: Any) -> Parameter:
    value = _literal(default)
    kind, details, unit = _read_annotation(argument.annotation)
    if kind is None:
        kind = _kind_of(value)
    if kind == "other" and value is None:  # whole numbers in device.toml may stand for any number
        kind = "number" if _is_number(given) else _kind_of(given)
    low = high = None
    choices: tuple[str, ...] = ()
    if kind == "text" and isinstance(details, tuple) and all(isinstance(x, str) for x in details):
        kind, choices = "choice", details
    elif kind in ("number", "whole") and isinstance(details, tuple) and len(details) == _PAIR:
        low, high = (float(x) if _is_number(x) else None for x in details)
        if low is not None and high is not None and low >= high:
            low = high = None
    if unit is None:
        unit = "mm" if kind == "number" else ""
    return Parameter(argument.arg, kind, value, low, high, unit, choices)


def _read_annotation(annotation: ast.expr | None) -> tuple[Kind | None, Any, str | None]:
    """Return the kind, the bounds or choices of Annotated or Literal, and the unit of Annotated."""
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        try:
            annotation = ast.parse(annotation.value, mode="eval").body
        except (SyntaxError, ValueError):
            return None, None, None
    if isinstance(annotation, ast.Subscript):
        name = _last_name(annotation.value)
        content = annotation.slice
        parts = content.elts if isinstance(content, ast.Tuple) else [content]
        if name == "Annotated" and len(parts) >= _PAIR:
            values_ = [_literal(p) for p in parts[1:]]
            unit = next((x for x in values_ if isinstance(x, str)), None)
            bounds = next((x for x in values_ if isinstance(x, tuple)), None)
            return _read_annotation(parts[0])[0], bounds, unit
        if name == "Literal":
            values = tuple(_literal(p) for p in parts)
            texts = all(isinstance(v, str) for v in values)
            return ("text", values, None) if texts else (None, None, None)
    return _KINDS.get(_last_name(annotation)), None, None


def _last_name(node: ast.expr | None) -> str:
    """Return the last name of an annotation: "float" for typing.float."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _kind_of(value: Any) -> Kind:
    kinds: dict[type, Kind] = {bool: "switch", int: "whole", float: "number", str: "text"}
    return kinds.get(type(value), "other")


def _literal(node: ast.expr | None) -> Any:
    """Return the value of a literal, or None."""
    if node is None:
        return None
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
        return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _parse(source: bytes, name: str = "<unknown>") -> ast.Module:
    """Return the syntax tree of a script.

    Raises:
        SyntaxError: The script is not valid Python.
    """
    try:
        return ast.parse(source, name)
    except SystemError:  # CPython gh-106905: garbage collected meanwhile has compiled other code
        return ast.parse(source, name)
