"""Command `defsense open`: show the report or the assembly guide in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ...core.errors import StorageError
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, print_json, print_lines, standard_output

_NO_OUTPUT = OutputOptions()

open_page = command("open", "defsense open my-device", "defsense open my-device --guide")


@open_page.default
def _open(
    folder: DeviceFolder = Path(),
    /,
    *,
    guide: Annotated[bool, Parameter(help="Open the assembly guide.")] = False,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Open the report of a built device in the browser, and print its address.

    Args:
        folder: Folder of the device.
    """
    import webbrowser

    page = (folder / "build" / ("guide.html" if guide else "report.html")).resolve()
    if not page.is_file():
        raise StorageError(
            "no such file",
            code="file-not-found",
            where=page,
            action=f"Build the device first: defsense build {folder}",
        )
    with standard_output():
        if output.json:
            print_json({"page": page.as_uri()})
        else:
            print_lines([page.as_uri()])
    webbrowser.open(page.as_uri())
