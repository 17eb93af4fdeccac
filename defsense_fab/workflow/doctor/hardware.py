"""Checks of cameras and read-out boards: whether they give pictures and answer."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

from ...core.machine.local_access import LOCAL_HOSTS
from .checks import Finding, call, make_finding

_CAMERA_USE = "recording a device with cameras"
_BOARD_USE = "reading the cords of a device"
MAX_UNLISTED_CAMERAS = 4  # tried if the system does not list cameras
PICTURE_TIMEOUT_S = 5.0
_CONVERTER_NAMES = ("the microcontroller's converter", "ADS1115")


def check_cameras(seconds: float, pictures: Path | None) -> list[Finding]:
    """Open each camera, and write a picture of it to the folder `pictures` if there is one."""
    names = list_cameras()
    if not names:
        text = "none is plugged in"
        return [make_finding("cameras", "camera", False, text, needed_for=_CAMERA_USE)]
    folder = str(pictures or "")
    answers = {
        name: call(__name__, "take_picture", name, folder, seconds=seconds) for name in names
    }
    if sys.platform != "linux":  # the numbers were guessed
        answers = {name: a for name, a in answers.items() if not a.trouble} or {"0": answers["0"]}
    return [
        make_finding(
            "cameras",
            f"camera {name}",
            not answer.trouble,
            answer.trouble or answer.value,
            needed_for=_CAMERA_USE,
        )
        for name, answer in answers.items()
    ]


def list_cameras() -> list[str]:
    """Return the addresses of cameras.

    On Linux a camera has several devices, of which the first one gives pictures.
    """
    if sys.platform != "linux":
        return [str(number) for number in range(MAX_UNLISTED_CAMERAS)]
    indices = sorted(Path("/sys/class/video4linux").glob("video*/index"))
    return [f"/dev/{i.parent.name}" for i in indices if i.read_text("ascii").strip() == "0"]


def take_picture(address: str, folder: str = "") -> str:
    """Take a picture with a camera.

    Args:
        address: Address of the camera.
        folder: Folder for the picture; empty for none.

    Returns:
        Its size, and where it was written.

    Raises:
        CaptureError: The camera gives no picture (`camera-gives-no-image`).
        StorageError: The picture cannot be written (`file-not-writable`).
    """
    import cv2

    from ...capture.cameras.image_sources import Webcam
    from ...core.errors import CaptureError, StorageError

    camera = Webcam(address)
    camera.start()
    try:
        frame = camera.read(PICTURE_TIMEOUT_S)
    finally:
        camera.close()
    if frame is None:
        raise CaptureError(
            "gives no picture",
            code="camera-gives-no-image",
            where=f"camera {address}",
            camera=address,
        )
    size = "{} x {} pixels".format(*camera.size)
    if not folder:
        return size
    path = Path(folder) / f"camera-{Path(address).stem}.png"
    if not cv2.imwrite(str(path), frame[0]):
        raise StorageError(
            "cannot be written",
            code="file-not-writable",
            where=path,
            action="Check its permissions and the disk",
        )
    return f"{size}, picture in {path}"


def check_boards(seconds: float, further: Sequence[str]) -> list[Finding]:
    """Check the serial ports of the system, and `further` ports that it does not list."""
    answer = call(__name__, "list_ports", seconds=seconds)
    if answer.trouble:
        return [make_finding("ports", "ports", False, answer.trouble, needed_for=_BOARD_USE)]
    ports = [*answer.value, *further]
    if not ports:
        text = "no serial port is plugged in"
        return [make_finding("ports", "read-out board", False, text, needed_for=_BOARD_USE)]
    return [check_port(port, seconds) for port in ports]


def check_port(port: str, seconds: float) -> Finding:
    """Check whether a read-out board answers on a port within a time limit, s."""
    answer = call(__name__, "describe_board", port, seconds=seconds)
    if answer.trouble:
        text = answer.trouble.removeprefix(f"{port}: ")
        return make_finding("ports", port, False, text, needed_for=_BOARD_USE)
    if kind := local_program(port):
        text = f"{answer.value}, but from a program ({kind}), such as a twin: this is no board"
        return make_finding("ports", port, False, text, needed_for=_BOARD_USE)
    return make_finding("ports", port, True, answer.value, needed_for=_BOARD_USE)


def local_program(port: str) -> str:
    """Return what kind of port of a program on this machine, such as a twin, a port is.

    The result is empty where a read-out board may be: on USB, or on another machine.
    """
    if "://" in port:
        try:
            is_local = urlsplit(port).hostname in LOCAL_HOSTS
        except ValueError:
            is_local = False
        return "a socket of this machine" if is_local else ""
    return "a pseudo-terminal" if str(Path(port).resolve()).startswith("/dev/pts/") else ""


def list_ports() -> list[str]:
    """Return the devices of the ports that are plugged in."""
    from ...capture.readout.ports import serial_ports

    return [port.device for port in serial_ports()]


def describe_board(port: str) -> str:
    """Return the firmware and the settings of the read-out board on a port.

    Raises:
        CaptureError: No board answers.
    """
    from functools import partial

    from ...capture.readout.ports import open_port
    from ...capture.readout.reader import Reader

    with Reader(partial(open_port, port), port) as reader:
        info = reader.info
    assert info is not None
    version = ".".join(map(str, info.version))
    return (
        f"firmware {version} (protocol {info.protocol}), {info.channels} channels by"
        f" {_CONVERTER_NAMES[info.converter]}, {info.rate} Hz"
    )
