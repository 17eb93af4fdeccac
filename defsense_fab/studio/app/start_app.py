"""The start page: create a device from the gallery or an uploaded body, or open a recent one."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import tomlkit

from ...core.device.device_file import DEVICE, load_device
from ...core.device.materials import default_material
from ...core.errors import BodyError, DefsenseError, DeviceError
from ...core.storage.file_names import safe_name
from ...core.storage.files import unused_path
from ...core.storage.package_data import package_data, read_rows
from ...workflow.starts.body_file import (
    FORMAT_NAMES,
    BodyFile,
    choose_unit,
    describe_unusual_size,
    load_body_content,
    notable_repairs,
    scale_to_size,
)
from ...workflow.starts.first_device import create_first_device, edge_length_range
from ...workflow.starts.options import DEFAULT_PROCESS, UNITS, NewOptions
from ...workflow.starts.starting_devices import (
    STARTING_DEVICES,
    StartingDevice,
    create_starting_device,
)
from ...workflow.view import MAX_UPLOAD_BYTES, Arrays, Client, Request, WebServer
from ..messages import start as messages
from ..project.agreement import Agreement
from ..project.device_picture import picture_url, read_picture, store_picture
from ..project.recent_devices import RecentDevices
from ..session.body_arrays import surface_arrays
from ..session.step import Handler


class Studio(Protocol):
    """The page that shows one device at a time.

    Attributes:
        home: Folder of the command line.
        folder: Folder of the device that is open, or that was open last.
    """

    home: Path
    folder: Path

    @property
    def is_device_open(self) -> bool:
        """Whether a device is open."""

    def check_idle(self) -> None:
        """Check that no job of the device is running. Raises DefsenseError."""

    def open_folder(self, folder: Path) -> None:
        """Open the device in a folder. Raises DefsenseError."""

    def close_device(self) -> None:
        """Close the device. Raises DefsenseError."""


class StartApp:
    """Handles the requests of the start page, which each browser can show at any time.

    Args:
        server: Sends events to the browsers.
        studio: Opens and closes devices.
        agreement: The scripts that the user has agreed to run.
    """

    def __init__(self, server: WebServer, studio: Studio, agreement: Agreement) -> None:
        self._server, self._studio, self._agreement = server, studio, agreement
        self._recent = RecentDevices()
        self._lock = threading.RLock()  # two browsers may create a device at once
        self._uploads: dict[Client, BodyFile] = {}

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that the page handles."""
        return {
            messages.OpenDevice: lambda _, r: self._open(Path(r.folder)),
            messages.CloseDevice: lambda _, __: self._studio.close_device(),
            messages.ForgetDevice: self._forget,
            messages.KeepPicture: self._keep_picture,
            messages.CreateFromGallery: self._create_from_gallery,
            messages.DescribeUpload: self._describe,
            messages.UploadedSurface: self._surface,
            messages.CreateFromBody: self._create_from_body,
        }

    def publish(self) -> None:
        """Send the gallery and the recent devices to all browsers."""
        self._server.publish(gallery())
        self.publish_recent()

    def publish_recent(self) -> None:
        """Send the recent devices to all browsers."""
        self._server.publish(self.recent_devices())

    def recent_devices(self) -> messages.RecentDevices:
        """Return the recent devices, and where a new one is created."""
        studio, is_home_free = self._studio, self._is_home_free
        open_folder = studio.folder.absolute() if studio.is_device_open else None
        folder = studio.home.absolute() if is_home_free else studio.folder.absolute().parent
        return messages.RecentDevices(
            devices=[
                messages.RecentDevice(
                    name=entry.current_name,
                    folder=str(entry.folder),
                    opened_at=entry.opened_at,
                    picture=read_picture(entry.folder),
                    is_missing=entry.is_missing,
                    is_open=entry.folder == open_folder,
                )
                for entry in self._recent.read()
            ],
            folder=str(folder),
            is_new_folder=not is_home_free,
        )

    def remember(self, folder: Path, name: str) -> None:
        """Put a device first in the list."""
        self._recent.add(folder, name)

    def receive(self, client: Client, name: str, content: bytes) -> None:
        """Read an uploaded body. Raises BodyError."""
        self._uploads[client] = load_body_content(name, content)
        if not client.is_open:  # it was closed meanwhile, and nobody else forgets it
            self.disconnect(client)

    def disconnect(self, client: Client) -> None:
        """Forget the body that a browser has uploaded."""
        self._uploads.pop(client, None)

    # The list

    def _open(self, folder: Path) -> None:
        known = {entry.folder for entry in self._recent.read()}
        if folder not in known | {self._studio.home.absolute()}:
            raise DeviceError(
                "is not one of the listed devices",
                code="folder-not-listed",
                where=folder,
                action="Open it with `defsense studio FOLDER`",
            )
        if not (folder / DEVICE).is_file():
            self.publish_recent()
            raise DeviceError(
                f"has no {DEVICE} any more",
                code="file-not-found",
                where=folder,
                action="Remove it from the list, or move the folder back",
            )
        self._studio.open_folder(folder)

    def _forget(self, _: Client, request: messages.ForgetDevice) -> None:
        self._recent.remove(Path(request.folder))
        self.publish_recent()

    def _keep_picture(self, _: Client, request: messages.KeepPicture) -> None:
        if self._studio.is_device_open:
            store_picture(self._studio.folder, request.picture)
            self.publish_recent()

    # New devices

    @property
    def _is_home_free(self) -> bool:
        return not (self._studio.home / DEVICE).exists()

    def _new_folder(self, name: str) -> Path:
        if self._is_home_free:
            return self._studio.home
        parent = self._studio.folder.absolute().parent
        return unused_path(parent / safe_name(f"{name}."))

    def _create_from_gallery(self, _: Client, request: messages.CreateFromGallery) -> None:
        start = _starting_device(request.start)
        with self._lock:
            name = request.name.strip()
            if not name:
                home = self._studio.home.absolute()
                name = safe_name(f"{home.name}.") if self._is_home_free else start.name
            NewOptions(name=name)
            self._studio.check_idle()
            folder = self._new_folder(name)
            create_starting_device(start, folder, name)
            self._agree(start, folder)
            self._studio.open_folder(folder)

    def _agree(self, start: StartingDevice, folder: Path) -> None:
        """Agree to the package's own script.

        The user is still asked if other files of the folder would run with it.
        """
        script = self._agreement.script_to_confirm(load_device(folder, complete=False).body)
        if script is not None and [content for _, content in script.files] == [start.script]:
            self._agreement.confirm(script)

    def _uploaded(self, client: Client) -> BodyFile:
        body = self._uploads.get(client)
        if body is None:
            raise BodyError("no body is uploaded", code="no-upload", action="Upload one")
        return body

    def _describe(self, client: Client, request: messages.DescribeUpload) -> messages.UploadedBody:
        options = NewOptions(units=request.unit, size=request.size)
        body = scale_to_size(self._uploaded(client), options.size)
        unit = body.unit if request.unit is None else choose_unit(body, request.unit)
        if request.size is not None:
            choose_unit(body, None)
        size = body.size(unit)
        smallest, thickness = edge_length_range(body, unit)
        return messages.UploadedBody(
            name=body.name,
            format=body.suffix,
            has_unit=body.key != "mesh",
            unit="" if request.size is not None else unit,
            is_doubtful=body.is_doubtful and request.unit is None,
            warning=describe_unusual_size(size),
            size=size.tolist(),
            volume=body.in_mm(unit).volume,
            scale=body.scale(unit),
            edge_length=body.edge_length(unit),
            min_edge_length=smallest,
            max_edge_length=thickness,
            repairs=notable_repairs(body.repairs(unit)),
        )

    def _surface(self, client: Client, _: messages.UploadedSurface) -> Arrays:
        return Arrays(name="uploaded-body", arrays=surface_arrays(self._uploaded(client).surface))

    def _create_from_body(self, client: Client, request: messages.CreateFromBody) -> None:
        body = self._uploaded(client)
        options = NewOptions(
            units=request.unit,
            size=request.size,
            name=request.name.strip(),
            material=request.material,
            edge_length=request.edge_length,
        )
        if body.key != "mesh":
            options = replace(options, units=None)
        with self._lock:
            self._studio.check_idle()
            folder = self._new_folder(str(options.name))
            create_first_device(body, folder, options, is_draft=True)
            self._studio.open_folder(folder)
        self.disconnect(client)


