"""Pair a board with Wi-Fi with this computer, and copy the program for such boards."""

from __future__ import annotations

import secrets
from contextlib import closing
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from ...capture.boards.wifi_setup import WifiSetup
from ...capture.readout.network_url import is_network_url
from ...capture.readout.paired_boards import check_name, find_board, store_board
from ...capture.readout.ports import find_only_port, open_port
from ...core.errors import CaptureError
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors, write_text
from ...sensing.packets import OPEN_KEY, PAIRING_KEY_BYTES
from .options import MicroPythonOptions, PairOptions

PROGRAM = Path(str(files("defsense_fab"))) / "data/firmware/micropython"
_CONFIG = "config.py"
_DEFAULT_CONVERTER = 'CONVERTER = "ads1115"'
_DEFAULT_OPTIONS, _DEFAULT_PROGRAM = PairOptions(), MicroPythonOptions()


@dataclass(frozen=True)
class PairResult:
    """A board that was paired.

    Attributes:
        board_id: The board's id, 12 hexadecimal digits.
        name: Name by which its port is given; empty without a key.
        address: Its IPv4 address.
        port: The port that reads it over Wi-Fi.
    """

    board_id: str
    name: str
    address: str
    port: str


def pair_board(
    network: str,
    password: str,
    options: PairOptions = _DEFAULT_OPTIONS,
    *,
    progress: Progress = silent,
) -> PairResult:
    """Store a Wi-Fi network and a new pairing key on a board, and the key on this computer.

    The network's name and password are stored on the board only.

    Args:
        network: Name of the network.
        password: Its password; empty for an open network.
        options: The board's serial port, and its name.
        progress: Called during the stages `connect`, `join` and `key`.

    Raises:
        CaptureError: No board with Wi-Fi answers on the port, the board does not join the network
            (see `WifiSetup`), or the name is not valid or not free (see `check_name`).
        StorageError: The key cannot be stored.
    """
    url = options.port or find_only_port()
    if is_network_url(url):
        raise CaptureError(
            "a board is paired over USB, not over a network",
            code="port-not-serial",
            where=url,
            action="Connect the board by USB, and use its serial port",
            port=url,
        )
    progress("connect", 0, "waiting for the board")
    with closing(open_port(url)) as port:
        setup = WifiSetup(port, url)
        board_id = setup.read_state().board_id
        name = _choose_name(board_id, options)
        progress("connect", 1, "done")
        progress("join", 0, "waiting for the access point")
        setup.store_network(network, password)
        address = setup.join(options.timeout).address
        progress("join", 1, "done")
        progress("key", 0, "storing the key")
        key = secrets.token_bytes(PAIRING_KEY_BYTES) if options.key else OPEN_KEY
        setup.store_key(key)
        if options.key:
            store_board(board_id, name, key, address)
        progress("key", 1, "done")
    if not options.key:
        return PairResult(board_id, "", address, f"udp://{address}?key=none")
    return PairResult(board_id, name, address, f"udp://{name}")


def write_program(folder: Path, options: MicroPythonOptions = _DEFAULT_PROGRAM) -> list[Path]:
    """Write the program for MicroPython to a folder.

    Args:
        folder: The folder; other files in it stay.
        options: Converters that the board reads.

    Returns:
        The files.

    Raises:
        StorageError: The folder cannot be written.
    """
    written = []
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for source in sorted(PROGRAM.glob("*.py")):
        text = source.read_text("utf-8")
        if source.name == _CONFIG:
            assert _DEFAULT_CONVERTER in text
            text = text.replace(_DEFAULT_CONVERTER, f'CONVERTER = "{options.converter}"')
        written.append(folder / source.name)
        write_text(written[-1], text)
    return written


def _choose_name(board_id: str, options: PairOptions) -> str:
    """Return the name of a board, before anything is changed on it.

    Raises:
        CaptureError: The name is not valid, or another board has it (see `check_name`).
    """
    known = find_board(board_id)
    default = known.name if known is not None else f"board-{board_id[-4:]}"
    name = options.name or default
    check_name(board_id, name)
    return name
