"""Set up the Wi-Fi of a board through its serial port."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from urllib.parse import quote

from ...core.errors import CaptureError
from ...sensing.packets import OPEN_KEY
from ...sensing.serial_frames import Info, Stream, Text
from ..readout.greeting import ReadoutSettings, Transport, greet_board
from ..readout.paired_boards import is_board_id

ANSWER_TIMEOUT_S = 3.0
POLL_INTERVAL_S = 0.5
_READ_BYTES = 4096


@dataclass(frozen=True)
class WifiState:
    """State of a board's Wi-Fi.

    Attributes:
        board_id: The board's id, 12 hexadecimal digits.
        state: `off`, `joining`, `joined`, `wrong-password` or `not-found`.
        address: The board's IPv4 address; empty without one.
        key: `key`, `open` or `unpaired`.
    """

    board_id: str
    state: str
    address: str
    key: str


class WifiSetup:
    """The commands for Wi-Fi of a board on an open serial port.

    Args:
        port: The port; it stays open.
        name: Name of the port in messages.

    Raises:
        CaptureError: No board with this firmware answers (see `greet_board`), or the board has no
            Wi-Fi (`board-without-wifi`).
    """

    def __init__(self, port: Transport, name: str) -> None:
        self._port, self._name, self._stream = port, name, Stream()
        greet_board(port, self._stream, lambda _: ReadoutSettings(), name, threading.Event())
        self.read_state()

    def read_state(self) -> WifiState:
        """Return the state of the board's Wi-Fi.

        Raises:
            CaptureError: The board does not answer, or not in the form of the protocol.
        """
        words = self._send("network").split(" ")
        if len(words) != 5 or not is_board_id(words[1]):
            raise self._refused("network", " ".join(words))
        _, board_id, state, address, key = words
        return WifiState(board_id, state, "" if address == "-" else address, key)

    def store_network(self, network: str, password: str) -> None:
        """Store a network on the board, which joins it.

        Args:
            network: Name of the network.
            password: Its password; empty for an open network.

        Raises:
            CaptureError: The board refuses them (`board-command-refused`) or does not answer.
        """
        words = [_encode(network), _encode(password)] if password else [_encode(network)]
        self._store("wifi", " ".join(words), "wifi stored")

    def store_key(self, key: bytes) -> None:
        """Store a pairing key (16 bytes) on the board; `OPEN_KEY` lets anyone forge packets.

        Raises:
            CaptureError: The board refuses it (`board-command-refused`) or does not answer.
        """
        if key == OPEN_KEY:
            self._store("key", "none", "key none")
        else:
            self._store("key", key.hex(), "key stored")

    def join(self, timeout: float) -> WifiState:
        """Wait until the board has joined its network.

        Args:
            timeout: Longest time to wait, s.

        Raises:
            CaptureError: The password is wrong (`wifi-password-wrong`), there is no such network
                (`wifi-network-not-found`), or the time is over (`wifi-join-timeout`).
        """
        end = time.monotonic() + timeout
        while True:
            state = self.read_state()
            if state.state == "joined":
                return state
            if state.state in _FAILURES:
                problem, code, action = _FAILURES[state.state]
                raise CaptureError(problem, code=code, where=self._name, action=action)
            if time.monotonic() > end:
                raise CaptureError(
                    f"the board has not joined the network within {timeout:g} s",
                    code="wifi-join-timeout",
                    where=self._name,
                    action="Check the password and move the board closer to the access point",
                )
            time.sleep(POLL_INTERVAL_S)

    def _store(self, word: str, arguments: str, expected: str) -> None:
        answer = self._send(f"{word} {arguments}")
        if answer != expected:
            raise self._refused(word, answer)

    def _send(self, line: str) -> str:
        """Send a command and return the text that answers it."""
        word = line.partition(" ")[0]
        self._port.write(f"{line}\n".encode("ascii"))
        end = time.monotonic() + ANSWER_TIMEOUT_S
        while time.monotonic() < end:
            data = self._port.read(max(1, min(self._port.in_waiting, _READ_BYTES)))
            for message in self._stream.feed(data):
                if isinstance(message, Text) and message.text.partition(" ")[0] == word:
                    return message.text
                if isinstance(message, (Text, Info)) and word == "network":
                    raise self._without_wifi()
        raise CaptureError(
            f"the board does not answer the command {word!r}",
            code="board-command-unanswered",
            where=self._name,
            action="Restart the board and try again",
            command=word,
        )

    def _refused(self, word: str, answer: str) -> CaptureError:
        """Return the error for an answer; arguments are secret and stay out of it."""
        return CaptureError(
            f"the board refuses the command {word!r}: {answer}",
            code="board-command-refused",
            where=self._name,
            action="Check the name and the password, or update the program of the board",
            command=word,
        )

    def _without_wifi(self) -> CaptureError:
        return CaptureError(
            "this board has no Wi-Fi: it knows no such command",
            code="board-without-wifi",
            where=self._name,
            action=(
                "Read it by its serial port, or use an ESP32 or a Raspberry Pi Pico W"
                " (defsense board micropython)"
            ),
        )


#: Problem, code and action of the states in which joining has failed.
_FAILURES = {
    "wrong-password": (
        "the access point refuses the password",
        "wifi-password-wrong",
        "Pair again with the right password; capitals matter",
    ),
    "not-found": (
        "the board finds no network of this name",
        "wifi-network-not-found",
        "Check the name; the network must be on 2.4 GHz and in reach",
    ),
}


def _encode(text: str) -> str:
    """Percent-encode an argument; a network named `off` is no command."""
    return "%6Fff" if text == "off" else quote(text, safe="")
