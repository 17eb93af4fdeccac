"""Command `defsense studio`: edit a device in the browser."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from msgspec import Meta

from ...core.schema.options import check_options
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, print_lines

if TYPE_CHECKING:
    from ...studio.app.studio_app import StudioApp
    from ...workflow.view import WebServer

#: Time between checks for changes by other programs.
_POLL_INTERVAL_S = 1.0


@dataclass(frozen=True)
class StudioOptions:
    """How the page of the studio is served.

    Attributes:
        port: Set the port of the page.
        host: Serve other machines too: an address of this machine, or 0.0.0.0 for all; the link
            then contains a token, which is required to see the page.
        trust: Run the folder's CAD script without confirmation, because you wrote it.
        browser: Open a browser; otherwise only print the page's address.
        seconds: Stop after this time in s (default: at Ctrl-C).
    """

    port: Annotated[int, Meta(ge=1024, le=65535)] = 8090
    host: Annotated[str | None, Parameter(metavar="ADDRESS")] = None
    trust: bool = False
    browser: bool = True
    seconds: Annotated[float, Meta(ge=0.1, le=1e7)] | None = None

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True)
class _StudioOutput(OutputOptions):
    """Options of the output: the studio has no result to print as JSON."""

    json: Annotated[bool, Parameter(parse=False)] = False


_DEFAULTS, _NO_OUTPUT = StudioOptions(), _StudioOutput()

studio = command(
    "studio",
    "defsense studio",
    "defsense studio my-device",
    "defsense studio new-device",
    "defsense studio my-device --port 8100 --no-browser",
    "defsense studio my-device --host 0.0.0.0",
)


@studio.default
def _studio(
    folder: DeviceFolder | None = None,
    /,
    *,
    options: Annotated[StudioOptions, Parameter(name="*")] = _DEFAULTS,
    output: _StudioOutput = _NO_OUTPUT,  # noqa: ARG001 - read by the program
) -> None:
    """Design a device in the browser, from its body to the live model.

    Serves a page to this machine: set the body, define poses, see the strain inside, draw sensors
    with live error estimates, optimize them, build the parts, and record, train and run the
    device. For a folder without a device, the page starts with a gallery. Every change is written
    to device.toml immediately and can be undone.

    Args:
        folder: Folder of the device; it need not exist yet. If omitted, the current folder if it
            has a device, or else a new folder in it.
    """
    from ...core.machine.local_access import Access
    from ...studio.app.device_folder import check_folder
    from ...workflow.view import HOST, WebServer

    folder = folder or _default_folder()
    check_folder(folder)
    host = options.host or HOST
    access = Access(host)
    server = WebServer(options.port, access, host)
    server.listen()  # the browser loads the page while the studio starts
    url = access.link(options.port)
    lines = [f"Studio:  {url}", "Press Ctrl-C to stop; all changes are saved."]
    if access.token:
        lines.insert(1, "         (anyone with this link has full access)")
    print_lines(lines)
    if options.browser:
        import webbrowser

        webbrowser.open(url)
    try:
        _open(server, folder, options)
    except KeyboardInterrupt:
        print_lines(["Stopped."])
    finally:
        server.close()


def _open(server: WebServer, folder: Path, options: StudioOptions) -> None:
    from ...studio.app.studio_app import StudioApp
    from ...studio.project.agreement import Agreement

    studio = StudioApp(server, folder, Agreement(trusted=options.trust))
    server.start(studio)
    _serve(studio, options.seconds)


def _serve(studio: StudioApp, seconds: float | None) -> None:
    """Follow changes by other programs until the time has passed or Ctrl-C is pressed."""
    from ...core.machine.processes import one_blas_thread

    started_at = time.monotonic()
    try:
        with one_blas_thread():  # as in builds
            while seconds is None or time.monotonic() - started_at < seconds:
                time.sleep(_POLL_INTERVAL_S)
                studio.poll()
    finally:
        studio.close()


def _default_folder() -> Path:
    """Return the current folder if it has a device, or else a new folder in it."""
    from ...core.device.device_file import DEVICE

    if Path(DEVICE).is_file():
        return Path()
    names = chain(["new-device"], (f"new-device-{k}" for k in count(2)))
    return next(Path(name) for name in names if not Path(name).exists())
