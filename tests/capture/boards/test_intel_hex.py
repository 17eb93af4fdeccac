"""Read Intel HEX files, and refuse damaged ones."""

import pytest

from defsense_fab.capture.boards.images import IMAGES
from defsense_fab.capture.boards.intel_hex import read_intel_hex
from defsense_fab.capture.boards.stk500 import BOOT_SECTION
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises

# Two records of data with a gap, as in the specification's example.
GOOD = [":0400000001020304F2", ":02000800AABB91", ":00000001FF"]


def write(path, lines):
    path.write_bytes("\r\n".join(lines).encode() + b"\r\n")
    return path


def test_gaps_are_erased_memory(tmp_path):
    image = read_intel_hex(write(tmp_path / "a.hex", GOOD))
    assert image == bytes([1, 2, 3, 4, 255, 255, 255, 255, 0xAA, 0xBB])


@pytest.mark.parametrize(
    ("record", "start"), [(":020000020010EC", 0x100), (":020000040001F9", 0x10000)]
)
def test_addresses_are_extended(tmp_path, record, start):
    image = read_intel_hex(write(tmp_path / "a.hex", [record, *GOOD]))
    assert len(image) == start + 10
    assert image[start : start + 4] == bytes([1, 2, 3, 4])


@pytest.mark.parametrize(
    ("line", "lines"),
    [
        (1, [":0400000001020304F3", *GOOD[1:]]),  # checksum
        (1, [":0500000001020304F1", *GOOD[1:]]),  # length
        (2, [GOOD[0], "02000800AABB91", GOOD[2]]),  # no colon
        (2, [GOOD[0], ":02000800AAB", GOOD[2]]),
        (2, [GOOD[0], ":0000000AF6", GOOD[2]]),  # unknown type
        (3, GOOD[:2]),  # truncated between records
        (1, [GOOD[0][:-3]]),  # truncated within a record
        (2, [":02000004FFFFFC", *GOOD]),  # an address of 4 GB
    ],
)
def test_damaged_file_is_refused(tmp_path, line, lines):
    with raises(CaptureError, "hex-invalid", line=line):
        read_intel_hex(write(tmp_path / "a.hex", lines))


def test_binary_or_missing_file_is_refused(tmp_path):
    (tmp_path / "a.hex").write_bytes(bytes(range(256)))
    with raises(CaptureError, "hex-invalid"):
        read_intel_hex(tmp_path / "a.hex")
    with raises(CaptureError, "hex-not-readable"):
        read_intel_hex(tmp_path / "b.hex")


@pytest.mark.parametrize("key", IMAGES)
def test_images_of_the_package_fit(key):
    image = IMAGES[key].read()
    assert 4000 < len(image) < BOOT_SECTION
    assert image[:2] == b"\x0c\x94"  # the reset vector is a jump
