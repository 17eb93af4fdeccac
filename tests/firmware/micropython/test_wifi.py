"""Wi-Fi of the program on simulated hardware: joining, stored settings, sessions and packets."""

import pytest

from defsense_fab.sensing.packets import (
    OPEN_KEY,
    Challenge,
    Kind,
    Packet,
    decode_packet,
    encode_challenge,
    encode_hello,
    encode_packet,
    pong_content,
)
from defsense_fab.sensing.serial_frames import Info, Sample, Stream, Text

KEY = bytes(range(16))
BOARD_ID = bytes.fromhex("a4cf12345678")
BOOT_ID = bytes.fromhex("efbeadde")
STORED = {"name": "lab", "password": "secret-password", "key": KEY.hex()}
JOINED = [[0, "joined"]]
FRAMES = [0, "frames\n"]


def answers(done):
    """Return the texts that were sent over USB."""
    messages = Stream().feed(bytes.fromhex(done["sent"]))
    return [m.text for m in messages if isinstance(m, Text)]


def run(run_scenario, **case):
    return run_scenario("run_board", {"chips": [0x48], "seconds": 1, "commands": [], **case})


def test_network_and_key_are_stored_and_joined(run_scenario):
    commands = ["network", "wifi Caf%C3%A9%202 p%20%25ssword", f"key {KEY.hex()}", "network"]
    given = [[100_000 * (n + 1), f"{c}\n"] for n, c in enumerate(commands)]
    given.append([900_000, "network\n"])
    radio = [[0, "joining"], [700_000, "joined"]]
    done = run(run_scenario, radio=radio, commands=[FRAMES, *given], seconds=1.1)
    assert answers(done) == [
        "network a4cf12345678 off - unpaired",
        "wifi stored",
        "key stored",
        "network a4cf12345678 joining - key",
        "network a4cf12345678 joined 192.168.1.20 key",
    ]
    assert done["stored"] == {"name": "Café 2", "password": "p %ssword", "key": KEY.hex()}
    assert [call[1:] for call in done["radio"]] == [["Café 2", "p %ssword"]]
    samples = [m for m in Stream().feed(bytes.fromhex(done["sent"])) if isinstance(m, Sample)]
    assert len(samples) > 50  # at 50 Hz: joining stops nothing
    assert not any(s.late for s in samples[2:])


def test_network_can_be_open_and_forgotten_and_the_key_without_secret(run_scenario):
    commands = [[1e5, "wifi %6Fff\n"], [2e5, "key none\n"], [3e5, "network\n"], [4e5, "wifi off\n"]]
    commands.append([5e5, "network\n"])
    done = run(run_scenario, radio=JOINED, commands=[FRAMES, *commands])
    assert answers(done)[2:] == [
        "network a4cf12345678 joined 192.168.1.20 open",
        "wifi off",
        "network a4cf12345678 off - open",
    ]
    assert [call[1:] for call in done["radio"]] == [["off", None], [None, None]]
    assert done["stored"] == {"key": OPEN_KEY.hex()}


@pytest.mark.parametrize(
    "command",
    [
        "wifi", "wifi a b c", "wifi a short", "wifi %4", "wifi %zz", "wifi %ff", f"wifi {'n' * 33}",
        f"wifi n {'p' * 64}", "key", "key 00", f"key {OPEN_KEY.hex()}", f"key {'g' * 32}",
        "network 1", f"wifi {'n' * 300}",
    ],
)  # fmt: skip
def test_invalid_settings_change_nothing(run_scenario, command):
    done = run(
        run_scenario,
        radio=JOINED,
        stored=STORED,
        commands=[FRAMES, [1e5, f"{command}\n"]],
        seconds=0.3,
    )
    (text,) = answers(done)
    assert text.startswith(command.split(" ")[0] + " ")
    assert done["stored"] == STORED
    assert len(done["radio"]) == 1


def test_longest_name_and_password_fit(run_scenario):
    name, password = "é" * 16, "%" * 63
    command = f"wifi {'%C3%A9' * 16} {'%25' * 63}\n"
    done = run(run_scenario, radio=JOINED, commands=[FRAMES, [1e5, command]])
    assert answers(done) == ["wifi stored"]
    assert (done["stored"]["name"], done["stored"]["password"]) == (name, password)


