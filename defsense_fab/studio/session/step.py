"""The interface of a step: the requests that it handles, and what it publishes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...workflow.view import Client, Download, Request
from .device_session import DeviceSession

#: Handles a request; returns a result, arrays, or None. Raises DefsenseError.
Handler = Callable[[Client, Any], Any]


class Step:
    """A step of the work on one device.

    Args:
        session: The device.
    """

    def __init__(self, session: DeviceSession) -> None:
        self.session = session

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        """The requests that the step handles."""
        return {}

    def on_device_changed(self) -> None:
        """Follow a change of `device.toml`."""

    def on_build_loaded(self) -> None:
        """Follow a new build, body or judge."""

    def on_body_changed(self) -> None:
        """Follow a body that differs from the built one, or its end."""

    def on_freshness(self) -> None:
        """Follow the result of `DeviceSession.check_freshness`."""

    def connect(self, client: Client) -> None:
        """Greet a browser, which has got all published events and arrays."""

    def disconnect(self, client: Client) -> None:
        """Forget a browser."""

    def download(self, path: str) -> Download | None:  # noqa: ARG002 - most have none
        """Return the file at a path below `/files/`, or None."""
        return None

    def poll(self) -> None:
        """Check for files that other programs have changed; called about once a second."""

    def close(self) -> None:
        """End threads and processes."""
