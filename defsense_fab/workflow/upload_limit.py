"""Refuse uploads to viser pages that are too large, before they are read into memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from ..runtime.frames.live_frame import Note

#: Largest size of an uploaded file.
MAX_UPLOAD_BYTES = 200 * 1024 * 1024
_MAX_UPLOADS = 4  # in progress at the same time
_MAX_REFUSED_PARTS = 4  # of a refused file, after which its connection is closed
_PART_BYTES = 512 * 1024  # as viser's page splits files


class UploadLimit:
    """Refuse files that are too large, or larger than announced.

    Its message handlers run before those of viser, which keep everything that is sent.

    Args:
        server: The viser server.
        on_refused: Called with the client, the name of the file and the reason, on a thread of
            viser.
        max_bytes: Largest size of a file.
    """

    def __init__(
        self,
        server: Any,
        on_refused: Callable[[Any, str, Note], None],
        max_bytes: int = MAX_UPLOAD_BYTES,
    ) -> None:
        from viser import GuiUploadButtonHandle, _messages

        self._button = GuiUploadButtonHandle
        self._server, self._on_refused, self._max_bytes = server, on_refused, max_bytes
        self._gui = gui = server.gui
        self._refused_parts = Counter[int]()  # by connection
        sockets = server._websock_server
        start = _messages.FileTransferStartUpload
        for kind, viser_handler, handler in (
            (start, gui._handle_file_transfer_start, self._handle_start),
            (_messages.FileTransferPart, gui._handle_file_transfer_part, self._handle_part),
        ):
            sockets.unregister_handler(kind, viser_handler)
            sockets.register_handler(kind, handler)
        # Viser forgets the uploads of browsers itself, but not those of other clients.
        sockets.on_client_disconnect(lambda connection: self._forget(connection.client_id))

    @property
    def received_bytes(self) -> int:
        """Size of the unfinished uploads in memory."""
        return sum(s["transferred_bytes"] for s in self._uploads.values())

    @property
    def uploads(self) -> int:
        """Number of unfinished uploads."""
        return len(self._uploads)

    @property
    def _uploads(self) -> dict[str, Any]:
        return self._gui._current_file_upload_states  # type: ignore[no-any-return]

    def _handle_start(self, client: int, message: Any) -> None:
        source = self._gui._gui_input_handle_from_uuid.get(message.source_component_uuid)
        if not isinstance(source, self._button):  # it does not take files
            return
        size, parts = message.size_bytes, message.part_count
        if not _is_count(size) or not _is_count(parts) or parts != -(-size // _PART_BYTES):
            reason = Note("upload-invalid", "its announcement is invalid; reload the page")
        elif size > self._max_bytes:
            limit = f"{self._max_bytes / 2**20:,.0f} MB"
            text = f"it has {size / 2**20:,.0f} MB, more than the limit of {limit}"
            reason = Note("upload-too-large", text, {"size": size, "limit": self._max_bytes})
        elif len(self._uploads) >= _MAX_UPLOADS:
            text = f"{_MAX_UPLOADS} uploads are in progress; wait until they are finished"
            reason = Note("uploads-at-limit", text)
        else:
            self._gui._handle_file_transfer_start(client, message)
            return
        self._report(client, str(message.filename), reason)

    def _handle_part(self, client: int, message: Any) -> None:
        state = self._uploads.get(message.transfer_uuid)
        if state is None or state["client_id"] != client:
            self._count_refused_part(client)
            return
        content = message.content
        is_too_long = state["transferred_bytes"] + len(content) > state["total_bytes"]
        if not isinstance(content, bytes) or is_too_long:
            self._uploads.pop(message.transfer_uuid, None)
            reason = Note("upload-longer-than-announced", "it is larger than announced")
            self._report(client, str(state["filename"]), reason)
            return
        self._gui._handle_file_transfer_part(client, message)

    def _count_refused_part(self, client: int) -> None:
        """Count a part of a refused file, and close a connection that sends too many.

        A browser sends all parts, and no other message comes through meanwhile. It reconnects.
        """
        self._refused_parts[client] += 1
        connection = self._server._websock_server._live_connections.get(client)
        if self._refused_parts[client] == _MAX_REFUSED_PARTS and connection is not None:
            connection.transport.abort()

    def _forget(self, client: int) -> None:
        self._refused_parts.pop(client, None)
        self._gui._drop_uploads_from_client(client)

    def _report(self, client: int, name: str, reason: Note) -> None:
        page = self._server.get_clients().get(client)
        self._server._thread_executor.submit(self._on_refused, page, name, reason)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