@pytest.mark.slow
def test_failures_are_reported_and_tried_again(run_scenario):
    """A wrong password, a missing access point, and one that drops and returns."""
    radio = [
        [0, "joining"], [1e6, "wrong-password"], [6e6, "not-found"], [11e6, "joined"],
        [13e6, "failed"], [17e6, "joined"],
    ]  # fmt: skip
    times = [500_000, 2e6, 7e6, 12e6, 15e6, 18e6]
    done = run(
        run_scenario,
        radio=radio,
        stored=STORED,
        commands=[FRAMES, *[[at, "network\n"] for at in times]],
        seconds=18.5,
    )
    states = [text.split()[2] for text in answers(done)]
    assert states == ["joining", "wrong-password", "not-found", "joined", "joining", "joined"]
    connected = [round(at / 1e6) for at, *_ in done["radio"]]
    assert connected == [0, 10, 13]


class Host:
    """Packets of a host whose sessions are known in advance, because the nonces are given."""

    def __init__(self, number=1, key=KEY):
        nonce, board_nonce = bytes([number]) * 8, bytes([100 + number]) * 8
        boot_id = int.from_bytes(BOOT_ID, "little")
        self.challenge = Challenge(nonce, BOARD_ID, boot_id, board_nonce)
        self.hello, self.expected = encode_hello(nonce), encode_challenge(self.challenge, key)
        self.key, self._sent = self.challenge.session_key(key), 0

    def write(self, text):
        self._sent += 1
        return encode_packet(Packet(Kind.WRITE, self._sent, text.encode()), self.key)

    def ping(self):
        self._sent += 1
        return encode_packet(Packet(Kind.PING, self._sent, b"01234567"), self.key)

    def read(self, packets):
        """Return (time, packet) of the packets that belong to this session."""
        decoded = [(at, decode_packet(packet, self.key)) for at, packet in packets]
        return [(at, packet) for at, packet in decoded if packet is not None]


def exchange(run_scenario, packets, *, nonces=(101,), stored=STORED, seconds=2, **case):
    """Return the packets that the board sends while these arrive."""
    given = [BOOT_ID.hex()] + [(bytes([n]) * 8).hex() for n in nonces]
    done = run(
        run_scenario,
        radio=JOINED,
        stored=stored,
        packets=[[at, packet.hex()] for at, packet in packets],
        nonces=given,
        seconds=seconds,
        **case,
    )
    return done, [(at, bytes.fromhex(packet)) for at, packet in done["packets"]]


def messages(packets):
    stream = Stream()
    return [m for _, p in packets if p.kind is Kind.READ for m in stream.feed(p.data)]


def test_session_carries_commands_and_samples(run_scenario):
    host = Host()
    given = [
        (2e5, host.hello), (2.5e5, host.hello), (3e5, host.ping()), (4e5, host.write("fra")),
        (5e5, host.write("mes\nrate 100\n")), (9e5, host.write("rate 9999\n")),
    ]  # fmt: skip
    done, sent = exchange(run_scenario, given, commands=[FRAMES])
    assert [packet for _, packet in sent[:2]] == [host.expected] * 2
    packets = host.read(sent)
    assert [p.sequence for _, p in packets] == list(range(1, len(packets) + 1))
    assert len(packets) == len(sent) - 2
    at, pong = packets[0]
    assert pong_content(pong)[0] == b"01234567"
    assert pong_content(pong)[1] == pytest.approx(at, abs=1000)
    received = messages(packets)
    assert [m.rate for m in received if isinstance(m, Info)] == [50, 100]
    assert [m.text for m in received if isinstance(m, Text)] == ["rate takes 1 to 500"]
    samples = [m for m in received if isinstance(m, Sample)]
    assert len(samples) == pytest.approx(150, abs=5)
    # The same samples go to the serial port.
    usb = Stream().feed(bytes.fromhex(done["sent"]))
    assert set(samples) <= {m for m in usb if isinstance(m, Sample)}


def test_fast_samples_share_packets(run_scenario):
    host = Host()
    given = [(2e5, host.hello), (3e5, host.write("channels 1\nrate 400\nframes\n"))]
    _, sent = exchange(run_scenario, given)
    packets = host.read(sent)
    samples = [m for m in messages(packets) if isinstance(m, Sample)]
    assert len(samples) > 600
    assert len(packets) < len(samples) / 3
    for at, packet in packets[5:]:
        oldest = next(m for m in Stream().feed(packet.data + packet.data) if m)
        assert at - oldest.micros < 16_000


