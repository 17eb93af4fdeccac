"""Headers and footers of the streams in an XDF file."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from xml.etree.ElementTree import Element, ParseError, fromstring
from xml.sax.saxutils import escape

import numpy as np

#: Tags of chunks that belong to streams.
STREAM_HEADER, SAMPLES, CLOCK_OFFSET, FOOTER = 2, 3, 4, 6

_TEXT = "string"
_VALUE_BYTES = {"double64": 8, "float32": 4, "int64": 8, "int32": 4, "int16": 2, "int8": 1}
_MAX_CHANNELS = 100_000


@dataclass(frozen=True)
class StreamInfo:
    """What identifies a stream and its channels.

    Attributes:
        number: Number of the stream in the file.
        name: Its name.
        kind: Its type.
        uid: Identifier of the sender's run; empty where not given.
        labels: Labels of the k channels; empty where not given.
        units: Units of the channels; empty where not given.
    """

    number: int
    name: str
    kind: str
    uid: str
    labels: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class StreamHeader(StreamInfo):
    """Facts that a stream's header states.

    Attributes:
        value_format: Format of the values, such as `double64`.
        rate: Nominal rate, Hz; 0 for irregular times.
        can_drop: Whether the stream is declared to drop samples.
    """

    value_format: str
    rate: float
    can_drop: bool

    @property
    def row_bytes(self) -> int:
        """Bytes of the values of a sample."""
        return len(self.labels) * _VALUE_BYTES[self.value_format]

    @property
    def has_numbers(self) -> bool:
        """Whether its samples are numbers."""
        return self.value_format != _TEXT

    def to_chunk(self) -> bytes:
        """Return a chunk with those facts that times and numbers depend on."""
        drops = "<synchronization><can_drop_samples>true</can_drop_samples></synchronization>"
        return make_chunk(
            STREAM_HEADER,
            struct.pack("<I", self.number)
            + (
                f"<info><name>{escape(self.name)}</name>"
                f"<channel_count>{len(self.labels)}</channel_count>"
                f"<nominal_srate>{self.rate!r}</nominal_srate>"
                f"<channel_format>{self.value_format}</channel_format>"
                f"<desc>{drops if self.can_drop else ''}</desc></info>"
            ).encode(),
        )


def parse_header(number: int, content: bytes) -> StreamHeader | None:
    """Return the facts of a stream's header; None if it is damaged."""
    root = parse_xml(content)
    count, value_format = xml_text(root, "channel_count"), xml_text(root, "channel_format")
    try:
        rate = float(xml_text(root, "nominal_srate") or 0)
    except ValueError:
        return None
    if root is None or not is_count(count) or not 1 <= int(count) <= _MAX_CHANNELS:
        return None
    if value_format not in (*_VALUE_BYTES, _TEXT) or not (np.isfinite(rate) and rate >= 0):
        return None
    channels = root.findall("desc/channels/channel")[: int(count)]
    missing = [""] * (int(count) - len(channels))
    return StreamHeader(
        number,
        xml_text(root, "name"),
        xml_text(root, "type"),
        xml_text(root, "uid"),
        tuple([xml_text(c, "label") for c in channels] + missing),
        tuple([xml_text(c, "unit") for c in channels] + missing),
        value_format,
        rate,
        xml_text(root, "desc/synchronization/can_drop_samples").lower() == "true",
    )


def parse_xml(content: bytes) -> Element | None:
    """Return the root of a document; None if it is damaged."""
    try:
        return fromstring(content.decode("utf-8", "replace"))  # noqa: S314 - expat limits entities
    except (ParseError, ValueError):
        return None


def is_count(text: str) -> bool:
    """Return whether a text is a whole number of at least 0."""
    return text.isdecimal() and len(text) < 19


def xml_text(element: Element | None, path: str) -> str:
    """Return the text of the first element at a path; empty if there is none."""
    return "" if element is None else (element.findtext(path) or "").strip()


def make_chunk(tag: int, content: bytes) -> bytes:
    """Return a chunk of a file."""
    return b"\x08" + struct.pack("<QH", len(content) + 2, tag) + content
