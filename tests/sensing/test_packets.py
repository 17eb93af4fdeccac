"""Test packets with the golden ones that every implementation shares, and with damaged ones."""

import random

import pytest
from cobs import cobs

from defsense_fab.sensing.packets import (
    MAX_DATA_BYTES,
    Challenge,
    Kind,
    Packet,
    ReplayWindow,
    decode_hello,
    decode_packet,
    encode_challenge,
    encode_hello,
    encode_packet,
    has_valid_tag,
    pong_content,
    read_challenge,
)
from tests.support.places import FIRMWARE

LINES = [
    line.split()
    for line in (FIRMWARE / "packets.txt").read_text("utf-8").splitlines()
    if line and not line.startswith("#")
]


def golden(kind):
    """Return the fields of the golden lines of a kind, as parameters with their names."""
    return [pytest.param(*fields, id=fields[0]) for k, *fields in LINES if k == kind]


def accepted(key, packet):
    """Return the decoded packet, and the bytes that are written for it; None if refused."""
    data, secret = bytes.fromhex(packet), bytes.fromhex("" if key == "-" else key)
    if key == "-":
        nonce = decode_hello(data)
        return None if nonce is None else (nonce, encode_hello(nonce))
    if len(secret) == 16:
        challenge = read_challenge(data)
        if challenge is None or not has_valid_tag(data, secret):
            return None
        return challenge, encode_challenge(challenge, secret)
    message = decode_packet(data, secret)
    return None if message is None else (message, encode_packet(message, secret))


@pytest.mark.parametrize(("name", "key", "packet"), golden("valid"))
def test_valid_packets_are_read_and_written(name, key, packet):
    assert accepted(key, packet)[1] == bytes.fromhex(packet)


@pytest.mark.parametrize(("name", "key", "packet"), golden("invalid"))
def test_invalid_packets_are_refused(name, key, packet):
    assert accepted(key, packet) is None


@pytest.mark.parametrize(
    ("name", "key", "host_nonce", "board", "boot", "board_nonce", "session"), golden("session")
)
def test_session_keys(name, key, host_nonce, board, boot, board_nonce, session):
    challenge = Challenge(
        bytes.fromhex(host_nonce),
        bytes.fromhex(board),
        int.from_bytes(bytes.fromhex(boot), "little"),
        bytes.fromhex(board_nonce),
    )
    assert challenge.session_key(bytes.fromhex(key)).hex() == session


@pytest.mark.parametrize(("name", "packet", "data"), golden("stream"))
def test_packets_over_a_stream(name, packet, data):
    assert (cobs.encode(bytes.fromhex(packet)) + b"\0").hex() == data


@pytest.mark.parametrize(("name", "sequences", "verdicts"), golden("window"))
def test_golden_windows(name, sequences, verdicts):
    window = ReplayWindow()
    assert [window.accept(int(s)) for s in sequences.split(",")] == [v == "1" for v in verdicts]


def test_values_of_golden_packets():
    packets = {line[1]: line[2:] for line in LINES if line[0] == "valid"}
    pong, _ = accepted(*packets["pong"])
    assert (pong.kind, pong.sequence) == (Kind.PONG, 4)
    assert pong_content(pong) == (bytes(range(1, 9)), 345678)
    assert accepted(*packets["write_frames"])[0] == Packet(Kind.WRITE, 1, b"\nframes\n")
    assert accepted(*packets["challenge"])[0].boot_id == 0xDEADBEEF


def test_packets_that_are_too_long_are_not_written():
    with pytest.raises(ValueError, match="bytes"):
        encode_packet(Packet(Kind.WRITE, 1, bytes(MAX_DATA_BYTES + 1)), bytes(32))


def test_every_changed_bit_is_detected():
    key = random.Random(0).randbytes(32)
    data = encode_packet(Packet(Kind.READ, 7, b"frames of a board"), key)
    assert decode_packet(data, key) is not None
    for bit in range(8 * len(data)):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        assert decode_packet(bytes(changed), key) is None


def test_window_accepts_as_a_set_of_all_sequences_does():
    """The comparison remembers every sequence instead of the newest 64 bits."""
    rng = random.Random(1)
    window, seen, highest = ReplayWindow(), set(), 0
    for step in range(20_000):
        sequence = max(1, step // 2 + rng.choice((0, 1, -3, -62, -63, -64, -65, 70, -200)))
        is_new = sequence not in seen and sequence > highest - 64
        assert window.accept(sequence) is is_new
        if is_new:
            seen.add(sequence)
            highest = max(highest, sequence)
    assert window.highest == highest