def test_board_is_silent_without_pings_and_continues_with_them(run_scenario):
    host = Host()
    given = [(2e5, host.hello), (3e5, host.write("frames\n")), (5e6, host.ping())]
    _, sent = exchange(run_scenario, given, seconds=6)
    times = [at for at, p in host.read(sent) if p.kind is Kind.READ]
    silent = [at for at in times if 3.4e6 < at < 4.99e6]
    assert silent == []
    assert any(3e6 < at < 3.4e6 for at in times)
    assert any(at > 5.1e6 for at in times)


def test_replayed_reflected_and_forged_packets_do_nothing(run_scenario):
    host, stranger = Host(), Host(key=bytes(range(1, 17)))
    frames, plain = host.write("frames\n"), host.write("plain\n")
    reflected = encode_packet(Packet(Kind.READ, 9, b"plain\n"), host.key)
    forged = stranger.write("plain\n")
    given = [
        (2e5, host.hello), (3e5, plain), (4e5, frames), (5e5, plain), (6e5, plain),
        (7e5, reflected), (8e5, forged), (9e5, host.hello), (10e5, plain),
        (11e5, encode_hello(b"attacker")), (12e5, b""), (13e5, b"\xd5\x01"), (14e5, bytes(513)),
    ]  # fmt: skip
    _, sent = exchange(run_scenario, given, nonces=(101, 102))
    packets = host.read(sent)
    infos = [m for m in messages(packets) if isinstance(m, Info)]
    assert len(infos) == 2  # of `plain` and `frames`, once each
    assert packets[-1][0] > 1.9e6  # samples continue
    challenges = [packet for _, packet in sent if packet[2:3] == b"C"]
    assert challenges[:2] == [host.expected] * 2
    assert len(challenges) == 3


def test_new_session_replaces_the_old_one_with_its_first_packet(run_scenario):
    first, second = Host(1), Host(2)
    given = [
        (2e5, first.hello), (3e5, first.write("frames\n")), (5e5, second.hello),
        (1e6, second.ping()), (1.5e6, first.ping()), (1.6e6, second.write("frames\n")),
    ]  # fmt: skip
    _, sent = exchange(run_scenario, given, nonces=(101, 102))
    old, new = first.read(sent), second.read(sent)
    assert 0.95e6 < old[-1][0] < 1.01e6
    assert [p.kind for at, p in new if at < 1.6e6] == [Kind.PONG]  # no samples before `frames`
    assert len([m for m in messages(new) if isinstance(m, Sample)]) > 15


def test_many_hellos_do_not_displace_a_session_nor_use_memory(run_scenario):
    host = Host()
    hellos = [(4e5 + 1000 * n, encode_hello(n.to_bytes(8, "little"))) for n in range(400)]
    given = [(2e5, host.hello), (3e5, host.write("frames\n")), *hellos]
    _, sent = exchange(run_scenario, given, nonces=(101, *[7] * 400))
    assert host.read(sent)[-1][0] > 1.9e6


@pytest.mark.parametrize("stored", [{"name": "lab"}, {"name": "lab", "key": "xyz"}, {"key": None}])
def test_unpaired_board_answers_nothing(run_scenario, stored):
    host = Host(key=OPEN_KEY)
    given = [(2e5, host.hello), (3e5, host.write("frames\n"))]
    _, sent = exchange(run_scenario, given, stored=stored)
    assert sent == []


def test_board_without_secret_accepts_the_open_key(run_scenario):
    host = Host(key=OPEN_KEY)
    given = [(2e5, host.hello), (3e5, host.write("frames\n"))]
    _, sent = exchange(run_scenario, given, stored={"name": "lab", "key": OPEN_KEY.hex()})
    assert sent[0][1] == host.expected
    assert len(host.read(sent)) > 50


def test_wifi_is_set_up_over_usb_only(run_scenario):
    host = Host()
    lines = "wifi x\nkey none\nnetwork\n" + "wifi " + "x" * 60 + "\n"
    given = [(2e5, host.hello), (3e5, host.write("frames\n" + lines))]
    done, sent = exchange(run_scenario, given)
    texts = [m.text for m in messages(host.read(sent)) if isinstance(m, Text)]
    assert [t.split()[0] for t in texts] == ["wifi", "key", "network", "wifi"]
    assert all("USB" in t for t in texts)
    assert done["stored"] == STORED


def test_key_that_changes_ends_the_session(run_scenario):
    host = Host()
    given = [(2e5, host.hello), (3e5, host.write("frames\n")), (1.5e6, host.ping())]
    _, sent = exchange(run_scenario, given, commands=[[1e6, f"key {'ab' * 16}\n"]])
    assert host.read(sent)[-1][0] < 1.1e6