@cache
def gallery() -> messages.Gallery:
    """Return what a new device can be made from."""
    materials = read_rows("materials.csv")
    return messages.Gallery(
        devices=[_gallery_device(start) for start in STARTING_DEVICES],
        formats=FORMAT_NAMES,
        max_upload_mb=MAX_UPLOAD_BYTES // 2**20,
        units=list(UNITS),
        materials=[
            messages.MaterialChoice(name=name, young_modulus=float(row["young_modulus"]))
            for name, row in materials.items()
        ],
        default_material=default_material(DEFAULT_PROCESS),
    )


def _gallery_device(start: StartingDevice) -> messages.GalleryDevice:
    path = package_data("devices") / start.name / DEVICE
    document: dict[str, Any] = tomlkit.parse(path.read_text(encoding="utf-8")).unwrap()
    drawn = len(document.get("sensors", ()))
    return messages.GalleryDevice(
        name=start.name,
        title=start.title,
        about=start.about,
        poses=[str(pose["name"]) for pose in document.get("poses", ())],
        cords=document.get("design", {}).get("sensors", drawn),
        picture=picture_url(start.picture),
    )


def _starting_device(name: str) -> StartingDevice:
    for start in STARTING_DEVICES:
        if start.name == name:
            return start
    raise DefsenseError(
        f"{name!r} is not a device of the gallery",
        code="unknown-start",
        action=f"Choose one of {', '.join(start.name for start in STARTING_DEVICES)}",
    )
