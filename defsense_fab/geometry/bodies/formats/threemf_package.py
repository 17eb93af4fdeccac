"""Parse the files inside a 3MF file: models, and what slicers write about their volumes.

Models are parsed without their colors and materials, which a body does not need and which may be
invalid.
"""

from __future__ import annotations

import posixpath
import re
import zipfile
import zlib
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from ....core.arrays import Float
from ....core.errors import BodyError

#: Volume that slicers subtract from the others of its object.
NEGATIVE = "negative volume"
#: Kinds of volumes by the names that slicers use; empty for those of the body.
_VOLUME_KINDS = {
    "modelpart": "",
    "normal_part": "",
    "negativevolume": NEGATIVE,
    "negative_part": NEGATIVE,
    "parametermodifier": "modifier",
    "modifier_part": "modifier",
    "supportblocker": "support blocker",
    "support_blocker": "support blocker",
    "supportenforcer": "support enforcer",
    "support_enforcer": "support enforcer",
    "seamposition": "seam position",
    "brimpatch": "brim patch",
}
#: Kinds of objects by the settings of Cura that make them something else than a body.
CURA_KINDS = {
    "cura:infill_mesh": "modifier",
    "cura:cutting_mesh": "modifier",
    "cura:support_mesh": "support",
    "cura:anti_overhang_mesh": "support blocker",
}
_MM = {
    "micron": 1e-3,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1e3,
}
_NAMESPACES = "http://schemas.microsoft.com/3dmanufacturing/"
_CORE = f"{_NAMESPACES}core/2015/02 "
_VERTEX, _TRIANGLE, _METADATA = f"{_CORE}vertex", f"{_CORE}triangle", f"{_CORE}metadata"
_OBJECT, _MESH = f"{_CORE}object", f"{_CORE}mesh"
_MODEL, _ITEM, _COMPONENT = f"{_CORE}model", f"{_CORE}item", f"{_CORE}component"
_PATH = f"{_NAMESPACES}production/2015/06 path"
_RESOLUTION = f"{_NAMESPACES}slice/2015/07 meshresolution"
#: Extensions that are read, that a body can do without, or whose shapes are refused by name.
_KNOWN_EXTENSIONS = re.compile(r".*/(beamlattice|material|production|slice|trianglesets)/")
_BLOCK_BYTES = 2**16


@dataclass(frozen=True)
class Reference:
    """A use of an object: an item of the build, or a component of another object.

    Attributes:
        object_id: Number of the object.
        path: File inside the 3MF file that has the object; empty for the same file.
        matrix: Transform (4, 3) of row vectors, mm or the unit of the file.
        is_printable: Whether it is an item to be printed.
    """

    object_id: int
    path: str
    matrix: Float
    is_printable: bool = True


@dataclass
class ModelObject:
    """An object of a model.

    Attributes:
        kind: Its type, such as "model" or "support".
        metadata: Values by name.
        vertices: Coordinates, three per vertex.
        triangles: Vertices, three per triangle.
        components: Objects that it consists of.
        shapes: Names of shapes of extensions, such as "beamlattice".
    """

    kind: str
    metadata: dict[str, str] = field(default_factory=dict)
    vertices: array[float] = field(default_factory=lambda: array("f"))
    triangles: array[int] = field(default_factory=lambda: array("q"))
    components: list[Reference] = field(default_factory=list)
    shapes: list[str] = field(default_factory=list)


@dataclass
class Model:
    """A model file.

    Attributes:
        unit: Millimetres of its unit.
        objects: Objects by number.
        items: Items of the build.
    """

    unit: float = 1.0
    objects: dict[int, ModelObject] = field(default_factory=dict)
    items: list[Reference] = field(default_factory=list)


@dataclass
class VolumeKinds:
    """Kinds of the volumes of objects; empty for those of the body.

    Attributes:
        ranges: First and last triangle and kind of the volumes of an object.
        parts: Kinds by the number of an object and that of its component.
    """

    ranges: dict[int, list[tuple[int, int, str]]] = field(default_factory=dict)
    parts: dict[tuple[int, int], str] = field(default_factory=dict)


def damaged(problem: str) -> BodyError:
    """Return the error that a file is damaged."""
    return BodyError(problem, code="file-invalid", action="Export it again")


