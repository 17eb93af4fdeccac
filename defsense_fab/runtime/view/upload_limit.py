"""Uploads of viser's pages, refused before they are read into memory where they are too large."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

#: Bytes of a file that a page may send.
MOST = 200 * 1024 * 1024
_AT_ONCE = 4  # uploads under way
_PATIENCE = 4  # parts
_PART = 512 * 1024  # bytes of a part, as viser's page cuts them


def limit_uploads(
    server: Any, refused: Callable[[Any, str, str], None], most: int = MOST
) -> UploadLimit:
    """Refuse announcements of files of more than `most` bytes, and files that turn out to be larger
    than they were announced. `refused(client, name, why)` is told on a thread of viser's."""
    return UploadLimit(server, refused, most)


class UploadLimit:
    """In front of viser's own handlers, which keep whatever is sent."""

    def __init__(self, server: Any, refused: Callable[[Any, str, str], None], most: int) -> None:
        from viser import GuiUploadButtonHandle, _messages

        self._button = GuiUploadButtonHandle
        self._server, self._refused, self._most = server, refused, most
        self._gui = server.gui
        self._parts = Counter[int]()  # that came of each connection after they were refused
        sockets = server._websock_server
        for kind, before, after in (
            (_messages.FileTransferStartUpload, self._gui._handle_file_transfer_start, self._begin),
            (_messages.FileTransferPart, self._gui._handle_file_transfer_part, self._part),
        ):
            sockets.unregister_handler(kind, before)
            sockets.register_handler(kind, after)
        # Viser does so itself for browsers alone, not for whatever else has connected.
        sockets.on_client_disconnect(lambda connection: self._gone(connection.client_id))

    @property
    def kept(self) -> int:
        """Bytes of unfinished uploads that are in memory."""
        return sum(s["transferred_bytes"] for s in self._under_way.values())

    @property
    def _under_way(self) -> dict[str, Any]:
        return self._gui._current_file_upload_states  # type: ignore[no-any-return]

    def _begin(self, client: int, message: Any) -> None:
        asked = self._gui._gui_input_handle_from_uuid.get(message.source_component_uuid)
        if not isinstance(asked, self._button):  # of nothing that takes files
            return
        size, parts = message.size_bytes, message.part_count
        if not _whole(size) or not _whole(parts) or parts != -(-size // _PART):
            why = "its announcement cannot be right; load the page again"
        elif size > self._most:
            why = f"it has {size / 2**20:,.0f} MB, and {self._most / 2**20:,.0f} MB is the most"
        elif len(self._under_way) >= _AT_ONCE:
            why = f"{_AT_ONCE} uploads are under way; wait for them"
        else:
            self._gui._handle_file_transfer_start(client, message)
            return
        self._tell(client, str(message.filename), why)

    def _part(self, client: int, message: Any) -> None:
        state = self._under_way.get(message.transfer_uuid)
        if state is None or state["client_id"] != client:
            self._unwanted(client)
            return
        content = message.content
        over = state["transferred_bytes"] + len(content) > state["total_bytes"]
        if not isinstance(content, bytes) or over:
            self._under_way.pop(message.transfer_uuid, None)
            self._tell(client, str(state["filename"]), "it is larger than was announced")
            return
        self._gui._handle_file_transfer_part(client, message)

    def _unwanted(self, client: int) -> None:
        """A part of a file that was refused. A browser sends all of them, and nothing else comes
        through meanwhile: its connection is ended, and it connects again."""
        self._parts[client] += 1
        connection = self._server._websock_server._live_connections.get(client)
        if self._parts[client] == _PATIENCE and connection is not None:
            connection.transport.abort()

    def _gone(self, client: int) -> None:
        self._parts.pop(client, None)
        self._gui._drop_uploads_from_client(client)

    def _tell(self, client: int, name: str, why: str) -> None:
        page = self._server.get_clients().get(client)
        self._server._thread_executor.submit(self._refused, page, name, why)


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
