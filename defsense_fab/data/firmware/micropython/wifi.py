"""Wi-Fi of the board: the stored network and key, joining, and the commands for them."""

import json
import os
from binascii import hexlify, unhexlify

from packets import KEY_SIZE, OPEN_KEY, Key

RETRY_MS = 10000  # from one failed attempt to the next one
JOIN_TIMEOUT_MS = 20000  # of an attempt that neither fails nor succeeds
_POLL_INTERVAL_MS = 100
_MAX_NAME, _MIN_PASSWORD, _MAX_PASSWORD = 32, 8, 63  # bytes (IEEE 802.11)
_NO_ADDRESS = "-"


class JsonFile:
    """Settings in a file of the board's flash memory.

    Args:
        path: Name of the file.
    """

    def __init__(self, path):
        self._path = path

    def load(self):
        """Return the settings, `{}` if there are none or if they are damaged."""
        try:
            with open(self._path) as file:
                values = json.load(file)
        except (OSError, ValueError):
            return {}
        return values if isinstance(values, dict) else {}

    def save(self, values):
        """Replace the settings; a power failure leaves the old or the new ones."""
        temporary = self._path + ".new"
        with open(temporary, "w") as file:
            json.dump(values, file)
        os.rename(temporary, self._path)


class Wifi:
    """Joins the stored network without stopping the sampling, and again after it was lost.

    Args:
        radio: `WlanRadio`, or an object with its methods.
        storage: `JsonFile`, or an object with its methods.
        clock: The board's clock.
        link: The board's `NetworkLink`.
        board_id: Identity of the board (6 bytes).
        open_sockets: Function that returns `Sockets`; called when a network was joined first.

    Attributes:
        state: `off`, `joining`, `joined`, `wrong-password` or `not-found`.
        commands: The first words of the commands.
    """

    commands = ("wifi", "key", "network")

    def __init__(self, radio, storage, clock, link, board_id, open_sockets):
        self._radio, self._storage, self._clock, self._link = radio, storage, clock, link
        self._board_id, self._open_sockets = hexlify(board_id).decode(), open_sockets
        self._values = storage.load()
        self.state = "off"
        self._polled_at = self._tried_at = clock.ticks_ms()
        try:
            self._use_key(unhexlify(self._values["key"]))
        except (KeyError, ValueError, TypeError):  # not paired, or a damaged file
            self._use_key(None)
        if isinstance(self._values.get("name"), str):
            self._join()

    def poll(self):
        """Follow the radio: note that it joined, and try again if it did not."""
        clock = self._clock
        now = clock.ticks_ms()
        if self.state == "off" or clock.ticks_diff(now, self._polled_at) < _POLL_INTERVAL_MS:
            return
        self._polled_at = now
        state = self._radio.read_state()
        if state == "joined":
            self.state = state
            if self._link.sockets is None:
                self._link.sockets = self._open_sockets()
        elif self.state == "joined":  # the access point is gone
            self._join()
        else:
            if state in ("wrong-password", "not-found"):
                self.state = state
            limit = JOIN_TIMEOUT_MS if state == "joining" else RETRY_MS
            if clock.ticks_diff(now, self._tried_at) >= limit:
                self._connect()

    def execute(self, line):
        """Carry out a command line and return the answer."""
        word, *arguments = line.split(" ")
        try:
            if word == "wifi":
                return self._execute_wifi(arguments)
            if word == "key":
                return self._execute_key(arguments)
        except OSError:
            return f"{word} could not be stored in flash memory"
        return self._describe() if not arguments else "network takes no argument"

    def _execute_wifi(self, arguments):
        if arguments == ["off"]:
            self._store({"key": self._values.get("key")})
            self.state = "off"
            self._link.end()
            self._radio.disconnect()
            return "wifi off"
        try:
            name, *passwords = [_decode_percent(text) for text in arguments]
        except ValueError:
            return "wifi takes a name and a password, percent-encoded, or off"
        password = passwords[0] if passwords else None
        if len(passwords) > 1 or not 1 <= len(name.encode()) <= _MAX_NAME:
            return f"wifi takes a name of 1 to {_MAX_NAME} bytes and a password, or off"
        if password is not None and not _MIN_PASSWORD <= len(password.encode()) <= _MAX_PASSWORD:
            return f"wifi takes a password of {_MIN_PASSWORD} to {_MAX_PASSWORD} bytes"
        self._store({"key": self._values.get("key"), "name": name, "password": password})
        self._join()
        return "wifi stored"

    def _execute_key(self, arguments):
        try:
            (text,) = arguments
            key = OPEN_KEY if text == "none" else unhexlify(text)
        except ValueError:
            key = b""
        if len(key) != KEY_SIZE or (key == OPEN_KEY and text != "none"):
            return f"key takes {2 * KEY_SIZE} hexadecimal digits, or none"
        values = dict(self._values)
        values["key"] = hexlify(key).decode()
        self._store(values)
        self._use_key(key)
        return "key none" if key == OPEN_KEY else "key stored"

    def _describe(self):
        address = self._radio.read_address() if self.state == "joined" else _NO_ADDRESS
        return f"network {self._board_id} {self.state} {address} {self._key_state}"

    def _store(self, values):
        self._storage.save(values)
        self._values = values

    def _use_key(self, key):
        """Use a pairing key (16 bytes), or None."""
        if key is None or len(key) != KEY_SIZE:
            self._key_state = "unpaired"
            self._link.set_key(None)
        else:
            self._key_state = "open" if key == OPEN_KEY else "key"
            self._link.set_key(Key(key))

    def _join(self):
        self.state = "joining"
        self._connect()

    def _connect(self):
        self._radio.connect(self._values["name"], self._values.get("password"))
        self._tried_at = self._clock.ticks_ms()


def _decode_percent(text):
    """Return the text of a percent-encoded argument (RFC 3986).

    Raises:
        ValueError: The argument is not valid.
    """
    first, *rest = text.encode().split(b"%")
    out = first
    for part in rest:
        if len(part) < 2:
            raise ValueError("two digits must follow a percent sign")
        out += unhexlify(part[:2]) + part[2:]
    return out.decode()