class Package:
    """A 3MF file as an archive of files.

    Args:
        path: The file.

    Raises:
        BodyError: The archive is damaged (`file-invalid`).
    """

    def __init__(self, path: Path) -> None:
        try:
            self._archive = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, ValueError, EOFError) as error:
            raise damaged("its archive is damaged or cut off") from error
        self._members = {_normal(m.filename): m for m in self._archive.infolist()}

    def model_path(self) -> str:
        """Return the path of the model with the build.

        Raises:
            BodyError: There is none (`file-invalid`).
        """
        targets: list[str] = []

        def start(_: str, attributes: Mapping[str, str]) -> None:
            if attributes.get("Type", "").endswith("/3dmodel"):
                targets.append(attributes["Target"])

        if "_rels/.rels" in self._members:
            self._parse("_rels/.rels", start)
        targets += [name for name in self._members if re.fullmatch(r"3d/[^/]*\.model", name)]
        if not targets:
            raise damaged("holds no model")
        return targets[0]

    def read_model(self, path: str) -> Model:
        """Read a model file.

        Raises:
            BodyError: It is damaged (`file-invalid`), or needs an extension that is not read
                (`extension-unsupported`).
        """
        reader = _ModelReader()
        self._parse(path, reader.start, reader.end, reader.text, reader.namespace)
        return reader.model

    def read_volume_kinds(self) -> VolumeKinds:
        """Read the kinds of volumes from the files of PrusaSlicer, SuperSlicer, Bambu and Orca.

        Raises:
            BodyError: Such a file is damaged (`file-invalid`), or has a volume of an unknown kind
                (`volume-kind-unknown`).
        """
        reader = _VolumeReader()
        for name in self._members:
            if re.fullmatch(r"metadata/.*\.config", name) and self._is_xml(name):
                self._parse(name, reader.start, reader.end)
        return reader.kinds

    def _is_xml(self, path: str) -> bool:
        with self._open(path) as file:
            return bool(file.read(256).lstrip(b"\xef\xbb\xbf\xff\xfe\0 \t\r\n").startswith(b"<"))

    def _open(self, path: str) -> Any:
        try:
            return self._archive.open(self._members[_normal(path)])
        except KeyError:
            raise damaged(f"names {path[:80]!r}, which it does not hold") from None
        except (zipfile.BadZipFile, NotImplementedError, RuntimeError, OSError) as error:
            raise damaged(f"{path[:80]} is encrypted or damaged in its archive") from error

    def _parse(
        self,
        path: str,
        start: Callable[[str, dict[str, str]], None],
        end: Callable[[str], None] | None = None,
        text: Callable[[str], None] | None = None,
        namespace: Callable[[str | None, str | None], None] | None = None,
    ) -> None:
        """Parse an XML file with handlers of its elements and characters."""
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.CharacterDataHandler, parser.StartNamespaceDeclHandler = text, namespace
        parser.StartDoctypeDeclHandler = _refuse_doctype

        def place() -> str:
            return f"line {parser.CurrentLineNumber} of {path.lstrip('/')[:80]}"

        try:
            with self._open(path) as file:
                while block := file.read(_BLOCK_BYTES):
                    parser.Parse(block, False)
                parser.Parse(b"", True)
        except BodyError:
            raise
        except expat.ExpatError as error:
            raise damaged(f"{place()} is not valid XML") from error
        except KeyError as error:
            raise damaged(f"{place()} lacks {str(error)[:40]}") from error
        except (ValueError, OverflowError) as error:
            raise damaged(f"{place()} holds a value that is not a number in range") from error
        except (AttributeError, IndexError, LookupError) as error:
            raise damaged(f"{place()} has an element in a wrong place") from error
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError) as error:
            raise damaged(f"{path[:80]} is damaged in its archive") from error


def _normal(path: str) -> str:
    return posixpath.normpath(path.replace("\\", "/")).lstrip("/").lower()


def _refuse_doctype(*_: Any) -> None:
    raise damaged("has a document type, which 3MF does not allow")


def _matrix(text: str | None) -> Float:
    """Return the transform (4, 3) of an attribute."""
    if text is None:
        return np.eye(4)[:, :3]
    values = np.array([float(word) for word in text.split()])
    if len(values) != 12 or not np.isfinite(values).all():
        raise ValueError(text)
    return values.reshape(4, 3)


def _reference(attributes: Mapping[str, str]) -> Reference:
    return Reference(
        int(attributes["objectid"]),
        attributes.get(_PATH, ""),
        _matrix(attributes.get("transform")),
        attributes.get("printable", "1").strip().lower() not in ("0", "false"),
    )


