"""The command `defsense studio`."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from .options import within
from .output import say

if TYPE_CHECKING:
    from .options import Commands

_PORT = 8090
_LOOK = 1.0  # s between looks at what others have written


def add(commands: Commands) -> None:
    """`studio`."""
    sub = commands.add_parser(
        "studio",
        help="draw a device's cords in the browser, while their expected error is told",
        description="Show a device's body and cords on a page of this machine. Control points are"
        " dragged, and the error that is expected in each pose follows; limits that break are told;"
        " the device is simulated, optimised and built from there. Everything is written to"
        " device.toml at once, can be undone, and is the same as if it had been written by hand.",
        examples=[
            "defsense studio my-device",
            "defsense studio my-device --port 8100 --no-browser",
        ],
    )
    sub.add_argument("device", type=Path, metavar="DIR", help="folder with device.toml")
    sub.add_argument("--port", type=int, default=_PORT, metavar="PORT",
                     help=f"of the page on this machine ({_PORT})")  # fmt: skip
    sub.add_argument("--no-browser", action="store_true", help="print the page's address alone")
    sub.add_argument("--seconds", type=float, default=None, metavar="S",
                     help="end after so long (runs until Ctrl-C)")  # fmt: skip
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_studio)


def _studio(options: argparse.Namespace) -> int:
    within("--port", options.port, 1024, 65535)
    if options.seconds is not None:
        within("--seconds", options.seconds, 0.1, 1e7)
    from ..core.blas_threads import one_blas_thread
    from ..runtime.view.local_page import HOST, end_page, local_page
    from ..studio.page.studio_page import StudioPage
    from ..studio.project.project import Project

    project = Project(options.device)
    server = local_page(options.port, f"{project.device.name} studio")
    page = StudioPage(server, project)
    url = f"http://{HOST}:{options.port}"
    say([f"Studio:  {url}", "Ctrl-C ends; everything is written already."])
    if not options.no_browser:
        import webbrowser

        webbrowser.open(url)
    begun = time.monotonic()
    try:
        with one_blas_thread():  # as builds have it
            while options.seconds is None or time.monotonic() - begun < options.seconds:
                time.sleep(_LOOK)
                page.look()
    except KeyboardInterrupt:
        say(["ended"])
    finally:
        page.close()
        end_page(server)
    return 0
