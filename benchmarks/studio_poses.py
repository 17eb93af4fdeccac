"""How soon the body follows a hand that turns a region on the studio's page.

    python -m benchmarks.studio_poses DEVICE... [--edits 12] [--degrees 10]

Each DEVICE is the folder of a built device; it is copied first. The page is there with its server,
and no browser: the gizmo's messages are given by hand, each once the one before has its fine
answer. Times are from the message to the vertices being sent, medians, with the largest; CPU time
is what tells on a machine that is busy with something else.
"""

from __future__ import annotations

import argparse
import os
import shutil
import socket
import tempfile
import time
from pathlib import Path

import numpy as np

from defsense_fab.core.machine.processes import one_blas_thread
from defsense_fab.runtime.view.page_server import close_page, serve_page
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.poses.poses_mode import PosesMode
from defsense_fab.studio.project.project import Project

LONG = 600.0  # s


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("devices", type=Path, nargs="+")
    parser.add_argument("--edits", type=int, default=12)
    parser.add_argument("--degrees", type=float, default=10.0)
    options = parser.parse_args()
    with one_blas_thread(), tempfile.TemporaryDirectory() as room:
        for folder in options.devices:
            copy = Path(room) / folder.name
            shutil.copytree(folder, copy)
            server = serve_page(free_port(), "benchmark")
            page = StudioPage(server, Project(copy))
            try:
                measure(page, options.edits, np.deg2rad(options.degrees))
            finally:
                page.close()
                close_page(server)


def measure(page: StudioPage, edits: int, step: float) -> None:
    mode = page.modes["Poses"]
    assert isinstance(mode, PosesMode)
    page.enter("Poses")
    began = time.monotonic()
    while not mode.work.has_coarse and time.monotonic() - began < LONG:
        time.sleep(0.1)
    for pose in page.bench.project.device.poses:
        mode.poses.choose(pose.name)
        mode.work.wait(LONG)
        handle = pose.handles[0]
        angle = np.linalg.norm(handle.rotation)
        if not angle:
            continue
        axis = handle.rotation / angle
        place = np.zeros(3)  # its place is free, or is that of the pose
        turned(mode, handle.region, place, (angle - step) * axis)  # the coarse mesh's first
        mode.work.times.clear()
        begun = time.process_time()
        for k in range(edits):
            turned(mode, handle.region, place, (angle - step * (k % 2)) * axis)
        coarse = [t.coarse for t in mode.work.times if t.coarse is not None]
        fine = [t.fine for t in mode.work.times if t.fine is not None]
        spent = (time.process_time() - begun) / edits
        load = os.getloadavg()[0]
        print(
            f"{page.bench.project.device.name} {pose.name}, {np.rad2deg(step):g} degrees:"
            f" coarse {np.median(coarse):.3f} s (largest {max(coarse):.3f}),"
            f" fine {np.median(fine):.3f} s (largest {max(fine):.3f}),"
            f" {spent:.3f} s of CPU an edit; load {load:.1f}",
            flush=True,
        )


def turned(mode: PosesMode, region: str, place, rotation) -> None:
    mode.poses.moved(region, place, rotation, False)
    if not mode.work.wait(LONG):
        raise SystemExit("no answer")


if __name__ == "__main__":
    main()
