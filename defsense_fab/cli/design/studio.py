"""Command `defsense studio`: edit a device in the browser."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from msgspec import Meta

from ...core.schema.options import check_options
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, print_lines

if TYPE_CHECKING:
    from pathlib import Path

    from ...studio.app.studio_app import StudioApp
    from ...studio.page.studio import Studio
    from ...studio.project.agreement import Agreement

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
        preview: Show the new page, which is not complete yet.
    """

    port: Annotated[int, Meta(ge=1024, le=65535)] = 8090
    host: Annotated[str | None, Parameter(metavar="ADDRESS")] = None
    trust: bool = False
    browser: bool = True
    seconds: Annotated[float, Meta(ge=0.1, le=1e7)] | None = None
    preview: bool = False

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True)
class _StudioOutput(OutputOptions):
    """Options of the output: the studio has no result to print as JSON."""

    json: Annotated[bool, Parameter(parse=False)] = False


_DEFAULTS, _NO_OUTPUT = StudioOptions(), _StudioOutput()

studio = command(
    "studio",
    "defsense studio my-device",
    "defsense studio new-device",
    "defsense studio my-device --port 8100 --no-browser",
    "defsense studio my-device --host 0.0.0.0",
)


@studio.default
def _studio(
    folder: DeviceFolder,
    /,
    *,
    options: Annotated[StudioOptions, Parameter(name="*")] = _DEFAULTS,
    output: _StudioOutput = _NO_OUTPUT,  # noqa: ARG001 - read by the program
) -> None:
    """Edit a device's cords in the browser, with live error estimates.

    Shows a device's body and cords on a page of this machine. Drag control points, and the page
    updates the expected error of each pose and lists violated limits. Simulate, optimize and build
    the device from there. For a folder without a device, the page starts with a gallery. Every
    change is written to device.toml immediately and can be undone.

    Args:
        folder: Folder of the device; it need not exist yet.
    """
    from ...studio.page.studio import Studio
    from ...studio.project.agreement import Agreement
    from ...workflow.view import open_page

    agreement = Agreement(trusted=options.trust)
    if options.preview:
        _serve_preview(folder, options, agreement)
        return
    title = f"{folder.absolute().name} studio"
    with open_page(options.port, title, options.host) as page:
        studio = Studio(page.server, folder, agreement)
        lines = [f"Studio:  {page.url}", "Press Ctrl-C to stop; all changes are saved."]
        if page.has_token:
            lines.insert(1, "         (anyone with this link has full access)")
        print_lines(lines)
        if options.browser:
            import webbrowser

            webbrowser.open(page.url)
        _serve(studio, options.seconds)


def _serve_preview(folder: Path, options: StudioOptions, agreement: Agreement) -> None:
    from ...core.machine.local_access import Access
    from ...studio.app.studio_app import StudioApp
    from ...workflow.view import HOST, WebServer

    access = Access(options.host or HOST)
    server = WebServer(options.port, access, options.host or HOST)
    app = StudioApp(server, folder, agreement)
    server.start(app)
    url = access.link(options.port)
    lines = [f"Studio:  {url}", "Press Ctrl-C to stop; all changes are saved."]
    if access.token:
        lines.insert(1, "         (anyone with this link has full access)")
    print_lines(lines)
    if options.browser:
        import webbrowser

        webbrowser.open(url)
    try:
        _serve(app, options.seconds)
    finally:
        server.close()


def _serve(studio: Studio | StudioApp, seconds: float | None) -> None:
    """Follow changes by other programs until the time has passed or Ctrl-C is pressed."""
    from ...core.machine.processes import one_blas_thread

    started_at = time.monotonic()
    try:
        with one_blas_thread():  # as in builds
            while seconds is None or time.monotonic() - started_at < seconds:
                time.sleep(_POLL_INTERVAL_S)
                studio.poll()
    except KeyboardInterrupt:
        print_lines(["Stopped."])
    finally:
        studio.close()
