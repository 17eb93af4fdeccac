"""Frames and packets of the program equal the golden ones, byte for byte."""

import struct

from cobs import cobs

from tests.firmware.build import FIRMWARE


def read_lines(name):
    lines = (FIRMWARE / name).read_text().splitlines()
    return [line.split() for line in lines if line and not line.startswith("#")]


def parse_payload(payload):
    """Return the arguments of `build_frames` for a payload of golden.txt."""
    if payload[:1] == b"S":
        counter, micros, flags, averages, channels = struct.unpack_from("<IIBBB", payload, 1)
        sums = [int.from_bytes(payload[i : i + 3], "little") for i in range(12, len(payload), 3)]
        return ["sample", counter, micros, flags, averages, channels, sums]
    if payload[:1] == b"I":
        _, _, _, converter, *rest = struct.unpack("<BBBBBBHHBI", payload[1:])
        return ["info", converter, *rest]
    return ["text", payload[1:].decode()]


def test_golden_frames(run_scenario):
    golden = read_lines("golden.txt")
    # The program has one version; the largest info is of another one.
    golden = [line for line in golden if line[0] != "info_largest"]
    frames = run_scenario("build_frames", [parse_payload(bytes.fromhex(p)) for _, p, _ in golden])
    assert frames == [frame for _, _, frame in golden]
    assert len(frames) == 16


def test_codes_equal_those_of_the_library_and_the_paper(run_scenario):
    """COBS: examples of Cheshire and Baker, and lengths around the block of 254 bytes."""
    examples = {"4500002c4c79000040064f37": "02450104 2c4c79 01 05 40064f37".replace(" ", "")}
    examples["00"], examples["0000"], examples["11220033"] = "0101", "010101", "0311220233"
    block = bytes(range(1, 255))
    data = [bytes.fromhex(text) for text in examples]
    data += [block[:253], block, block + b"\1", block + b"\0", b"\0" + block, block + block]
    data += [b"123456789", bytes(300)]
    results = run_scenario("check_codes", [d.hex() for d in data])
    assert results[data.index(b"123456789")][0] == 0x29B1
    for d, (_, code, back) in zip(data, results, strict=True):
        assert code == (cobs.encode(d) + b"\0").hex()
        assert back == d.hex()
    for (_, code, _), expected in zip(results, examples.values(), strict=False):
        assert code == expected + "00"
    assert run_scenario("decode_codes", ["00", "05 11".replace(" ", ""), "02", "030011"]) == [
        None, None, None, None,
    ]  # fmt: skip


def test_hmac_equals_rfc_4231(run_scenario):
    """The test cases 1, 2, 3 and 4, whose keys are at most 64 bytes long."""
    cases = [
        ["0b" * 20, b"Hi There".hex()],
        [b"Jefe".hex(), b"what do ya want for nothing?".hex()],
        ["aa" * 20, "dd" * 50],
        [bytes(range(1, 26)).hex(), "cd" * 50],
    ]
    assert run_scenario("compute_hmacs", cases) == [
        "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7",
        "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843",
        "773ea91e36800e46854db8ebd09181a72959098b3ef8c122d9635514ced565fe",
        "82558a389a443c0ea4cc819899f2083a85f0faa3e578f8077a2e3ff46729665b",
    ]


def test_packets_of_sessions(run_scenario):
    lines = read_lines("packets.txt")
    sessions = {line[1]: line[2:] for line in lines if line[0] == "session"}
    valid = {line[1]: line[2:] for line in lines if line[0] == "valid"}
    started = run_scenario("start_sessions", [values[:5] for values in sessions.values()])
    challenges = dict(zip(sessions, (challenge for challenge, _ in started), strict=True))
    assert challenges["paired"] == valid["challenge"][1]
    assert challenges["open"] == valid["challenge_open"][1]
    proof = b"proof".hex()
    expected = run_scenario(
        "write_packets", [[values[5], "R", 1, proof] for values in sessions.values()]
    )
    assert [found for _, found in started] == expected  # their session keys are those of the file


def test_valid_packets_are_written_and_read_and_invalid_ones_refused(run_scenario):
    lines = read_lines("packets.txt")
    valid = {line[1]: line[2:] for line in lines if line[0] == "valid"}
    packets = {n: v for n, v in valid.items() if not n.startswith(("hello", "challenge"))}
    read = run_scenario("read_packets", list(packets.values()))
    assert None not in read
    cases = [[key, *content] for (key, _), content in zip(packets.values(), read, strict=True)]
    assert run_scenario("write_packets", cases) == [packet for _, packet in packets.values()]
    (hello,) = run_scenario("read_packets", [valid["hello"]])
    assert hello == valid["hello"][1][6:22]
    refused = [line[2:] for line in lines if line[0] == "invalid"]
    assert run_scenario("read_packets", refused) == [None] * len(refused)
    assert len(packets) >= 7
    assert len(refused) >= 15


def test_packets_over_tcp_and_sequences(run_scenario):
    lines = read_lines("packets.txt")
    streams = [line[2:] for line in lines if line[0] == "stream"]
    codes = run_scenario("check_codes", [packet for packet, _ in streams])
    assert [code for _, code, _ in codes] == [code for _, code in streams]
    windows = [line[2:] for line in lines if line[0] == "window"]
    accepted = run_scenario(
        "accept_sequences", [[int(n) for n in numbers.split(",")] for numbers, _ in windows]
    )
    assert ["".join(str(int(a)) for a in row) for row in accepted] == [w for _, w in windows]
