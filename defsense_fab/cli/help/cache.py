"""Command `defsense cache`: clear what is kept on this machine to save time."""

from __future__ import annotations

from dataclasses import asdict

from ..app import command
from ..output import OutputOptions, print_json, print_lines, standard_output

_NO_OUTPUT = OutputOptions()

cache = command("cache", "defsense cache clear")
clear = command(
    "clear",
    "defsense cache clear",
    "defsense cache clear --json",
    help="Delete cached meshes, solved poses and compiled code, and show the freed space",
)
cache.command(clear)


@clear.default
def _clear(*, output: OutputOptions = _NO_OUTPUT) -> None:
    """Delete cached meshes, solved poses and compiled code, and show the freed space.

    The next commands make again what they need, with the same results. Files of devices, builds and
    recordings are not touched.
    """
    from ...workflow.cache import clear_cache

    cleared = clear_cache()
    with standard_output():
        if output.json:
            print_json([asdict(item) for item in cleared])
            return
        for item in cleared:
            places = ", ".join(item.folders[:3]) + (", ..." if len(item.folders) > 3 else "")
            left = f"; {item.left} could not be deleted" if item.left else ""
            where = f" in {places}" if places else ""
            print_lines(
                [f"{item.kind}: {item.count} deleted, {item.bytes / 1e6:.1f} MB{where}{left}"]
            )
        print_lines([f"freed {sum(item.bytes for item in cleared) / 1e6:.1f} MB"])
