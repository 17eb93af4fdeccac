"""A device: its body, material, poses and cords, from a folder or from Python values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import tomlkit

from ..core.device.build_folder import refuse_outside
from ..core.device.device import Device as DeviceRecord
from ..core.device.device_file import DEVICE, load_device
from ..core.device.regions import Shape
from ..core.errors import DeviceError, StorageError
from ..core.progress import Progress, silent
from .bodies import write_body
from .build.build import build
from .build.stages import STAGES
from .given import called, each_of, path, whole
from .plain import table
from .poses import DrawnCord, Pose
from .regions import region_tables
from .starts.usual import MOST_CORDS
from .study.points.studied_device import studied_text
from .workspace import Workspace


class Device:
    """A device as it was read or made; it does not change, and neither does its folder.

    What is computed from it is kept in a temporary folder of its own while it is in use. Only
    `save` and `build` write elsewhere. `notes` tell what was repaired of the body that it was
    created from, and whether its size is unusual.
    """

    def __init__(
        self, workspace: Workspace, source: Path | None, notes: tuple[str, ...] = ()
    ) -> None:
        """By `Device.load` or `Device.create`."""
        self.workspace, self._source, self.notes = workspace, source, notes
        self.record: DeviceRecord = workspace.read()

    @staticmethod
    def load(folder: str | Path) -> Device:
        """The device of a folder with device.toml, and what is up to date of its build. Raises
        DeviceError for what is wrong in the file, with its line and key, and for a body outside of
        the folder."""
        source = path(folder, "folder")
        refuse_outside(load_device(source))
        text = (source / DEVICE).read_text(encoding="utf-8")
        return Device(Workspace.copy_of(source, text), source)

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
        anchor: str | None = None,
        values: Mapping[str, object] | None = None,
    ) -> Device:
        """A device without a file.

        `body` is a path, a build123d shape, a trimesh or a Surface; `material`, `cord` and
        `process` are names of rows of the package's tables; `regions` parts of the body by name, in
        mm; `poses` what is to be sensed. `cords` are drawn, and so many more are found that there
        are `sensors` in all, 16 at most. Tetrahedra have edges of `edge_length` mm. Where a region
        is named `anchor`, it holds still. `values` sets further keys of device.toml, as in
        {"cord.noise": 0.002}.

        `units` are those of a mesh: "mm", "cm", "m", "inch" or "um". Where they are not given, a
        mesh is in mm, or in the unit that its file says, and one of a size that soft devices do not
        have is refused with the unit that it is likely in. STEP, scripts and shapes say their own.
        A mesh is repaired as `defsense new` does, and `notes` tell what was.

        Raises BodyError for what is no body, DeviceError for the other values; messages name them
        as device.toml does.
        """
        count = None if sensors is None else whole(sensors, "sensors", most=MOST_CORDS)
        further = table({} if values is None else values)
        data = table({
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
        workspace = Workspace()
        data["body"], notes = write_body(body, units, edge_length, workspace.folder)
        workspace.write(studied_text(tomlkit.dumps(data), further))
        return Device(workspace, None, notes)

    def changed(self, values: Mapping[str, object]) -> Device:
        """The device with other values at dotted keys of device.toml, as in {"cord.noise": 0.002}
        or {"poses.bend.handles.1.rotate.degrees": 20}; what is the same is not computed again.
        Raises DeviceError for a value that cannot be, StudyError for a key that leads nowhere."""
        text = studied_text(self.workspace.text, table(values))
        return Device(Workspace.copy_of(self.workspace.folder, text), None, self.notes)

    @property
    def name(self) -> str:
        """As in device.toml."""
        return self.record.name

    @property
    def text(self) -> str:
        """What its device.toml holds."""
        return self.workspace.text

    @property
    def poses(self) -> tuple[str, ...]:
        """Names of the poses."""
        return tuple(p.name for p in self.record.poses)

    @property
    def regions(self) -> Mapping[str, Shape]:
        """Named parts of the body, mm in its rest frame."""
        return dict(self.record.regions)

    def save(self, folder: str | Path) -> Device:
        """Write device.toml and the body into a folder that has no device yet; the device that is
        there. Raises StorageError."""
        self.workspace.save(path(folder, "folder", StorageError))
        return Device.load(folder)

    def build(self, until: str = "report", progress: Progress = silent) -> Path:
        """Build in the folder that the device was loaded from, as `defsense build` does; the folder
        of the build. Raises DeviceError for a device without a folder, or whose device.toml changed
        since it was loaded, and what the stages raise."""
        called(progress)
        stages = [s.name for s in STAGES]
        if until not in stages:
            raise DeviceError(
                f"until {until!r}: there is no such stage; there are {', '.join(stages)}"
            )
        if self._source is None:
            raise DeviceError(f"device {self.name!r}: is in no folder; use save(folder) first")
        record = load_device(self._source)
        if (self._source / DEVICE).read_text(encoding="utf-8") != self.text:
            raise DeviceError(
                f"{self._source / DEVICE}: changed since it was loaded; load it again"
            )
        return build(record, until, progress).folder

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
    """Names and values for a notebook."""
    body = "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows.items())
    return f"<table><caption>{escape(title)}</caption>{body}</table>"
