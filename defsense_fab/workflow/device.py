"""A device: its body, material, poses and cords, from a folder or from Python values."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import tomlkit

from ..core.device.build_folder import own_files, refuse_outside
from ..core.device.device import Device as DeviceRecord
from ..core.device.device_file import DEVICE, load_device, read_device
from ..core.device.regions import Shape
from ..core.errors import DeviceError, StorageError
from ..core.progress import Progress, silent
from ..core.schema.document import Document, parse_document
from ..core.storage.files import storage_errors
from ..store.build import Build
from .arguments import called, each_of, one_of, path, plain_table, whole
from .arguments import options as build_options
from .bodies import write_body
from .build.build import build
from .build.options import BuildOptions
from .build.stages import STAGES
from .changed_values import changed_text, changed_values
from .poses import DrawnCord, Pose, region_tables
from .starts.options import MAX_CORDS
from .starts.starting_devices import write_device

_BUILD = "build"


class Device:
    """A device as it was loaded or created; it does not change, and neither does its folder.

    Results are kept in a temporary folder while the device is in use, and reused by devices that
    were derived from it with `changed`. Only `save` and `build` write elsewhere. Use `Device.load`
    or `Device.create`; do not instantiate directly.

    Attributes:
        record: The device as all other functions of the package take it.
        values: The contents of its `device.toml`.
        notes: What was repaired of the body, and whether its size is unusual.
    """

    def __init__(
        self,
        folder: Path,
        values: Mapping[str, Any],
        text: str = "",
        source: Path | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        self.values, self.notes = values, notes
        self._folder, self._text, self._source = folder, text, source
        self._end = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        document = Document(values, folder / DEVICE, text)
        self.record: DeviceRecord = read_device(document, folder, {}, complete=True)

    @staticmethod
    def load(folder: str | Path) -> Device:
        """Return the device of a folder with a `device.toml`.

        What is up to date of its build is reused.

        Args:
            folder: The device's folder.

        Raises:
            DeviceError: The file is invalid (with line and key), or names a body outside of the
                folder.
            StorageError: A file cannot be read.
        """
        source = path(folder, "folder")
        refuse_outside(load_device(source))
        text = (source / DEVICE).read_text(encoding="utf-8")
        values = parse_document(text, source / DEVICE).values
        return Device(_copy_of(source), values, text, source)

    @staticmethod
    def create(
        name: str,
        body: object,
        material: str,
        regions: Mapping[str, Shape],
        poses: Sequence[Pose],
        *,
        cord: str = "rubber-2mm",
        process: str = "fdm-tpu",
        cords: Sequence[DrawnCord] = (),
        sensors: int | None = None,
        edge_length: float,
        units: str | None = None,
        size: float | None = None,
        anchor: str | None = None,
        values: Mapping[str, object] | None = None,
    ) -> Device:
        """Create a device without a file.

        Args:
            name: Name in reports and files.
            body: Path to a STEP file, a mesh or a script; a build123d shape, a trimesh or a
                Surface. Meshes are repaired as `defsense new` does, and `notes` lists the repairs.
            material: Name of a material of the package.
            regions: Named parts of the body, mm.
            poses: Deformations that the device must sense.
            cord: Name of a cord of the package.
            process: Name of a fabrication process of the package.
            cords: Cords that are drawn.
            sensors: Number of cords in all, up to 16; the others are found.
            edge_length: Edge length of the tetrahedra, mm.
            units: Unit of a mesh: "mm", "cm", "m", "inch" or "um". By default that of its file, or
                mm; a mesh whose size is unusual for a soft device is then refused.
            size: Longest side of a mesh in mm, in place of `units` where no unit fits.
            anchor: Name of a region that holds still.
            values: Further keys of `device.toml`, as in `{"cord.noise": 0.002}`.

        Raises:
            BodyError: The body is not a closed solid.
            DeviceError: Another value is invalid; messages name it as `device.toml` does.
        """
        count = None if sensors is None else whole(sensors, "sensors", most=MAX_CORDS)
        further = plain_table({} if values is None else values)
        tables = plain_table({
            "schema": 1,
            "name": name,
            "body": {},
            "material": {"name": material},
            "mesh": {"edge_length": edge_length},
            "regions": region_tables(regions),
            "outputs": {} if anchor is None else {"anchor": anchor},
            "cord": {"name": cord},
            "fabrication": {"process": process},
            "design": {} if count is None else {"sensors": count},
            "poses": [pose.table() for pose in each_of(poses, "poses", Pose)],
            "sensors": [drawn.table() for drawn in each_of(cords, "cords", DrawnCord)],
        })  # fmt: skip
        folder = _new_folder()
        try:
            tables["body"], notes = write_body(body, units, edge_length, folder, size)
            return Device(folder, changed_values(tables, further), notes=notes)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def changed(self, values: Mapping[str, object]) -> Device:
        """Return the device with other values at dotted keys of `device.toml`.

        Results that do not depend on them are not computed again.

        Args:
            values: Values by key, as in `{"cord.noise": 0.002}` or
                `{"poses.bend.handles.1.rotate.degrees": 20}`.

        Raises:
            DeviceError: A value is invalid.
            StudyError: A key does not exist.
        """
        changes = plain_table(values)
        text = changed_text(self._text, changes) if self._text else ""
        folder = _copy_of(self._folder)
        try:
            return Device(folder, changed_values(self.values, changes), text, notes=self.notes)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    @property
    def name(self) -> str:
        """The device's name."""
        return self.record.name

    @property
    def text(self) -> str:
        """The text of its `device.toml`."""
        return self._text or tomlkit.dumps(dict(self.values))

    @property
    def poses(self) -> tuple[str, ...]:
        """Names of the poses."""
        return tuple(p.name for p in self.record.poses)

    @property
    def regions(self) -> Mapping[str, Shape]:
        """Named parts of the body, mm, rest frame."""
        return dict(self.record.regions)

    def results(self, until: str, progress: Progress = silent) -> Build:
        """Return the results of the device's build up to the stage `until`.

        Stages that are not up to date are run, in the device's temporary folder.

        Raises:
            DefsenseError: A stage failed.
        """
        called(progress)
        return build(self.record, until, progress).results

    def save(self, folder: str | Path) -> Device:
        """Write `device.toml` and the body into a folder that has no device, and load it.

        Raises:
            StorageError: The folder has a device, or cannot be written.
        """
        with storage_errors(self._folder):
            files = {
                file.relative_to(self._folder).as_posix(): file.read_bytes()
                for file in own_files(self._folder)
            }
        files.pop(DEVICE, None)
        write_device(path(folder, "folder", StorageError), files, self.text)
        return Device.load(folder)

    def build(self, until: str = "report", progress: Progress = silent, **options: Any) -> Path:
        """Build in the folder that the device was loaded from, as `defsense build` does.

        Args:
            until: Name of the last stage.
            progress: Receives each stage's name, completed fraction and a message.
            **options: Fields of `BuildOptions`, such as `copies=2`.

        Returns:
            The folder of the build.

        Raises:
            DeviceError: The device has no folder, its `device.toml` has changed since it was
                loaded, or an option is invalid.
            DefsenseError: A stage failed.
        """
        called(progress)
        one_of(until, "until", [s.name for s in STAGES], "stage")
        overrides = build_options(options, BuildOptions)
        if self._source is None:
            raise DeviceError(
                f"device {self.name!r} has no folder",
                code="device-unsaved",
                action="Use save(folder) first",
            )
        record = load_device(self._source)
        if (self._source / DEVICE).read_text(encoding="utf-8") != self._text:
            raise DeviceError(
                "changed since it was loaded",
                code="device-changed",
                where=self._source / DEVICE,
                action="Load it again",
            )
        return build(record, until, progress, options=overrides).folder

    def __repr__(self) -> str:
        r = self.record
        return (
            f"<Device {self.name!r}: {len(r.poses)} poses, {len(r.sensors) + r.propose} cords,"
            f" {r.material.name}>"
        )

    def _repr_html_(self) -> str:
        r = self.record
        rows = {
            "body": r.body.path.name,
            "material": f"{r.material.name}, E = {r.material.young_modulus:g} MPa",
            "poses": ", ".join(self.poses),
            "cords": f"{len(r.sensors)} drawn, {r.propose} to be found",
            "cord": f"{r.cord.name}, noise {r.cord.noise:g} of (R - R0)/R0",
        }
        return table_html(f"Device {self.name}", rows)


def table_html(title: str, rows: Mapping[str, str]) -> str:
    """Return names and values as a table for notebooks."""
    body = "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows.items())
    return f"<table><caption>{escape(title)}</caption>{body}</table>"


def _new_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="defsense-"))


def _copy_of(source: Path) -> Path:
    """Return a temporary folder with the files of a device and its build. Raises StorageError."""
    folder = _new_folder()
    try:
        with storage_errors(source):
            for file in own_files(source):
                target = folder / file.relative_to(source)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(file, target)
            if (source / _BUILD).is_dir():
                shutil.copytree(
                    source / _BUILD, folder / _BUILD, copy_function=_link, symlinks=True
                )
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def _link(source: str, target: str) -> None:
    """Link a file, or copy it: the files of a build are never rewritten."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
