"""The command `defsense studio`."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from ..device import device_folder
from ..options import within
from ..output import say

if TYPE_CHECKING:
    from ...studio.page.studio import Studio
    from ..options import Commands

_PORT = 8090
_LOOK = 1.0  # s between looks at what others have written


def add(commands: Commands) -> None:
    """`studio`."""
    sub = commands.add_parser(
        "studio",
        help="draw a device's cords in the browser, while their expected error is told",
        description="Show a device's body and cords on a page of this machine. Control points are"
        " dragged, and the error that is expected in each pose follows; limits that break are told;"
        " the device is simulated, optimised and built from there. A folder without device begins"
        " with a gallery. Everything is written to"
        " device.toml at once, can be undone, and is the same as if it had been written by hand.",
        examples=[
            "defsense studio my-device",
            "defsense studio new-device",
            "defsense studio my-device --port 8100 --no-browser",
            "defsense studio my-device --host 0.0.0.0",
        ],
    )
    sub.add_argument("device", type=device_folder, metavar="DIR",
                     help="folder of the device, which may not be there yet")  # fmt: skip
    sub.add_argument("--port", type=int, default=_PORT, metavar="PORT",
                     help=f"of the page on this machine ({_PORT})")  # fmt: skip
    sub.add_argument("--host", default=None, metavar="ADDRESS",
                     help="for other machines, too: an address of this one, or 0.0.0.0 for all; the"
                     " link then has a token, without which nothing is shown")  # fmt: skip
    sub.add_argument("--trust", action="store_true",
                     help="run the folder's CAD script unasked: you wrote it")  # fmt: skip
    sub.add_argument("--no-browser", action="store_true", help="print the page's address alone")
    sub.add_argument("--seconds", type=float, default=None, metavar="S",
                     help="end after so long (runs until Ctrl-C)")  # fmt: skip
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_studio)


def _studio(options: argparse.Namespace) -> int:
    within("--port", options.port, 1024, 65535)
    if options.seconds is not None:
        within("--seconds", options.seconds, 0.1, 1e7)
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
        lines = [f"Studio:  {url}", "Ctrl-C ends; everything is written already."]
        if access.token:
            lines.insert(1, "         (the link is the key: whoever has it may do what you may)")
        say(lines)
        _run(studio, url, options)
    finally:
        close_page(server)
    return 0


def _run(studio: Studio, url: str, options: argparse.Namespace) -> None:
    from ...core.machine.processes import one_blas_thread

    if not options.no_browser:
        import webbrowser

        webbrowser.open(url)
    begun = time.monotonic()
    try:
        with one_blas_thread():  # as builds have it
            while options.seconds is None or time.monotonic() - begun < options.seconds:
                time.sleep(_LOOK)
                studio.look()
    except KeyboardInterrupt:
        say(["ended"])
    finally:
        studio.close()
