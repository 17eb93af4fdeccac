"""Scenarios of the program; each takes and returns what JSON can hold."""

import json
from binascii import hexlify, unhexlify

import packets as p
from ads1115 import Ads1115
from board import Board, Clock
from drivers import Console, WlanRadio
from frames import FrameBuilder, compute_crc, decode_cobs, encode_cobs
from internal_adc import calibrated, ratiometric
from links import SerialLink
from session import NetworkLink
from simulated_hardware import (
    SimulatedAds1115,
    SimulatedI2C,
    SimulatedPort,
    SimulatedRadio,
    SimulatedSockets,
    SimulatedStorage,
    SimulatedTime,
)
from wifi import Wifi


def to_hex(data):
    return hexlify(bytes(data)).decode()


class GivenSettings:
    """Settings of an info frame."""

    def __init__(self, channels, averages, rate, led_period):
        self.channels, self.averages = channels, averages
        self.rate, self.led_period = rate, led_period


def build_frames(cases):
    """Return the frames of messages: [["sample", ...], ["info", ...], ["text", ...]]."""
    builder, frames = FrameBuilder(), []
    for kind, *values in cases:
        if kind == "sample":
            length = builder.build_sample(*values)
        elif kind == "info":
            converter, channels, averages, rate, led_period, limit, full_scale = values
            settings = GivenSettings(channels, averages, rate, led_period)
            length = builder.build_info(converter, settings, limit, full_scale)
        else:
            length = builder.build_text(values[0])
        frames.append(to_hex(builder.frame[:length]))
    return frames


