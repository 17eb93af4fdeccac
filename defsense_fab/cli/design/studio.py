"""Command `defsense studio`: edit a device in the browser."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from ..device import device_folder
from ..options import add_verbose_option, check_range
from ..output import print_lines

if TYPE_CHECKING:
    from ...studio.page.studio import Studio
    from ..options import Commands

_PORT = 8090
#: Time between checks for changes by other programs.
_POLL_INTERVAL_S = 1.0


def add(commands: Commands) -> None:
    """Add `studio`."""
    sub = commands.add_parser(
        "studio",
        help="Edit a device's cords in the browser, with live error estimates",
        description="Show a device's body and cords on a page of this machine. Drag control "
        "points, and the page updates the expected error of each pose and lists "
        "violated limits. Simulate, optimize and build the device from there. For a "
        "folder without a device, the page starts with a gallery. Every change is "
        "written to device.toml immediately and can be undone.",
        examples=[
            "defsense studio my-device",
            "defsense studio new-device",
            "defsense studio my-device --port 8100 --no-browser",
            "defsense studio my-device --host 0.0.0.0",
        ],
    )
    sub.add_argument(
        "device",
        type=device_folder,
        metavar="DIR",
        help="Folder of the device; it need not exist yet",
    )
    sub.add_argument(
        "--port",
        type=int,
        default=_PORT,
        metavar="PORT",
        help=f"Set the port of the page (default: {_PORT})",
    )
    sub.add_argument(
        "--host",
        default=None,
        metavar="ADDRESS",
        help="Serve other machines too: an address of this machine, or 0.0.0.0 for all; the"
        " link then contains a token, which is required to see the page",
    )
    sub.add_argument(
        "--trust",
        action="store_true",
        help="Run the folder's CAD script without confirmation, because you wrote it",
    )
    sub.add_argument(
        "--no-browser",
        action="store_true",
        help="Print the page's address without opening a browser",
    )
    sub.add_argument(
        "--seconds",
        type=float,
        default=None,
        metavar="S",
        help="Stop after this time in s (default: at Ctrl-C)",
    )
    add_verbose_option(sub)
    sub.set_defaults(run=_studio)


def _studio(options: argparse.Namespace) -> int:
    check_range("--port", options.port, 1024, 65535)
    if options.seconds is not None:
        check_range("--seconds", options.seconds, 0.1, 1e7)
    from ...core.machine.local_access import Access
    from ...runtime.view.page_server import HOST, close_page, page_link, serve_page
    from ...studio.page.studio import Studio
    from ...studio.project.agreement import Agreement

    host = options.host or HOST
    access = Access(host)
    server = serve_page(options.port, f"{options.device.absolute().name} studio", access, host)
    try:
        studio = Studio(server, options.device, Agreement(trusted=options.trust))
        url = page_link(host, options.port, access)
        lines = [f"Studio:  {url}", "Press Ctrl-C to stop; all changes are saved."]
        if access.token:
            lines.insert(1, "         (anyone with this link has full access)")
        print_lines(lines)
        _run(studio, url, options)
    finally:
        close_page(server)
    return 0


def _run(studio: Studio, url: str, options: argparse.Namespace) -> None:
    from ...core.machine.processes import one_blas_thread

    if not options.no_browser:
        import webbrowser

        webbrowser.open(url)
    started_at = time.monotonic()
    try:
        with one_blas_thread():  # as in builds
            while options.seconds is None or time.monotonic() - started_at < options.seconds:
                time.sleep(_POLL_INTERVAL_S)
                studio.poll()
    except KeyboardInterrupt:
        print_lines(["Stopped."])
    finally:
        studio.close()