class _ModelReader:
    """Handlers of the elements of a model file."""

    def __init__(self) -> None:
        self.model = Model()
        self._object: Any = None
        self._stack: list[str] = []
        self._prefixes: dict[str | None, str | None] = {}
        self._metadata: str | None = None

    def namespace(self, prefix: str | None, uri: str | None) -> None:
        self._prefixes[prefix] = uri

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if name == _VERTEX:
            x, y, z = attributes["x"], attributes["y"], attributes["z"]
            self._object.vertices.extend((float(x), float(y), float(z)))
        elif name == _TRIANGLE:
            a, b, c = attributes["v1"], attributes["v2"], attributes["v3"]
            self._object.triangles.extend((int(a), int(b), int(c)))
        elif not self._stack:
            self._start_model(name, attributes)
        elif name == _OBJECT:
            self._start_object(attributes)
        elif name == _COMPONENT:
            self._object.components.append(_reference(attributes))
        elif name == _ITEM:
            self.model.items.append(_reference(attributes))
        elif self._object is not None:
            self._start_other(name, attributes)
        if name not in (_VERTEX, _TRIANGLE):
            self._stack.append(name)

    def end(self, name: str) -> None:
        if name in (_VERTEX, _TRIANGLE):
            return
        self._stack.pop()
        if name == _OBJECT:
            self._object = None
        elif name == _METADATA:
            self._metadata = None

    def text(self, text: str) -> None:
        if self._metadata is not None and self._object is not None:
            values = self._object.metadata
            values[self._metadata] = values.get(self._metadata, "") + text

    def _start_model(self, name: str, attributes: Mapping[str, str]) -> None:
        if name != _MODEL:
            raise damaged("holds no 3MF model but another XML file")
        unit = attributes.get("unit", "millimeter")
        if unit not in _MM:
            raise damaged(f"its unit {unit[:20]!r} is none of {', '.join(_MM)}")
        self.model.unit = _MM[unit]
        for prefix in attributes.get("requiredextensions", "").split():
            uri = self._prefixes.get(prefix) or prefix
            if not _KNOWN_EXTENSIONS.match(uri):
                raise BodyError(
                    f"needs the extension {uri[:100]}, which is not read",
                    code="extension-unsupported",
                    action="Export the body as a mesh without that extension",
                    extension=uri,
                )

    def _start_object(self, attributes: Mapping[str, str]) -> None:
        number = int(attributes["id"])
        if number in self.model.objects:
            raise damaged(f"defines the object {number} twice")
        self._object = ModelObject(attributes.get("type", "model"))
        self.model.objects[number] = self._object
        if attributes.get(_RESOLUTION) == "lowres":
            self._object.shapes.append("slicestack")

    def _start_other(self, name: str, attributes: Mapping[str, str]) -> None:
        uri, _, local = name.rpartition(" ")
        if name == _METADATA:
            self._metadata = attributes.get("name")
        elif local in ("beam", "ball") and "/beamlattice/" in uri:
            self._object.shapes.append("beamlattice")
        elif self._stack[-1] == _OBJECT and not name.startswith(_CORE):
            self._object.shapes.append(local)


class _VolumeReader:
    """Handlers of the elements of a slicer's file on the volumes of objects."""

    def __init__(self) -> None:
        self.kinds = VolumeKinds()
        self._object: int | None = None
        self._volume: Mapping[str, str] | None = None
        self._kind = ""

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if name == "object" and "id" in attributes:
            self._object = int(attributes["id"])
        elif name in ("volume", "part") and self._object is not None:
            self._volume, self._kind = attributes, attributes.get("subtype", "")
        elif name == "metadata" and self._volume is not None:
            key, value = attributes.get("key"), attributes.get("value", "")
            if key == "volume_type" or (key == "modifier" and value == "1"):
                self._kind = value if key == "volume_type" else "parametermodifier"

    def end(self, name: str) -> None:
        if name == "object":
            self._object = None
        elif name in ("volume", "part") and self._volume is not None:
            self._add(int(self._object or 0), self._volume)
            self._volume = None

    def _add(self, number: int, volume: Mapping[str, str]) -> None:
        kind = _VOLUME_KINDS.get(self._kind.lower()) if self._kind else ""
        if kind is None:
            raise BodyError(
                f"holds a volume of the unknown kind {self._kind[:40]!r}",
                code="volume-kind-unknown",
                action="Export the body alone, as STL",
                kind=self._kind,
            )
        if "firstid" in volume:
            triangles = int(volume["firstid"]), int(volume["lastid"])
            self.kinds.ranges.setdefault(number, []).append((*triangles, kind))
        elif "id" in volume:
            self.kinds.parts[number, int(volume["id"])] = kind
