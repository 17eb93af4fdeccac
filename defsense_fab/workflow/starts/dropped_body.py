"""A file of a body as it came, looked at: its surface, the unit that it is likely in."""

from __future__ import annotations

import ast
import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import BodySpec
from ...core.errors import BodyError
from ...core.mesh import Surface
from ...core.storage.file_names import safe_name
from ...core.storage.files import storage_errors
from ...geometry.bodies.body import load_body
from ...geometry.bodies.body_file import read_body_file
from ...geometry.bodies.mesh_files import FORMAT_NAMES, detect_format
from .body_ends import thickness
from .units import UNITS, likely_unit

_THICK, _LONG, _MOST_TETS = 5, 10, 60000
#: So many tets has a volume of the cube of their edge length.
TETS = 8.5
SCRIPT = ".py"
_MM = re.compile(r"\bmm(?=3?\b)")


@dataclass(frozen=True)
class DroppedBody:
    """A body's file as it came: its `content`, a `name` that is safe beside others and has no
    suffix, the `suffix` by its content; its `surface` as the file is read, whose lengths are mm if
    the file is in the `own` unit of its format; the `unit` that it is likely in, and whether that
    is `doubtful`; what was `repaired`. Of a script also the `parameters` that it has defaults for,
    and the `others` that it needs, by their place beside it."""

    content: bytes
    name: str
    suffix: str
    surface: Surface
    unit: str
    doubtful: bool
    repaired: tuple[str, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    others: Mapping[str, bytes] = field(default_factory=dict)
    own: str = "mm"

    @property
    def key(self) -> str:
        """What it is called under [body] of device.toml."""
        return {".step": "step", SCRIPT: "script"}.get(self.suffix, "mesh")

    def scale(self, unit: str) -> float:
        """[body] scale of device.toml where the file is in that unit."""
        return UNITS[unit] / UNITS[self.own]

    def size(self, unit: str) -> Float:
        """Extents (3,) mm where the file is in that unit."""
        return np.asarray(np.ptp(self.surface.vertices, axis=0) * self.scale(unit))

    def told_size(self, unit: str) -> str:
        """The same in words."""
        return " x ".join(f"{x:,.4g}" if x < 1e4 else f"{x:,.0f}" for x in self.size(unit)) + " mm"

    def repairs(self, unit: str) -> tuple[str, ...]:
        """What was repaired, told in that unit, in which the file is; in the file's lengths where
        that is not the unit of its format."""
        if self.scale(unit) == 1:
            return self.repaired
        word = unit if self.own == "mm" else "of the file's lengths"
        return tuple(_MM.sub(word, line) for line in self.repaired)

    def table(self, file: str, unit: str) -> dict[str, Any]:
        """`[body]` of a device.toml beside which it lies as `file`, in that unit."""
        body: dict[str, Any] = {self.key: file}
        if self.parameters:
            body["parameters"] = dict(self.parameters)
        if self.scale(unit) != 1:
            body["scale"] = float(f"{self.scale(unit):.12g}")
        if any(line.startswith("filled ") for line in self.repaired):
            body["fill_cavities"] = True
        return body

    def in_mm(self, unit: str) -> Surface:
        """Its surface where the file is in that unit."""
        return Surface(self.surface.vertices * self.scale(unit), self.surface.faces)

    def edge_length(self, unit: str) -> float:
        """A fifth of the thickness, within what can be solved soon, mm."""
        surface = self.in_mm(unit)
        edge = min(thickness(surface) / _THICK, self.size(unit).max() / _LONG)
        return float(f"{max(edge, float(np.cbrt(TETS * surface.volume / _MOST_TETS))):.2g}")


def worth_telling(repairs: Iterable[str]) -> list[str]:
    """Without what is done to every file of some kinds: STL has each vertex several times."""
    return [line for line in repairs if not line.startswith("merged")]


def look_at(path: Path) -> DroppedBody:
    """A body's file on this machine: a script, which is run, or what `look_at_file` takes. Raises
    BodyError, StorageError."""
    if path.is_dir():
        raise BodyError(f"{path}: is a folder; give the file of a body")
    if not path.exists():
        raise BodyError(f"{path}: no such file; check its name and folder")
    with storage_errors(path):
        content = path.read_bytes()
    if not content:
        raise BodyError(f"{path}: is empty; export the body again")
    if path.suffix.lower() == SCRIPT:
        return _look_at_script(path, content)
    return look_at_file(path.name, content)


def look_at_file(name: str, content: bytes) -> DroppedBody:
    """What was dropped. Raises BodyError for what is no body, by its content."""
    suffix = detect_format(content)
    shown = safe_name(name)
    if suffix is None:
        raise BodyError(
            f"{shown}: is neither STEP nor a mesh by what is in it; export the body as STEP,"
            f" {FORMAT_NAMES}"
        )
    with tempfile.TemporaryDirectory(prefix="defsense-") as folder:
        path = Path(folder) / f"{shown}{suffix}"
        path.write_bytes(content)
        found = read_body_file(path)
    longest = float(np.ptp(found.surface.vertices, axis=0).max())
    own = next((name for name, mm in UNITS.items() if mm == found.unit), "mm")
    unit, doubtful = ("mm", False)
    if suffix != ".step":
        unit, doubtful = likely_unit(longest / UNITS[own], own)
    return DroppedBody(
        content, shown, suffix, found.surface, unit, doubtful, found.repairs, own=own
    )


def _look_at_script(path: Path, content: bytes) -> DroppedBody:
    path = path.absolute()
    body = load_body(BodySpec("script", path, {}))
    beside = [s.path for s in body.sources if s.content and s.path.is_relative_to(path.parent)]
    with storage_errors(path):
        others = {
            p.relative_to(path.parent).as_posix(): p.read_bytes() for p in beside if p != path
        }
    return DroppedBody(
        content, safe_name(path.name), SCRIPT, body.surface, "mm", False, body.repairs,
        _defaults(content), others,
    )  # fmt: skip


def _defaults(script: bytes) -> dict[str, Any]:
    """Of body(...), those that device.toml can hold."""
    found: dict[str, Any] = {}
    for node in ast.parse(script).body:
        if not isinstance(node, ast.FunctionDef) or node.name != "body":
            continue
        a = node.args
        places = a.posonlyargs + a.args
        pairs = [*zip(places[len(places) - len(a.defaults) :], a.defaults, strict=True)]
        pairs += [(k, d) for k, d in zip(a.kwonlyargs, a.kw_defaults, strict=True) if d]
        for argument, default in pairs:
            if argument in a.posonlyargs:
                continue  # parameters are given by their names
            if isinstance(default, ast.Constant) and isinstance(default.value, str | int | float):
                found[argument.arg] = default.value
    return found
