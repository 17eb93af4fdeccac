"""The boards with Wi-Fi that were paired with this computer, with their keys.

They are stored in `boards.toml` in the user's folder for settings, which only the user may read.
Each table is named by the id of a board:

    [a4cf12345678]
    name = "elbow"
    key = "000102030405060708090a0b0c0d0e0f"
    address = "192.168.1.20"
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tomlkit

from ...core.errors import CaptureError
from ...core.schema.declare import Problem, Table, key
from ...core.schema.document import Document, load_document
from ...core.storage.files import config_folder, file_lock, storage_errors, write_text
from ...sensing.packets import BOARD_ID_BYTES, OPEN_KEY, PAIRING_KEY_BYTES

FILE = "boards.toml"
_HEAD = "Paired boards and their keys. Anyone who has a key can pretend to be the board."
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}")
_BOARD_ID = re.compile(f"[0-9a-f]{{{2 * BOARD_ID_BYTES}}}")
_KEY = re.compile(f"[0-9a-f]{{{2 * PAIRING_KEY_BYTES}}}")
_NAME_RULE = "Use 1 to 63 letters, digits, hyphens and underscores"


@dataclass(frozen=True)
class PairedBoard:
    """A board with Wi-Fi that was paired with this computer.

    Attributes:
        board_id: The board's id, 12 hexadecimal digits.
        name: Name that the user gave.
        key: The pairing key (16 bytes).
        address: The board's last known address, `HOST` or `HOST:PORT`; empty if unknown.
    """

    board_id: str
    name: str
    key: bytes = field(repr=False)
    address: str


class _Entry(Table, frozen=True):
    name: Annotated[str, key("Name of the board.")]
    key: Annotated[str, key("Pairing key, 32 hexadecimal digits.")]
    address: Annotated[str, key("Last known address.")] = ""

    def check(self) -> Iterator[Problem]:
        if not _NAME.fullmatch(self.name):
            text = f"{self.name!r} is not a valid name"
            yield Problem(("name",), text, "board-name-invalid", _NAME_RULE)
        if not _KEY.fullmatch(self.key) or bytes.fromhex(self.key) == OPEN_KEY:
            yield _key_problem("key")


def _key_problem(*path: str) -> Problem:
    """Return the problem of a key, whose value must not appear in messages."""
    action = "Pair the board again (defsense board pair)"
    return Problem(path, "is not a valid pairing key", "pairing-key-invalid", action)


def paired_boards_file() -> Path:
    """Return the file in which paired boards are stored."""
    return config_folder() / FILE


def is_board_id(text: str) -> bool:
    """Return whether a text is the id of a board."""
    return _BOARD_ID.fullmatch(text) is not None


def read_boards() -> list[PairedBoard]:
    """Return the paired boards in the order of their file; empty before the first was paired.

    Raises:
        CaptureError: The file cannot be read, or an entry is not valid.
    """
    if not paired_boards_file().exists():
        return []
    document = load_document(paired_boards_file(), CaptureError)
    return [_read_entry(document, board_id) for board_id in document.values]


def find_board(text: str) -> PairedBoard | None:
    """Return the paired board with this id or name; None if there is none.

    Raises:
        CaptureError: The file of the boards cannot be read, or an entry is not valid.
    """
    known = read_boards()
    by_id = (board for board in known if board.board_id == text.lower())
    return next(by_id, next((board for board in known if board.name == text), None))


def check_name(board_id: str, name: str) -> None:
    """Check whether a board can have a name.

    Raises:
        CaptureError: The name is not valid (`board-name-invalid`), or another board has it
            (`board-name-taken`).
    """
    if not _NAME.fullmatch(name):
        raise CaptureError(
            f"{name!r} is not a valid name",
            code="board-name-invalid",
            where="name",
            action=_NAME_RULE,
        )
    owner = next((board for board in read_boards() if board.name == name), None)
    if owner is not None and owner.board_id != board_id:
        raise CaptureError(
            f"the board {owner.board_id} has this name",
            code="board-name-taken",
            where=name,
            action="Choose another name",
            board=owner.board_id,
        )


def store_board(board_id: str, name: str, key: bytes, address: str) -> None:
    """Store a paired board, in place of an entry with the same id.

    Args:
        board_id: The board's id, 12 hexadecimal digits.
        name: Name for the board.
        key: The pairing key (16 bytes).
        address: The board's address, `HOST` or `HOST:PORT`; empty if unknown.

    Raises:
        CaptureError: The id, the name or the key is not valid, another board has the name, or the
            file of the boards is not valid.
        StorageError: The file cannot be written, or another program writes it.
    """
    path = paired_boards_file()
    board = PairedBoard(board_id, name, key, address)
    _read_entry(Document({board_id: _entry(board)}, path, error=CaptureError), board_id)
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with file_lock(
        path.with_suffix(".lock"), "is being changed by another program", action="Try again"
    ):
        boards = {b.board_id: b for b in read_boards()}
        check_name(board_id, name)
        _write({**boards, board_id: board})


def _read_entry(document: Document, board_id: str) -> PairedBoard:
    """Return the board of a table of the file."""
    if not is_board_id(board_id):
        text = f"{board_id!r} is not the id of a board"
        action = "Delete the table, or write the 12 hexadecimal digits that the board reports"
        document.refuse([Problem((board_id,), text, "board-id-invalid", action)])
    values = document.values[board_id]
    if isinstance(values, dict) and not isinstance(values.get("key", ""), str):
        document.refuse([_key_problem(board_id, "key")])
    entry, problems = document.try_reading(_Entry, values, (board_id,))
    if entry is None:
        document.refuse(problems)
    return PairedBoard(board_id, entry.name, bytes.fromhex(entry.key), entry.address)


def _entry(board: PairedBoard) -> dict[str, str]:
    """Return the table of a board."""
    entry = {"name": board.name, "key": board.key.hex(), "address": board.address}
    return {name: value for name, value in entry.items() if value}


def _write(boards: dict[str, PairedBoard]) -> None:
    document = tomlkit.document()
    document.add(tomlkit.comment(_HEAD))
    for board in boards.values():
        document[board.board_id] = _entry(board)
    write_text(paired_boards_file(), tomlkit.dumps(document), is_private=True)
