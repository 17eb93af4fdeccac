"""A device from a file of a body: what it may be measured in, and a first device.toml."""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit

from ...core.arrays import Float
from ...core.device_file import parse_device
from ...core.errors import BodyError
from ...core.files import free_path
from ...core.mesh import Surface
from ...geometry.bodies.body import SIZES
from ...geometry.bodies.foreign_body import read_foreign
from ...geometry.bodies.meshes.file_kind import kind_of_file
from ...geometry.bodies.meshes.mesh_files import KINDS
from .starting_devices import put_device

#: Units of meshes, and mm in each; those that programs write more often first.
UNITS = {"mm": 1.0, "inch": 25.4, "cm": 10.0, "m": 1000.0}
_USUAL = (15.0, 600.0)  # mm: what soft devices measure along their longest axis
_THIN, _LONG, _MOST_TETS = 5, 6, 60000
_END = 15  # of the longest axis: a region at either end
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)  # names that are devices


@dataclass(frozen=True)
class DroppedBody:
    """A body's file as it came: its `content`, a `name` that is safe beside others and has no
    suffix, the `suffix` by its content; its `surface` in the file's unit; the `unit` that it is
    likely in, and whether that is `doubtful`; what was `repaired`."""

    content: bytes
    name: str
    suffix: str
    surface: Surface
    unit: str
    doubtful: bool
    repaired: tuple[str, ...]

    def size(self, unit: str) -> Float:
        """Extents (3,) mm where the file is in that unit."""
        return np.asarray(np.ptp(self.surface.vertices, axis=0) * UNITS[unit])

    def edge_length(self, unit: str) -> float:
        """A fifth of the thickness, within what can be solved soon, mm."""
        size, volume = self.size(unit), self.surface.volume * UNITS[unit] ** 3
        edge = min(size.min() / _THIN, size.max() / _LONG)
        return _short(max(edge, float(np.cbrt(8.5 * volume / _MOST_TETS))))


def look_at_file(name: str, content: bytes) -> DroppedBody:
    """What was dropped. Raises BodyError for what is no body, by its content."""
    suffix = kind_of_file(content)
    shown = safe_name(name)
    if suffix is None:
        raise BodyError(
            f"{shown}: is neither STEP nor a mesh by what is in it; export the body as STEP,"
            f" {KINDS}"
        )
    with tempfile.TemporaryDirectory(prefix="defsense-") as folder:
        path = Path(folder) / f"{shown}{suffix}"
        path.write_bytes(content)
        found = read_foreign(path)
    longest = float(np.ptp(found.surface.vertices, axis=0).max())
    unit, doubtful = ("mm", False) if found.in_mm else likely_unit(longest)
    return DroppedBody(content, shown, suffix, found.surface, unit, doubtful, found.repaired)


def likely_unit(longest: float) -> tuple[str, bool]:
    """The unit in which so long a body is a device, and whether that is doubtful: only of mm it is
    not, since most files are in mm."""
    for unit, scale in UNITS.items():
        if _USUAL[0] <= longest * scale <= _USUAL[1]:
            return unit, unit != "mm"
    return "mm", True


def begin_from(
    dropped: DroppedBody, folder: Path, name: str, unit: str, material: str, edge_length: float
) -> None:
    """Write the body and its device.toml into a folder, which may not be there yet. Raises
    BodyError for a body of impossible size, DeviceError for a device that can be none, StorageError
    where there is a device, or the folder cannot be written."""
    size = float(np.linalg.norm(dropped.size(unit)))
    if not SIZES[0] <= size <= SIZES[1]:
        raise BodyError(f"{dropped.name}: would be {size:.3g} mm across; choose another unit")
    file = free_path(folder / f"{dropped.name}{dropped.suffix}").name
    text = device_text(dropped, file, name, unit, material, edge_length)
    with tempfile.TemporaryDirectory(prefix="defsense-") as other:  # is it a device?
        (Path(other) / file).touch()
        parse_device(text, Path(other), complete=False)
    put_device(folder, file, dropped.content, text)


def device_text(
    dropped: DroppedBody, file: str, name: str, unit: str, material: str, edge_length: float
) -> str:
    """device.toml as a person would begin it: the body held at one end of its longest axis, moved
    at the other; no poses and cords yet."""
    step = dropped.suffix == ".step"
    filled = any(line.startswith("filled ") for line in dropped.repaired)
    scale = UNITS[unit]
    lines = [
        "schema = 1", f"name = {_quoted(name)}", "",
        "[body]", f"{'step' if step else 'mesh'} = {_quoted(file)}",
        *([f"scale = {scale:g}  # of the unit of the file: {unit}"] if scale != 1 else []),
        *(["fill_cavities = true  # what is closed cannot be made"] if filled else []), "",
        "[material]", f"name = {_quoted(material)}", "",
        "[mesh]", f"edge_length = {_short(edge_length):g}", "",
        *_regions(scale * dropped.surface.vertices, edge_length), "",
        "[outputs]", "markers = 40", 'anchor = "base"', "",
        "[cord]", 'name = "rubber-2mm"', "",
        "[fabrication]", 'process = "fdm-tpu"',
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def safe_name(name: str) -> str:
    """A name for a file, made of one that came from elsewhere: no folders, no suffix, no hidden
    files, none that a system keeps for itself."""
    last = re.split(r"[/\\]", name)[-1]
    stem = re.sub(r"[^\w-]+", "-", last.rpartition(".")[0] or last, flags=re.ASCII)
    stem = stem.strip("-_")[:60] or "body"
    return f"body-{stem}" if _RESERVED.fullmatch(stem) else stem


def _regions(vertices: Float, edge_length: float) -> list[str]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    axis = int((high - low).argmax())
    depth = max(float((high - low)[axis]) / _END, edge_length)
    out = [f"# The ends along {'xyz'[axis]}.", "[regions]"]
    for name, at, sign in (("base", low[axis] + depth, -1), ("tip", high[axis] - depth, 1)):
        origin, normal = [0.0] * 3, [0] * 3
        origin[axis], normal[axis] = _short(float(at), 4), sign
        shown = ", ".join(f"{x:g}" for x in origin)
        out.append(f"{name} = {{ half_space = {{ origin = [{shown}], normal = {normal} }} }}")
    return out


def _short(value: float, digits: int = 2) -> float:
    return float(f"{value:.{digits}g}")


def _quoted(text: str) -> str:
    return tomlkit.item(text).as_string()