def check_codes(cases):
    """Return CRC, COBS code and its inverse of each text of hexadecimal digits."""
    results = []
    for text in cases:
        data = unhexlify(text)
        out = bytearray(len(data) + len(data) // 254 + 2)
        length = encode_cobs(data, len(data), out)
        back = decode_cobs(out, length - 1)
        results.append([compute_crc(data, len(data)), to_hex(out[:length]), to_hex(back)])
    return results


def decode_codes(cases):
    """Return the bytes of COBS codes, None where they are not valid."""
    decoded = [decode_cobs(unhexlify(text), len(text) // 2) for text in cases]
    return [None if data is None else to_hex(data) for data in decoded]


def compute_hmacs(cases):
    """Return the HMAC of [key, data] pairs."""
    return [to_hex(p.Key(unhexlify(key)).compute_hmac(unhexlify(data))) for key, data in cases]


def start_sessions(cases):
    """Return challenges and pongs of [pairing key, host nonce, board id, boot id, nonce]."""
    results = []
    for pairing_key, *parts in cases:
        handshake = p.Handshake(p.Key(unhexlify(pairing_key)), *[unhexlify(part) for part in parts])
        results.append([to_hex(handshake.challenge), handshake_proof(handshake)])
    return results


def handshake_proof(handshake):
    return to_hex(p.encode_packet(p.READ, 1, b"proof", handshake.session_key))


def write_packets(cases):
    """Return packets of [key, kind, sequence, data]."""
    return [
        to_hex(p.encode_packet(ord(kind), sequence, unhexlify(data), p.Key(unhexlify(key))))
        for key, kind, sequence, data in cases
    ]


def read_packets(cases):
    """Return kind, sequence and data of [key, packet], or None; a hello has the key `-`."""
    results = []
    for key, packet in cases:
        packet = unhexlify(packet)
        if key == "-":
            nonce = p.read_hello(packet)
            results.append(None if nonce is None else to_hex(nonce))
            continue
        content = p.decode_packet(packet, p.Key(unhexlify(key)))
        results.append(
            None if content is None else [chr(content[0]), content[1], to_hex(content[2])]
        )
    return results


def accept_sequences(cases):
    results = []
    for sequences in cases:
        window = p.ReplayWindow()
        results.append([window.accept(sequence) for sequence in sequences])
    return results


def make_values(chip):
    """Return codes that differ from conversion to conversion; some are below zero."""
    return lambda source, count: (chip * 7919 + source * 4099 + count * 131) % 26500 - 50


def run_board(case):
    """Run a board for a simulated time.

    Args:
        case: `chips`, a list of addresses, or `internal`, the number of channels; `silent`, the
            times from which chips do not answer; `commands`, with their times, us; `seconds`;
            `stops_at`; with `radio`, states and their times, also `stored`, `packets` and `nonces`.
    """
    time = SimulatedTime()
    clock = Clock(time)
    silent = case.get("silent", {})
    chips = {
        address: SimulatedAds1115(time, make_values(address), silent.get(str(address)))
        for address in case.get("chips", [])
    }
    if "internal" in case:
        converter = make_internal(case["internal"], case.get("kind"))
    else:
        converter = Ads1115(SimulatedI2C(time, chips), clock)
    commands = [[at, text.encode()] for at, text in case["commands"]]
    port = SimulatedPort(time, commands, case.get("stops_at"))
    serial, led, wifi, network = SerialLink(port), [], None, None
    storage = SimulatedStorage(case.get("stored", {}))
    sockets = []
    if "radio" in case:
        nonces = [unhexlify(nonce) for nonce in case.get("nonces", ["00000000"])]
        board_id = unhexlify("a4cf12345678")
        network = NetworkLink(clock, board_id, lambda size: nonces.pop(0))
        radio = SimulatedRadio(time, case["radio"])
        arriving = [[at, unhexlify(packet)] for at, packet in case.get("packets", [])]

        def open_sockets():
            sockets.append(SimulatedSockets(time, network, arriving))
            return sockets[0]

        wifi = Wifi(radio, storage, clock, network, board_id, open_sockets)
    links = [serial] if network is None else [serial, network]
    board = Board(converter, clock, links, lambda on: led.append([time.now, bool(on)]), wifi)
    busy = case.get("busy", [])  # times at which the board has no time for 50 ms
    while time.now < case["seconds"] * 1000000:
        board.loop()
        time.advance(20)
        if busy and busy[0] <= time.now:
            busy.pop(0)
            time.advance(50000)
    result = {
        "sent": to_hex(port.sent),
        "led": led,
        "conversions": {str(address): chip.conversions for address, chip in chips.items()},
    }
    if wifi is not None:
        result["radio"], result["stored"] = radio.calls, storage.values
        sent = sockets[0].sent if sockets else []
        result["packets"] = [[at, to_hex(packet)] for at, packet in sent]
    return result


class GivenInput:
    """An analog input with fixed readings: `read_u16` of a Pico, `read_uv` of an ESP32."""

    def __init__(self, number):
        self._number = number

    def read_u16(self):
        code = 100 * (self._number + 1)  # 12 bits, stretched to 16
        return code << 4 | code >> 8

    def read_uv(self):
        return 200000 * (self._number + 1)


def make_internal(channels, kind):
    inputs = [GivenInput(number) for number in range(channels)]
    return ratiometric(inputs) if kind == "pico" else calibrated(inputs)


def compile_modules(sources):
    """Compile modules, of which some need the hardware; return their number."""
    for source in sources:
        compile(source, "module", "exec")
    return len(sources)


class GivenStream:
    """Both ends of a console; `select.poll` of MicroPython asks it whether it is ready."""

    POLLIN, POLLOUT = 1, 4

    def __init__(self, data):
        self.received, self.written, self.is_open = list(data), bytearray(), True

    def readinto(self, buffer):
        assert len(buffer) <= len(self.received), "reading would wait"
        for i in range(len(buffer)):
            buffer[i] = self.received.pop(0)
        return len(buffer)

    def write(self, data):
        assert self.is_open, "writing would wait"
        self.written += data
        return len(data)

    def poll(self):
        return GivenPoller()


class GivenPoller:
    def register(self, stream, event):
        self._stream, self._event = stream, event

    def ipoll(self, timeout):
        assert timeout == 0
        stream = self._stream
        is_ready = stream.received if self._event == stream.POLLIN else stream.is_open
        return iter([(stream, self._event)] if is_ready else [])


def use_console(text):
    """Return what is read of a text, and how many bytes are written at once and in a second."""
    time = SimulatedTime(step=0)
    stream = GivenStream(text.encode())
    console = Console(stream, stream, stream, Clock(time))
    buffer, chunks = bytearray(8), []
    count = console.readinto(buffer)
    while count:
        chunks.append(bytes(buffer[:count]).decode())
        count = console.readinto(buffer)
    view = memoryview(bytes(2000))
    at_once = console.write(view)
    none_left = console.write(view)
    total = 0
    for _ in range(1000):
        time.advance(1000)
        total += console.write(view)
    stream.is_open = False
    time.advance(100000)
    return [chunks, at_once, none_left, total, len(stream.written), console.write(view)]


class GivenWlan:
    """`network.WLAN` with a given status; Pico W boards refuse the setting `reconnects`."""

    PM_NONE = 7

    def __init__(self, family):
        self._family, self.calls, self.code = family, [], 1000 if family == "esp32" else 0

    def active(self, is_active):
        self.calls.append(["active", is_active])

    def config(self, **setting):
        ((name, value),) = setting.items()
        if name == "reconnects" and self._family != "esp32":
            raise ValueError("unknown config param")
        self.calls.append([name, value])

    def status(self):
        return self.code

    def connect(self, name, password):
        if self.code == "fails":
            raise OSError("internal error")
        self.calls.append(["connect", name, password])

    def disconnect(self):
        self.calls.append(["disconnect"])

    def ifconfig(self):
        return ("192.168.1.20", "255.255.255.0", "192.168.1.1", "192.168.1.1")


def use_radio(case):
    """Return the states of status codes, and the calls of two attempts to connect."""
    family, codes = case
    wlan = GivenWlan(family)
    radio = WlanRadio(wlan)
    radio.connect("lab", "secret")
    states = []
    for code in codes:
        wlan.code = code
        states.append(radio.read_state())
    wlan.code = codes[0]
    radio.connect("lab", None)
    calls = wlan.calls
    wlan.code = "fails"
    radio.connect("lab", None)
    return [states, calls, radio.read_address(), radio.read_state()]


def main(folder):
    """Run the scenario of a file and write its result next to it."""
    with open(folder + "/input.json") as file:
        name, argument = json.load(file)
    result = globals()[name](argument)
    with open(folder + "/output.json", "w") as file:
        json.dump(result, file)
