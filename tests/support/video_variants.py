"""Variants of videos whose pictures may change their size, of codecs that store it in the stream.

OpenCV encodes all but H.264 and H.265, of which there are encoded pictures.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

Size = tuple[int, int]
RATE = 25
SIZES: tuple[Size, ...] = (
    (64, 48),
    (48, 64),
    (62, 46),
    (64, 50),
    (128, 96),
    (96, 96),
    (320, 240),
    (130, 98),
)
#: Code of the codec, the suffix of its file, and how its parts are joined: by the packets in an
#: IVF container, or as whole files one after the other.
KINDS = (
    ("MPG2", ".m2v", "ivf"),
    ("MPG2", ".ts", "files"),
    ("MPG2", ".m2v", "files"),
    ("FMP4", ".avi", "ivf"),
    ("MJPG", ".mjpeg", "files"),
    ("MJPG", ".avi", "ivf"),
    ("H264", ".ivf", "ivf"),
    ("H264", ".h264", "files"),
    ("H265", ".hevc", "files"),
    ("VP80", ".ivf", "ivf"),
    ("VP90", ".ivf", "ivf"),
)
#: A grey picture of each size in H.264 (x264) and H.265 (x265), with its parameters.
AVC_PICTURES: dict[Size, str] = {
    (64, 48): (
        "000000016764000aacd9447a1000000300100000030320f12259600000000168ebe3cb22c0000000"
        "01658884002bfffed8e7f32c7c7f4d03554b87565ed7c0c84dba3a12c17371"
    ),
    (62, 46): (
        "000000016764000aacd9447eaa1000000300100000030320f12259600000000168ebe3cb22c00000"
        "0001658884002bfffed8e7f32c7c7f4d03554b87565ed7c0c84dba3a12c17371"
    ),
    (48, 64): (
        "000000016764000aacd94c9a1000000300100000030320f12259600000000168ebe3cb22c0000000"
        "01658884002bfffed8e7f32c7c7f4d03554b87552d4adb386c87821fcadc61"
    ),
    (130, 98): (
        "000000016764000bacd9424fe22221000003000100000300320f1429960000000168ebe3cb22c000"
        "000001658884002bfffed8e7f32c7c7f4d03554b87565eee15281a32881dc44fc6e5e1c015ca1694"
        "a0958002b408b25cb9"
    ),
    (66, 50): (
        "0000000167f4000a919b28a4f1f1f0800000030080000019078912cb0000000168ebe3c448440000"
        "0001658884002bfffef5dbf32c7c8673dfff07b653d04dc009b0951281"
    ),
}
HEVC_PICTURES: dict[Size, str] = {
    (64, 48): (
        "0000000140010c01ffff01600000030090000003000003001e959809000000014201010160000003"
        "0090000003000003001ea02083165959ae4cae6808000003000800000300c840000000014401c173"
        "d089000000012801af1d80f00e08ffdce2817c345b78"
    ),
    (62, 46): (
        "0000000140010c01ffff01600000030090000003000003001e959809000000014201010160000003"
        "0090000003000003001ea020831d565959ae4cae6808000003000800000300c840000000014401c1"
        "73d089000000012801af1d80f00e08ffdce2817c345b78"
    ),
    (48, 64): (
        "0000000140010c01ffff01600000030090000003000003001e959809000000014201010160000003"
        "0090000003000003001ea06204165959ae4cae6808000003000800000300c840000000014401c173"
        "d089000000012801af1d80f00e08ffdce27d67f85b78"
    ),
    (130, 98): (
        "0000000140010c01ffff01600000030090000003000003001e959809000000014201010160000003"
        "0090000003000003001ea0112069c9265959a4932b9a020000030002000003003210000000014401"
        "c172b46240000000012801af1d457cf7cf80ffee6fab2ebeb35886a000ae80aa08000019000019ec"
        "48"
    ),
    (66, 50): (
        "0000000140010c01ffff0408000003009e0800000300001e95980900000001420101040800000300"
        "9e0800000300001e900490739e7cb2b35c995cd0100000030010000003019080000000014401c173"
        "18311890000000012801af1d4498ee238fff869dd7bd36d0a88be15869f02157f0"
    ),
}
ENCODED = {"H264": AVC_PICTURES, "H265": HEVC_PICTURES}


@dataclass
class Segment:
    """Pictures of one size."""

    size: Size
    count: int


def segments_of(
    rng: np.random.Generator, has_one_size: bool, sizes_in_use: Sequence[Size] = SIZES
) -> list[Segment]:
    """Return one to four segments."""
    count = int(rng.integers(1 if has_one_size else 2, 5))
    sizes = [sizes_in_use[k] for k in rng.integers(0, len(sizes_in_use), count)]
    if has_one_size:
        sizes = sizes[:1] * len(sizes)
    return [Segment(size, int(rng.integers(2, 12))) for size in sizes]


def changed_at(segments: list[Segment]) -> tuple[int, Size] | None:
    """Return the first frame of another size than the first one, and its size."""
    frame = 0
    for segment in segments:
        if segment.size != segments[0].size:
            return frame, segment.size
        frame += segment.count
    return None


def _pictures(rng: np.random.Generator, segment: Segment) -> list[np.ndarray]:
    noise = rng.integers(0, 255, (6, 8, 3), dtype=np.uint8)
    still = cv2.resize(noise, segment.size)
    return [np.roll(still, 2 * k, axis=1) for k in range(segment.count)]


def write_video(
    folder: Path, kind: tuple[str, str, str], segments: list[Segment], rng: np.random.Generator
) -> Path:
    """Write a video of segments."""
    codec, suffix, layout = kind
    if codec in ENCODED:
        pictures = [bytes.fromhex(ENCODED[codec][s.size]) for s in segments for _ in range(s.count)]
        path = folder / f"film{suffix}"
        path.write_bytes(
            _ivf(codec, segments[0].size, pictures) if layout == "ivf" else b"".join(pictures)
        )
        return path
    files = [folder / f"part{k}{suffix}" for k in range(len(segments))]
    for file, segment in zip(files, segments, strict=True):
        writer = cv2.VideoWriter(
            str(file), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), RATE, segment.size
        )
        for picture in _pictures(rng, segment):
            writer.write(picture)
        writer.release()
    if layout == "files":
        path = folder / f"film{suffix}"
        path.write_bytes(b"".join(file.read_bytes() for file in files))
        return path
    path = folder / "film.ivf"
    path.write_bytes(_ivf(codec, segments[0].size, [p for f in files for p in _packets(f)]))
    return path


def _packets(path: Path) -> list[bytes]:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    packets = []
    while capture.grab():
        packets.append(capture.retrieve()[1].tobytes())
    capture.release()
    return packets


def _ivf(codec: str, size: Size, packets: list[bytes]) -> bytes:
    head = struct.pack(
        "<4sHH4sHHIIII", b"DKIF", 0, 32, codec.encode(), *size, RATE, 1, len(packets), 0
    )
    return head + b"".join(
        struct.pack("<IQ", len(packet), k) + packet for k, packet in enumerate(packets)
    )
