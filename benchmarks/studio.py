"""Measure how soon the studio shows the error while a cord is dragged, and its use of an hour.

    python -m benchmarks.studio my-device other-device
    python -m benchmarks.studio my-device --hour --minutes 60

Devices must be built; they are copied, and the copies are changed. A control point is dragged with
60 messages per second for 10 s. Printed are the evaluations per second, and the time from a message
to its error on the page (median and 95th percentile). With `--hour` a script uses the studio at a
person's pace, while pages are connected by web sockets: it drags, draws, deletes, undoes, and
enters the modes. Memory and the share of a core are printed every minute.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from defsense_fab.core.device.build_folder import build_folder
from defsense_fab.core.machine.processes import one_blas_thread
from defsense_fab.runtime.view.page_server import HOST, close_page, serve_page
from defsense_fab.store.layout import load_layout
from defsense_fab.studio.cords.cord_scene import with_point
from defsense_fab.studio.edits.cords import take_cords
from defsense_fab.studio.page.studio_page import StudioPage
from defsense_fab.studio.project.project import Project

_RATE = 60.0  # messages a second, more than browsers send
_SECONDS = 10.0
_LOOKING = 2


def open_studio(device: Path, folder: Path) -> tuple[StudioPage, Callable[[], None]]:
    """Return the studio of a copy of the device, and a function that closes it."""
    copy = folder / device.name
    shutil.copytree(device, copy)
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    server = serve_page(port, "benchmark")
    page = StudioPage(server, Project(copy))
    page.enter("Cords")
    if not page.bench.project.device.sensors:  # all of its cords were proposed
        layout = load_layout(build_folder(page.bench.project.device))
        page.bench.apply(take_cords([record.sensor() for record in layout.by_channel()]))

    def end() -> None:
        page.close()
        close_page(server)

    return page, end


def drag(page: StudioPage) -> tuple[float, np.ndarray]:
    """Return evaluations per second, and the time from each message to its answer, s."""
    mode = page.modes["Cords"]
    sensor = page.bench.project.device.sensors[0]
    mode.choose(sensor.name)
    wait_for_all(mode)
    sent_at: dict[int, float] = {}
    delays: list[float] = []
    work, count_before = mode.error_worker._work, mode.error_worker.done_count

    def watched(cords):  # type: ignore[no-untyped-def]
        work(cords)
        delays.append(time.perf_counter() - sent_at[id(cords)])

    mode.error_worker._work = watched
    give = mode.error_worker.give

    def stamped(cords):  # type: ignore[no-untyped-def]
        sent_at[id(cords)] = time.perf_counter()
        references.append(cords)
        give(cords)

    references: list[object] = []
    mode.error_worker.give = stamped
    started_at = time.perf_counter()
    for k in range(int(_RATE * _SECONDS)):
        turn = 2 * np.pi * k / (2 * _RATE)
        place = sensor.curve.points[2] + 3.0 * np.array([np.cos(turn), np.sin(turn)])
        mode.drag(with_point(sensor, 2, place), "points", 2, False)
        time.sleep(max(started_at + (k + 1) / _RATE - time.perf_counter(), 0.0))
    seconds = time.perf_counter() - started_at
    wait_for_all(mode)
    mode.error_worker._work, mode.error_worker.give = work, give
    return (mode.error_worker.done_count - count_before) / seconds, np.array(delays)


def wait_for_all(mode) -> None:  # type: ignore[no-untyped-def]
    """Wait until all workers are idle."""
    for work in (mode.error_worker, mode.limits_worker, mode.comparison_worker):
        work.wait(60.0)


def use(page: StudioPage, minutes: float, seed: int) -> None:
    """Use the studio as a person would, and print a line every minute."""
    rng = random.Random(seed)
    cords = page.modes["Cords"]
    started_at = reported_at = time.monotonic()
    processor = time.process_time()
    steps = 0
    while time.monotonic() - started_at < 60 * minutes:
        _step(page, cords, rng)
        steps += 1
        time.sleep(rng.uniform(0.5, 3.0))
        if time.monotonic() - reported_at >= 60:
            share = (time.process_time() - processor) / (time.monotonic() - reported_at)
            minute = round((time.monotonic() - started_at) / 60)
            print(f"{minute:3d} min: {memory():5.0f} MB, {share:.2f} of a core, {steps} steps",
                  flush=True)  # fmt: skip
            reported_at, processor = time.monotonic(), time.process_time()


def _step(page: StudioPage, cords, rng: random.Random) -> None:  # type: ignore[no-untyped-def]
    sensors = page.bench.project.device.sensors
    step_kind = rng.choice(["drag"] * 6 + ["add", "delete", "undo", "redo", "mode", "mirror"])
    page.enter("Cords")
    if step_kind == "add" and len(sensors) < 6:
        page.bench.run_action(cords.add_straight)
    elif step_kind == "delete" and len(sensors) > 2:
        cords.choose(rng.choice(sensors).name)
        cords.chosen.delete()
    elif step_kind == "undo":
        page.bench.run_action(page.bench.project.undo)
    elif step_kind == "redo":
        page.bench.run_action(page.bench.project.redo)
    elif step_kind == "mode":
        page.enter(rng.choice(list(page.modes)))
    elif sensors:
        sensor = rng.choice(sensors)
        cords.choose(sensor.name)
        at = rng.randrange(len(sensor.curve.points))
        direction = np.array([rng.uniform(-3, 3), rng.uniform(-3, 3)])
        for k in range(1, 21):
            place = sensor.curve.points[at] + direction * k / 20
            cords.drag(with_point(sensor, at, place), "points", at, k == 20)
            time.sleep(0.05)


def memory() -> float:
    """Return the memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def connect_page(port: int, is_finished: threading.Event) -> None:
    """Connect a page: a web socket that receives all messages and answers none."""
    import viser
    from websockets.sync.client import connect

    protocol = f"viser-v{viser.__version__}"
    with connect(f"ws://{HOST}:{port}", subprotocols=[protocol], max_size=None) as page:  # type: ignore[list-item]
        while not is_finished.is_set():
            try:
                page.recv(timeout=1.0)
            except TimeoutError:
                continue


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("device", type=Path, nargs="+")
    parser.add_argument("--hour", action="store_true")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for device in options.device:
        with tempfile.TemporaryDirectory() as temporary, one_blas_thread():
            page, end = open_studio(device, Path(temporary))
            is_finished = threading.Event()
            port = page.bench.server.get_port()
            pages = [
                threading.Thread(target=connect_page, args=(port, is_finished))
                for _ in range(_LOOKING)
            ]
            for thread in pages:
                thread.start()
            try:
                if options.hour:
                    use(page, options.minutes, options.seed)
                else:
                    rate, delays = drag(page)
                    print(
                        f"{device.name}: {rate:.0f} errors per second;"
                        f" {1e3 * np.median(delays):.0f} ms after the movement"
                        f" (95th: {1e3 * np.percentile(delays, 95):.0f} ms)"
                    )
            finally:
                is_finished.set()
                for thread in pages:
                    thread.join()
                end()


if __name__ == "__main__":
    main()
