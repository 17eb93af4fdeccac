"""Checks of cameras and read-out boards: whether they give pictures and answer."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from .checks import Finding, call

CAMERA_USE = "recording a device with cameras"
BOARD_USE = "reading the cords of a device"
MAX_UNLISTED_CAMERAS = 4  # tried if the system does not list cameras
PICTURE_TIMEOUT_S = 5.0
_CONVERTER_NAMES = ("the microcontroller's converter", "ADS1115")


def check_cameras(seconds: float, pictures: Path | None) -> list[Finding]:
    """Open each camera, and write a picture of it to the folder `pictures` if there is one."""
    addresses = list_cameras()
    answers = {
        address: call(__name__, "take_picture", address, str(pictures or ""), seconds=seconds)
        for address in addresses
    }
    if sys.platform != "linux":  # the addresses were guessed
        answers = {address: a for address, a in answers.items() if not a.failure}
    if not answers:
        return [Finding("cameras", "camera", False, "none is plugged in", needed_for=CAMERA_USE)]
    return [
        Finding(
            "cameras",
            f"camera {address}",
            not answer.failure,
            answer.failure or answer.value,
            needed_for=CAMERA_USE,
        )
        for address, answer in answers.items()
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
    if answer.failure:
        return [Finding("ports", "ports", False, answer.failure, needed_for=BOARD_USE)]
    ports = [*answer.value, *further]
    if not ports:
        message = "no serial port is plugged in"
        return [Finding("ports", "read-out board", False, message, needed_for=BOARD_USE)]
    return [check_port(port, seconds) for port in ports]


def check_port(port: str, seconds: float) -> Finding:
    """Check whether a read-out board answers on a port within a time limit, s."""
    answer = call(__name__, "describe_board", port, seconds=seconds)
    message = answer.failure.removeprefix(f"{port}: ") or answer.value
    return Finding("ports", port, not answer.failure, message, needed_for=BOARD_USE)


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
    from ...sensing.serial_frames import FIRMWARE_VERSION, format_version

    with Reader(partial(open_port, port), port) as reader:
        info = reader.info
    assert info is not None
    description = (
        f"firmware {format_version(info.version)} (protocol {info.protocol}), {info.channels}"
        f" channels by {_CONVERTER_NAMES[info.converter]}, {info.rate} Hz"
    )
    if info.is_outdated:
        latest = format_version(FIRMWARE_VERSION)
        description += f"; firmware {latest} is available: defsense board flash --port {port}"
    return description
