"""A device: its body, material, poses and cords, from a folder or from Python values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import tomlkit

from ..core.device.device import Device as DeviceRecord
from ..core.device.device_file import DEVICE, load_device
from ..core.device.regions import Shape
from ..core.errors import DeviceError
from ..core.progress import Progress, silent
from ..pipeline.artifacts.own_files import refuse_outside
from ..pipeline.build.build import build
from ..pipeline.build.stages import STAGES
from ..pipeline.study.points.studied_device import studied_text
from .bodies import write_body
from .poses import DrawnCord, Pose, plain
from .regions import region_table
from .workspace import Workspace


class Device:
    """A device as it was read or made; it does not change, and neither does its folder.

    What is computed from it is kept in a temporary folder of its own while it is in use. Only
    `save` and `build` write elsewhere.
    """

    def __init__(self, workspace: Workspace, source: Path | None) -> None:
        """By `Device.load` or `Device.create`."""
        self.workspace, self._source = workspace, source
        self.record: DeviceRecord = workspace.read()

    @staticmethod
    def load(folder: str | Path) -> Device:
        """The device of a folder with device.toml, and what is up to date of its build. Raises
        DeviceError for what is wrong in the file, with its line and key, and for a body outside of
        the folder."""
        source = Path(folder)
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
        anchor: str | None = None,
        values: Mapping[str, object] | None = None,
    ) -> Device:
        """A device without a file.

        `body` is a path, a build123d shape, a trimesh or a Surface, in mm; `material`, `cord` and
        `process` are names of rows of the package's tables; `regions` parts of the body by name;
        `poses` what is to be sensed. `cords` are drawn, and so many more are found that there are
        `sensors` in all. Tetrahedra have edges of `edge_length` mm. Where a region is named
        `anchor`, it holds still. `values` sets further keys of device.toml, as in
        {"cord.noise": 0.002}.

        Raises BodyError for what is no body, DeviceError for the other values; messages name them
        as device.toml does.
        """
        workspace = Workspace()
        data: dict[str, Any] = {
            "schema": 1,
            "name": name,
            "body": write_body(body, workspace.folder),
            "material": {"name": material},
            "mesh": {"edge_length": plain(edge_length)},
            "regions": {n: region_table(n, shape) for n, shape in regions.items()},
            "outputs": {} if anchor is None else {"anchor": anchor},
            "cord": {"name": cord},
            "fabrication": {"process": process},
            "design": {} if sensors is None else {"sensors": sensors},
            "poses": [pose.table() for pose in poses],
            "sensors": [drawn.table() for drawn in cords],
        }
        workspace.write(_text(data, values or {}))
        return Device(workspace, None)

    def changed(self, values: Mapping[str, object]) -> Device:
        """The device with other values at dotted keys of device.toml, as in {"cord.noise": 0.002}
        or {"poses.bend.handles.1.rotate.degrees": 20}; what is the same is not computed again.
        Raises DeviceError for a value that cannot be, StudyError for a key that leads nowhere."""
        text = _with_values(self.workspace.text, values)
        return Device(Workspace.copy_of(self.workspace.folder, text), None)

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
        self.workspace.save(Path(folder))
        return Device.load(folder)

    def build(self, until: str = "report", progress: Progress = silent) -> Path:
        """Build in the folder that the device was loaded from, as `defsense build` does; the folder
        of the build. Raises DeviceError for a device without a folder, or whose device.toml changed
        since it was loaded, and what the stages raise."""
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


def _plain(value: Any) -> Any:
    """Without arrays in it, however deep."""
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _text(data: Mapping[str, Any], values: Mapping[str, object]) -> str:
    try:
        return _with_values(tomlkit.dumps(dict(data)), values)
    except (TypeError, ValueError) as error:  # of what TOML cannot hold
        raise _not_toml(error) from None


def _with_values(text: str, values: Mapping[str, object]) -> str:
    try:
        return studied_text(text, _plain(values))
    except (TypeError, ValueError) as error:
        raise _not_toml(error) from None


def _not_toml(error: Exception) -> DeviceError:
    return DeviceError(f"device: {error}; give numbers, texts, and lists of them")
