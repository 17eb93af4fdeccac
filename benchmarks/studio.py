"""Measure the studio: delays over its socket and in a browser, frames, loading, long use.

    python -m benchmarks.studio my-device other-device
    python -m benchmarks.studio my-device --only socket
    python -m benchmarks.studio my-device --only frames --other OTHER_CHECKOUT
    python -m benchmarks.studio my-device --hour --minutes 60

The poses of the devices must be simulated. The devices are copied, and the copies are changed. The
studio runs in another process. Times are medians and 95th percentiles:

- `socket`: from the start to the answered page and to the device's state; from a dragged control
  point to the judged error, from a plane to its section, from the angle of a pose to its shape.
- `page`: the same in Chromium, from the movement of the pointer to the animation frame after the
  one with the new text or mesh; loading of the page, and the sizes of its files.
- `frames`: frames per second while the mouse turns the camera, for `character` with about 100,000
  triangles, and also for the page of another checkout. Only the body is made.
- `--hour`: a script uses the page at a person's pace, next to another connection. Each minute
  memory and cores of the server and of Chromium are printed, with the sizes of the page's heap and
  document, and the numbers of WebGL's objects.

Chromium renders with the processor, as on a machine without a graphics card, and shares the cores
with the studio; the load of the machine is printed with each number.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from benchmarks.studio_hour import use_studio
from benchmarks.studio_page import measure_frames, measure_page
from benchmarks.studio_server import ROOT, SocketClient, copy_device, open_studio
from benchmarks.studio_socket import measure_socket

PARTS = ("socket", "page", "frames")
CHARACTER = ROOT / "fixtures" / "devices" / "character"
_CELL_MM = 0.85  # of the level set: about 100,000 triangles


def write_character(folder: Path) -> Path:
    """Return a copy of `character` with about 100,000 triangles, whose body the studio made."""
    import importlib.util

    from defsense_fab.core.mesh import Surface
    from defsense_fab.geometry.printing.export import write_stl

    copy = folder / "character"
    shutil.copytree(CHARACTER, copy, ignore=shutil.ignore_patterns("build"))
    spec = importlib.util.spec_from_file_location("character", CHARACTER / "make_character.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.CELL = _CELL_MM
    vertices, faces = module.character()
    surface = Surface(vertices.astype(float), faces.astype("int64"))
    if surface.volume < 0:
        surface = Surface(surface.vertices, surface.faces[:, ::-1])
    write_stl(surface, copy / "character.stl")
    print(f"character: {len(surface.faces):,} triangles")
    with open_studio(copy) as studio:
        client = SocketClient(studio.port)
        client.event("device-state")
        client.send("make-body")
        client.receive(lambda m: m["kind"] == "arrays" and m["name"] == "body")
        client.close()
    return copy


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("device", type=Path, nargs="*")
    parser.add_argument("--only", choices=PARTS, action="append")
    parser.add_argument("--other", type=Path, help="measure the frames of this checkout's page too")
    parser.add_argument("--hour", action="store_true")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    parts = ("hour",) if options.hour else (options.only or PARTS)
    actions = {
        "socket": measure_socket,
        "page": measure_page,
        "hour": lambda device: use_studio(device, options.minutes, options.seed),
    }
    for part in parts:
        if part == "frames":
            with tempfile.TemporaryDirectory() as temporary:
                measure_frames(write_character(Path(temporary)), options.other)
            continue
        for device in options.device:
            with tempfile.TemporaryDirectory() as temporary:
                actions[part](copy_device(device, Path(temporary)))


if __name__ == "__main__":
    main()
