"""Messages of the start page: devices to start from, recent devices, and an uploaded body."""

from __future__ import annotations

from typing import ClassVar

from ...workflow.view import Event, Record, Request, Result


class GalleryDevice(Record, frozen=True, kw_only=True):
    """A device to start from.

    Attributes:
        name: Name by which it is requested.
        title: Its title.
        about: What it senses, in one or two sentences.
        poses: Names of its poses.
        cords: Number of its cords.
        picture: Its picture as a data URL.
    """

    name: str
    title: str
    about: str
    poses: list[str]
    cords: int
    picture: str


class MaterialChoice(Record, frozen=True, kw_only=True):
    """A material of the catalogue.

    Attributes:
        name: Its name.
        young_modulus: Young's modulus at small strain, MPa.
    """

    name: str
    young_modulus: float


class Gallery(Event, frozen=True, kw_only=True):
    """What a new device can be made from.

    Attributes:
        devices: The devices to start from.
        formats: Formats of mesh files, in words.
        max_upload_mb: Largest size of an uploaded file, MB.
        units: Units of the lengths in a mesh file.
        materials: Materials of the catalogue.
        default_material: Material that is selected at first.
    """

    devices: list[GalleryDevice]
    formats: str
    max_upload_mb: int
    units: list[str]
    materials: list[MaterialChoice]
    default_material: str


class RecentDevice(Record, frozen=True, kw_only=True):
    """A device that was opened before.

    Attributes:
        name: Its name.
        folder: Its folder.
        opened_at: When it was opened last, in s since 1970.
        picture: Its picture as a data URL; empty for none.
        is_missing: Whether the folder has no device any more.
        is_open: Whether it is the device that is open.
    """

    name: str
    folder: str
    opened_at: float
    picture: str
    is_missing: bool
    is_open: bool


class RecentDevices(Event, frozen=True, kw_only=True):
    """The devices that were opened before.

    Attributes:
        devices: The devices; the one that was opened last comes first.
        folder: Folder in which a new device is created.
        is_new_folder: Whether the device gets a new folder of its name in `folder`.
    """

    devices: list[RecentDevice]
    folder: str
    is_new_folder: bool


class OpenDevice(Request, frozen=True, kw_only=True):
    """Open a device of the list, or that of the command line, in all browsers."""

    folder: str


class CloseDevice(Request, frozen=True, kw_only=True):
    """Close the device, and show the start page in all browsers."""


class ForgetDevice(Request, frozen=True, kw_only=True):
    """Remove a device from the list; its folder is kept."""

    folder: str


class KeepPicture(Request, frozen=True, kw_only=True):
    """Keep a picture of the open device for the list.

    Attributes:
        picture: A PNG, JPEG or WebP image as a data URL.
    """

    picture: str


class CreateFromGallery(Request, frozen=True, kw_only=True):
    """Create a device from one of the gallery, and open it.

    Attributes:
        start: Name of the device of the gallery.
        name: Name of the new device; empty for the default.
    """

    start: str
    name: str


class UploadedBody(Result, frozen=True, kw_only=True):
    """The body that this browser has uploaded.

    Attributes:
        name: Name of the file without its suffix.
        format: Suffix of its format, such as ".stl".
        has_unit: Whether the format has a unit, so that neither unit nor size can be chosen.
        unit: The unit; empty if the size determines the scale.
        is_doubtful: Whether that unit is a guess.
        warning: Why the size is unusual; empty if it is not.
        size: Extents (3,), mm.
        volume: Volume, mm³.
        scale: Factor from the vertices that were sent to mm.
        edge_length: Default edge length of the mesh, mm.
        min_edge_length: Smallest edge length that can be computed, mm.
        max_edge_length: Thickness of the body, mm.
        repairs: Repairs of the surface, in words.
    """

    name: str
    format: str
    has_unit: bool
    unit: str
    is_doubtful: bool
    warning: str
    size: list[float]
    volume: float
    scale: float
    edge_length: float
    min_edge_length: float
    max_edge_length: float
    repairs: list[str]


class DescribeUpload(Request, frozen=True, kw_only=True):
    """Interpret the uploaded body in a unit, or scale it to a size.

    Attributes:
        unit: Unit of the file; None for the most likely one.
        size: Longest side in mm, which takes the place of the unit.
    """

    result: ClassVar[type | None] = UploadedBody

    unit: str | None = None
    size: float | None = None


class UploadedSurface(Request, frozen=True, kw_only=True):
    """Send the surface of the uploaded body as arrays; `UploadedBody.scale` turns it into mm."""


class CreateFromBody(Request, frozen=True, kw_only=True):
    """Create a device from the uploaded body, and open it.

    Attributes:
        name: Name of the device.
        unit: Unit of the file; None if it has one, or if the size is given.
        size: Longest side in mm; None if the unit is given.
        material: Name of the material.
        edge_length: Edge length of the mesh, mm.
    """

    name: str
    unit: str | None
    size: float | None
    material: str
    edge_length: float
