"""Read the sizes of pictures from the compressed packets of a video.

OpenCV scales pictures of another size to that of the first one, and does not report it. The sizes
are therefore read here for the codecs that can change them inside of a stream: MJPEG, MPEG-1,
MPEG-2, MPEG-4, H.264, H.265, VP8 and VP9. A container states the only size of most others.

References:
    ITU-T T.81 (JPEG), H.264 (7.3.2.1), H.265 (7.3.2.2, 7.3.3) and H.262 (6.2.2.1); ISO/IEC 14496-2
    (6.2.3); RFC 6386 (VP8, 9.1); "VP9 bitstream and decoding process specification" (6.2, annex B).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

Size = tuple[int, int]

_MAX_HEADER_BYTES = 1024  # of a header that states a size
_START, _JPEG_START = b"\0\0\1", b"\xff\xd8"
#: Codes by which containers name codecs; the short ones are those of MPEG transport streams.
_AVC_CODES = {b"h264", b"avc1", b"avc3", b"x264", b"\x1b"}
_HEVC_CODES = {b"hevc", b"hev1", b"hvc1", b"h265", b"x265", b"$"}
_VP8_CODES, _VP9_CODES = {b"vp80", b"vp8", b"vp08"}, {b"vp90", b"vp9", b"vp09"}
_CODES = _AVC_CODES | _HEVC_CODES | _VP8_CODES | _VP9_CODES
#: Profiles of H.264 whose parameters have a chroma format and scaling matrices.
_HIGH_PROFILES = {44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 144, 244}


def read_packet_sizes(path: Path) -> Iterator[tuple[float, Size | None]]:
    """Yield the time, s, and the picture's width and height, px, of each packet of a video.

    The size is None before the first packet that states one. There are no packets for codecs with
    one size, and for files whose packets OpenCV cannot read.
    """
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    try:
        reader = PacketSizes(int(capture.get(cv2.CAP_PROP_FOURCC)))
        period = 1.0 / max(capture.get(cv2.CAP_PROP_FPS), 1.0)
        count = 0
        while capture.grab():
            has_packet, data = capture.retrieve()
            packet = np.asarray(data).tobytes() if has_packet else b""
            if count == 0 and not reader.can_read(packet):
                return
            time = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3 or count * period
            yield time, reader.read(packet)
            count += 1
    finally:
        capture.release()


class PacketSizes:
    """Sizes of the pictures of one stream.

    Args:
        fourcc: Code of the codec, as OpenCV returns it.
    """

    def __init__(self, fourcc: int) -> None:
        self._code = (fourcc % 2**32).to_bytes(4, "little").rstrip(b"\0 ").lower()
        self._size: Size | None = None
        self._sets: dict[int, Size] = {}  # sizes by number of the sequence parameters
        self._pictures: dict[int, int] = {}  # numbers of sequence parameters by picture parameters
        self._references: list[Size | None] = [None] * 8

    def can_read(self, packet: bytes) -> bool:
        """Return whether the sizes of a stream can be read, by its first packet."""
        return self._code in _CODES or packet[:2] == _JPEG_START or packet[:3] == _START

    def read(self, packet: bytes) -> Size | None:
        """Return the width and height of a packet's picture, px.

        Args:
            packet: The next packet of the stream.

        Returns:
            The size; None if it was not stated yet.
        """
        with suppress(EndOfBits, IndexError):  # a damaged packet: the decoder decides
            self._size = self._read(packet) or self._size
        return self._size

    def _read(self, packet: bytes) -> Size | None:
        if self._code in _AVC_CODES:
            return self._read_units(packet, is_hevc=False)
        if self._code in _HEVC_CODES:
            return self._read_units(packet, is_hevc=True)
        if self._code in _VP8_CODES:
            return _read_vp8(packet)
        if self._code in _VP9_CODES:
            sizes = [self._read_vp9(frame) for frame in _split_superframe(packet)]
            return next((size for size in reversed(sizes) if size), None)
        if packet[:2] == _JPEG_START:
            return _read_jpeg(packet)
        return _read_mpeg(packet) if packet[:3] == _START else None

    def _read_units(self, packet: bytes, *, is_hevc: bool) -> Size | None:
        """Return the size that the parameters of the first slice state."""
        for at in _find_starts(packet):
            unit = packet[at : at + _MAX_HEADER_BYTES]
            kind = unit[0] >> 1 & 0x3F if is_hevc else unit[0] & 0x1F
            if is_hevc and (unit[0] & 1 or unit[1] >> 3):  # of another layer, such as a second eye
                continue
            if kind == (33 if is_hevc else 7):
                end = unit.find(_START)
                bits = Bits(_unescape(unit[: end if end > 0 else None]))
                number, size = _read_hevc_sequence(bits) if is_hevc else _read_avc_sequence(bits)
                self._sets[number] = size
            elif kind == (34 if is_hevc else 8):
                bits = Bits(_unescape(unit[:64]), 16 if is_hevc else 8)
                picture = bits.golomb()
                self._pictures[picture] = bits.golomb()
            elif kind < 32 if is_hevc else kind in (1, 5):
                bits = Bits(_unescape(unit[:64]), 16 if is_hevc else 8)
                if is_hevc:
                    bits.skip(2 if 16 <= kind <= 23 else 1)
                else:
                    bits.golomb(), bits.golomb()
                return self._sets.get(self._pictures.get(bits.golomb(), -1))
        return None

    def _read_vp9(self, frame: bytes) -> Size | None:
        """Return the size of a frame that is shown, and keep those of later references."""
        bits = Bits(frame[:_MAX_HEADER_BYTES])
        bits.skip(2)
        profile = bits.take(1) + 2 * bits.take(1)
        bits.skip(profile == 3)
        if bits.take(1):  # shows an earlier frame
            return self._references[bits.take(3)]
        is_inter, is_shown, is_resilient = bits.take(1), bits.take(1), bits.take(1)
        is_intra_only = bits.take(1) if is_inter and not is_shown else 0
        bits.skip(2 if is_inter and not is_resilient else 0)
        refreshed = 0xFF
        if not is_inter or is_intra_only:
            bits.skip(24)
            if not is_inter or profile > 0:
                _skip_vp9_color(bits, profile)
            refreshed = bits.take(8) if is_inter else 0xFF
            size: Size | None = (bits.take(16) + 1, bits.take(16) + 1)
        else:
            refreshed = bits.take(8)
            references = [bits.take(4) >> 1 for _ in range(3)]
            known = next((r for r in references if bits.take(1)), None)
            if known is None:
                size = (bits.take(16) + 1, bits.take(16) + 1)
            else:
                size = self._references[known]
        for k in range(8):
            if refreshed >> k & 1:
                self._references[k] = size
        return size if is_shown else None


class EndOfBits(Exception):
    """A header ends early."""


class Bits:
    """Read a header bit by bit.

    Args:
        data: The header.
        position: First bit.
    """

    def __init__(self, data: bytes, position: int = 0) -> None:
        self._value, self._left = int.from_bytes(data, "big"), 8 * len(data) - position

    def take(self, count: int) -> int:
        """Return the number in the next bits."""
        self.skip(count)
        return self._value >> self._left & (1 << count) - 1

    def skip(self, count: int) -> None:
        """Skip bits."""
        self._left -= count
        if self._left < 0:
            raise EndOfBits

    def golomb(self) -> int:
        """Return the next number in the Exp-Golomb code of H.264."""
        zeros = 0
        while not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)

    def signed_golomb(self) -> int:
        """Return the next signed number in that code."""
        code = self.golomb()
        return (code + 1) // 2 if code % 2 else -(code // 2)


def _find_starts(packet: bytes) -> Iterator[int]:
    """Yield the positions after the start codes of a packet."""
    at = packet.find(_START)
    while 0 <= at < len(packet) - 4:
        yield at + 3
        at = packet.find(_START, at + 3)


def _unescape(unit: bytes) -> bytes:
    """Return a unit of H.264 or H.265 without the bytes that keep it free of start codes."""
    return unit.replace(b"\0\0\3", b"\0\0")


def _read_avc_sequence(bits: Bits) -> tuple[int, Size]:
    """Return the number of sequence parameters of H.264, and the size."""
    bits.skip(8)
    profile = bits.take(8)
    bits.skip(16)
    number, chroma, is_separate = bits.golomb(), 1, 0
    if profile in _HIGH_PROFILES:
        chroma = bits.golomb()
        is_separate = bits.take(1) if chroma == 3 else 0
        bits.golomb(), bits.golomb()
        bits.skip(1)
        if bits.take(1):
            for k in range(12 if chroma == 3 else 8):
                if bits.take(1):
                    _skip_scaling_list(bits, 16 if k < 6 else 64)
    bits.golomb()
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.skip(1)
        bits.golomb(), bits.golomb()
        for _ in range(bits.golomb()):
            bits.golomb()
    bits.golomb()
    bits.skip(1)
    columns, rows, is_frame = bits.golomb() + 1, bits.golomb() + 1, bits.take(1)
    bits.skip(1 if is_frame else 2)
    left, right, top, bottom = (bits.golomb() for _ in range(4)) if bits.take(1) else (0, 0, 0, 0)
    has_chroma = chroma in (1, 2) and not is_separate
    across, down = 2 if has_chroma else 1, (2 if chroma == 1 else 1) * (2 - is_frame)
    width = 16 * columns - across * (left + right)
    return number, (width, 16 * rows * (2 - is_frame) - down * (top + bottom))


def _skip_scaling_list(bits: Bits, count: int) -> None:
    last = following = 8
    for _ in range(count):
        if following:
            following = (last + bits.signed_golomb()) % 256
        last = following or last


def _read_hevc_sequence(bits: Bits) -> tuple[int, Size]:
    """Return the number of sequence parameters of H.265, and the size."""
    bits.skip(16 + 4)
    layers = bits.take(3)
    bits.skip(1 + 88 + 8)
    flags = [(bits.take(1), bits.take(1)) for _ in range(layers)]
    bits.skip(2 * (8 - layers) if layers else 0)
    for has_profile, has_level in flags:
        bits.skip(88 * has_profile + 8 * has_level)
    number, chroma = bits.golomb(), bits.golomb()
    bits.skip(chroma == 3)
    width, height = bits.golomb(), bits.golomb()
    left, right, top, bottom = (bits.golomb() for _ in range(4)) if bits.take(1) else (0, 0, 0, 0)
    across, down = 2 if chroma in (1, 2) else 1, 2 if chroma == 1 else 1
    return number, (width - across * (left + right), height - down * (top + bottom))


def _read_jpeg(packet: bytes) -> Size | None:
    """Return the size of a JPEG image."""
    at = 2
    while at + 9 <= len(packet) and packet[at] == 0xFF:
        marker = packet[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = (int.from_bytes(packet[k : k + 2], "big") for k in (at + 5, at + 7))
            return width, height
        is_filling = marker == 0xFF
        at += 1 if is_filling else 2 + int.from_bytes(packet[at + 2 : at + 4], "big")
    return None


def _read_mpeg(packet: bytes) -> Size | None:
    """Return the size of a packet of MPEG-1, MPEG-2 or MPEG-4 part 2 that states one."""
    is_part_two = b"\0\0\1\xb6" in packet
    for at in _find_starts(packet):
        code, bits = packet[at], Bits(packet[at + 1 : at + 1 + _MAX_HEADER_BYTES])
        if is_part_two and 0x20 <= code < 0x30:
            return _read_mpeg4_layer(bits)
        if not is_part_two and code == 0xB3:
            return bits.take(12), bits.take(12)
        if code == (0xB6 if is_part_two else 0x00):
            return None
    return None


def _read_mpeg4_layer(bits: Bits) -> Size | None:
    """Return the size of a video object layer of MPEG-4 part 2."""
    bits.skip(9)
    bits.skip(7 if bits.take(1) else 0)
    bits.skip(16 if bits.take(4) == 15 else 0)
    if bits.take(1):
        bits.skip(3)
        bits.skip(79 if bits.take(1) else 0)
    if bits.take(2) != 0:  # only rectangles have a size here
        return None
    bits.skip(1)
    resolution = bits.take(16)
    bits.skip(1)
    bits.skip(max((resolution - 1).bit_length(), 1) if bits.take(1) else 0)
    bits.skip(1)
    width = bits.take(13)
    bits.skip(1)
    return width, bits.take(13)


def _read_vp8(packet: bytes) -> Size | None:
    """Return the size of a key frame of VP8."""
    if packet[3:6] != b"\x9d\x01\x2a" or packet[0] & 1:
        return None
    width, height = (int.from_bytes(packet[k : k + 2], "little") & 0x3FFF for k in (6, 8))
    return width, height


def _split_superframe(packet: bytes) -> list[bytes]:
    """Return the frames of a packet of VP9."""
    marker = packet[-1]
    count, width = (marker & 7) + 1, (marker >> 3 & 3) + 1
    length = 2 + count * width
    if marker & 0xE0 != 0xC0 or len(packet) < length or packet[-length] != marker:
        return [packet]
    frames, at = [], 0
    for k in range(count):
        entry = len(packet) - length + 1 + k * width
        size = int.from_bytes(packet[entry : entry + width], "little")
        frames.append(packet[at : at + size])
        at += size
    return [frame for frame in frames if frame]


def _skip_vp9_color(bits: Bits, profile: int) -> None:
    bits.skip(profile >= 2)
    is_rgb = bits.take(3) == 7
    if not is_rgb:
        bits.skip(1)
    if profile in (1, 3):
        bits.skip(1 if is_rgb else 3)
