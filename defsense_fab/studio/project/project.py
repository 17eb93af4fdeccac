"""The folder of a device that users and other programs edit at the same time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ...core.device.device import Device
from ...core.device.device_file import DEVICE, parse_device
from ...core.errors import DeviceError
from ...core.storage.files import read_regular, write_text
from ..edits.edit import Edit
from .history import History

#: Largest number of characters of a device's file that edits may write.
MAX_CHARACTERS = 400_000


class Project:
    """A device's file with undo; every change is checked and written at once.

    A change by another program becomes a step of its own before the next edit. All methods may be
    called from any thread.

    Args:
        folder: The device's folder.

    Attributes:
        device: The device as of the last valid file.
        watchers: Called after each change with the name of the edit.

    Raises:
        DeviceError: The folder has no valid device.
        StorageError: The folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self._path = folder, folder / DEVICE
        self.watchers: list[Callable[[str], None]] = []
        self._lock = threading.RLock()
        text = self._read()
        self.device = self._parse(text)
        self._history = History(folder, text)

    @property
    def text(self) -> str:
        """Text of the last valid file."""
        return self._history.text

    @property
    def undo_name(self) -> str | None:
        """Name of the edit that `undo` reverts, or None."""
        return self._history.undo_name

    @property
    def redo_name(self) -> str | None:
        """Name of the edit that `redo` repeats, or None."""
        return self._history.redo_name

    @property
    def step_count(self) -> int:
        """Number of steps in the history."""
        return len(self._history.steps)

    def apply(self, edit: Edit) -> None:
        """Apply an edit to the file.

        Raises:
            DeviceError: The edited part no longer exists, or the result is not a valid device;
                then nothing is changed.
            StorageError: The file or the history cannot be written.
        """
        with self._lock:
            self.refresh()
            document = tomlkit.parse(self.text)
            try:
                document = edit.change(document) or document
                text = tomlkit.dumps(document)
            except TOMLKitError as error:
                raise DeviceError(
                    f"{edit.name}: {error}", code="edit-not-possible", where=DEVICE
                ) from None
            if text == self.text:
                return
            if len(text) > max(MAX_CHARACTERS, len(self.text)):
                raise DeviceError(
                    f"{edit.name}: the file would have more than {MAX_CHARACTERS} characters",
                    code="device-too-large",
                    where=DEVICE,
                    action="Delete something first",
                )
            device = self._parse(text)
            write_text(self._path, text)
            self._add_step(device, edit.name, text)

    def undo(self) -> str | None:
        """Undo the last edit and return its name; None if there is none.

        Raises:
            StorageError: The file or the history cannot be written.
        """
        return self._move(-1, "undo")

    def redo(self) -> str | None:
        """Redo an edit that was undone and return its name; None if there is none.

        Raises:
            StorageError: The file or the history cannot be written.
        """
        return self._move(1, "redo")

    def refresh(self) -> bool:
        """Read a change by another program and return whether there was one.

        Raises:
            DeviceError: The file is not a valid device. The last valid device stays; `restore`
                writes it back.
        """
        with self._lock:
            text = self._read()
            if text == self.text:
                return False
            self._add_step(self._parse(text), "edit outside of the studio", text)
            return True

    def restore(self) -> None:
        """Overwrite the file with the last valid device.

        Raises:
            StorageError: The file cannot be written.
        """
        with self._lock:
            write_text(self._path, self.text)

    def _move(self, by: int, verb: str) -> str | None:
        """Undo (`by=-1`) or redo (`by=1`) a step, and return its name."""
        with self._lock:
            self.refresh()
            name = self.undo_name if by < 0 else self.redo_name
            if name is None:
                return None
            step = self._history.steps[self._history.at + by]
            device = self._parse(step.text)
            write_text(self._path, step.text)
            try:
                self._history.move(by)
            finally:
                self._set_device(device, f"{verb}: {name}")
            return name

    def _add_step(self, device: Device, name: str, text: str) -> None:
        """Add a step; the device changes even if the history cannot be written."""
        try:
            self._history.add(name, text)
        finally:
            self._set_device(device, name)

    def _set_device(self, device: Device, name: str) -> None:
        self.device = device
        for watcher in self.watchers:
            watcher(name)

    def _read(self) -> str:
        try:
            return read_regular(self._path).decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            if not self.folder.is_dir():
                raise DeviceError(
                    "the folder of the device is missing",
                    code="folder-missing",
                    where=self.folder,
                    action="Put it back, and the studio continues; nothing is lost",
                ) from None
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise DeviceError(
                f"cannot be read: {reason}", code="file-unreadable", where=self._path
            ) from None

    def _parse(self, text: str) -> Device:
        return parse_device(text, self.folder, complete=False)
