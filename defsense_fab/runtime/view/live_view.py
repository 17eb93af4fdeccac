"""The view as an output: every device's newest frame, on a page of its own or as a part of one."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

from ..frames.live_frame import LiveFrame
from .live_panel import LivePanel, PanelActions
from .live_scene import LiveScene
from .local_page import end_page, local_page
from .page_place import PagePlace
from .viewed_device import ViewedDevice

PORT = 8080


class LiveView:
    """An `Output` on a page at http://127.0.0.1:`place`, or in a place of a page that is there,
    which is left as it was. Raises OutputError for a port that is taken, and where viser is not
    installed."""

    name, trouble = "view", None

    def __init__(
        self, device: ViewedDevice, actions: PanelActions | None = None,
        place: int | PagePlace = PORT,
    ) -> None:  # fmt: skip
        self._folder: Any = None
        if isinstance(place, PagePlace):
            self.server: Any = place.server
            with place.folder:
                self._folder = self.server.gui.add_folder(f"{device.name} live")
        else:
            self.server = local_page(place, f"{device.name} live")
        self.port = int(self.server.get_port())
        with self._folder or nullcontext():
            self.panel = LivePanel(self.server, device, actions or PanelActions())
        self.scene = (
            LiveScene(self.server, device)
            if self._folder is None
            else LiveScene(self.server, device, "/live", look=False)
        )

    @property
    def about(self) -> str:
        return f"view: {self.url}"

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def send(self, frame: LiveFrame) -> None:
        with self.server.atomic():
            self.scene.show(frame)
            self.panel.show(frame)

    def close(self) -> None:
        self.panel.close()
        if self._folder is None:
            end_page(self.server)
            return
        self.scene.close()
        self._folder.remove()
