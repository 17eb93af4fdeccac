"""A device's folder that is being designed, by one person or two, and by other programs."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ...core.device.device import Device
from ...core.device.device_file import DEVICE, parse_device
from ...core.errors import DeviceError
from ...core.storage.files import write_text
from ..edits.edit import Edit
from .history import History


class Project:
    """The device's file in a `folder`: every change is checked and written at once, and can be
    undone. A change from outside is taken up as a step of its own, before the next one. From any
    thread; `watchers` are called after each change, with the name of what was done."""

    def __init__(self, folder: Path) -> None:
        """Raises DeviceError where there is no device that can be read, StorageError where nothing
        can be written."""
        self.folder, self._path = folder, folder / DEVICE
        self.watchers: list[Callable[[str], None]] = []
        self._lock = threading.RLock()
        text = self._read()
        self.device = self._parsed(text)
        self._history = History(folder, text)

    @property
    def text(self) -> str:
        return self._history.text

    @property
    def undoes(self) -> str | None:
        """What would be undone, None where there is nothing."""
        return self._history.undoes

    @property
    def redoes(self) -> str | None:
        """What would be done again, None where there is nothing."""
        return self._history.redoes

    def do(self, edit: Edit) -> None:
        """Raises DeviceError where what it changes is gone, or the device would be none that can
        be; then nothing is changed."""
        with self._lock:
            self.refresh()
            document = tomlkit.parse(self.text)
            try:
                document = edit.change(document) or document
                text = tomlkit.dumps(document)
            except TOMLKitError as error:
                raise DeviceError(f"device.toml: {edit.name}: {error}") from None
            if text == self.text:
                return
            device = self._parsed(text)
            write_text(self._path, text)
            self._added(device, edit.name, text)

    def undo(self) -> str | None:
        """What was undone; None where there was nothing. Raises StorageError."""
        with self._lock:
            self.refresh()
            told = self.undoes
            if told is not None:
                self._go(-1, f"undo: {told}")
            return told

    def redo(self) -> str | None:
        """What was done again; None where there was nothing. Raises StorageError."""
        with self._lock:
            self.refresh()
            told = self.redoes
            if told is not None:
                self._go(1, f"redo: {told}")
            return told

    def refresh(self) -> bool:
        """Take up what another program has written; whether there was anything. Raises DeviceError
        where that is no device: the last one that was stays, and can be written back (`restore`).
        """
        with self._lock:
            text = self._read()
            if text == self.text:
                return False
            self._added(self._parsed(text), "edit outside of the studio", text)
            return True

    def restore(self) -> None:
        """Write the last device that could be read over what is there now. Raises StorageError."""
        with self._lock:
            write_text(self._path, self.text)

    def _go(self, by: int, told: str) -> None:
        step = self._history.steps[self._history.at + by]
        device = self._parsed(step.text)
        write_text(self._path, step.text)
        try:
            self._history.move(by)
        finally:
            self._now(device, told)

    def _added(self, device: Device, name: str, text: str) -> None:
        """The file has it already: it counts, also where its history cannot be written."""
        try:
            self._history.add(name, text)
        finally:
            self._now(device, name)

    def _now(self, device: Device, told: str) -> None:
        self.device = device
        for watcher in self.watchers:
            watcher(told)

    def _read(self) -> str:
        try:
            with self._path.open(encoding="utf-8", newline="") as file:
                return file.read()
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else str(error)
            raise DeviceError(f"{self._path}: cannot be read: {why}") from None

    def _parsed(self, text: str) -> Device:
        return parse_device(text, self.folder, complete=False)
