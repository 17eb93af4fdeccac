"""Memory and CPU time of the studio and of its page during long use by a script."""

from __future__ import annotations

import os
import random
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.studio_page import SIZE, enter, middle, open_chromium
from benchmarks.studio_server import (
    TIMEOUT_S,
    SocketClient,
    Studio,
    load_average,
    memory_mb,
    open_studio,
    process_tree,
    processor_seconds,
)

_STEPS = ("Body", "Poses", "Inside", "Sensors", "Optimize", "Make", "Measure")
_PAUSE_S = (0.5, 3.0)  # between actions, as of a person
_MAX_CORDS, _MIN_CORDS = 6, 2
#: Counts the objects of WebGL that exist.
_COUNTER = """
window.objectCounts = { buffers: 0, textures: 0, programs: 0 };
const prototype = WebGL2RenderingContext.prototype;
const names = { Buffer: "buffers", Texture: "textures", Program: "programs" };
for (const [name, key] of Object.entries(names)) {
  const [create, remove] = [prototype["create" + name], prototype["delete" + name]];
  prototype["create" + name] = function () { objectCounts[key]++; return create.call(this); };
  prototype["delete" + name] = function (object) {
    if (object) objectCounts[key]--;
    return remove.call(this, object);
  };
}
"""
_HEADER = (
    "min   server MB, cores   page MB, cores   JS heap MB   nodes   listeners"
    "   buffers textures programs   actions failed   load"
)


@dataclass
class _User:
    """A user of the page, who acts at random.

    Attributes:
        page: The page.
        rng: Random numbers.
        action_count: Number of actions.
        failures: What went wrong.
    """

    page: Any
    rng: random.Random
    action_count: int = 0
    failures: list[str] | None = None

    def act(self) -> None:
        """Do one thing; a control that another action has hidden is a failure that is counted."""
        action = self.rng.choice(
            [self.drag_point] * 6
            + [self.drag_plane] * 2
            + [self.turn_camera] * 2
            + [self.add_or_delete, self.undo, self.redo, self.enter_step, self.play_pose]
        )
        self.action_count += 1
        try:
            action()
        except Exception as error:  # the next action may succeed
            self.page.mouse.up()
            self.page.keyboard.press("Escape")
            assert self.failures is not None
            self.failures.append(f"{action.__name__}: {str(error).splitlines()[0]}")

    def drag_point(self) -> None:
        enter(self.page, "Sensors")
        cord = self.rng.choice(self._cords())
        cord.click()
        points = self.page.get_by_role("button", name="point ").locator("visible=true")
        self._drag(points.nth(self.rng.randrange(points.count())), 20)

    def drag_plane(self) -> None:
        enter(self.page, "Inside")
        self._drag(self.page.get_by_role("button", name="Move the plane along its normal"), 20)

    def turn_camera(self) -> None:
        self._drag(self.page.locator("canvas").first, 30)

    def add_or_delete(self) -> None:
        enter(self.page, "Sensors")
        cords = self._cords()
        if len(cords) > _MIN_CORDS and (len(cords) >= _MAX_CORDS or self.rng.random() < 0.5):
            self.rng.choice(cords).click()
            self.page.keyboard.press("Delete")
        else:
            self.page.keyboard.press("Escape")
            self.page.get_by_role("button", name="Straight").first.click()

    def undo(self) -> None:
        self.page.keyboard.press("Control+z")

    def redo(self) -> None:
        self.page.keyboard.press("Control+Shift+z")

    def enter_step(self) -> None:
        enter(self.page, self.rng.choice(_STEPS))

    def play_pose(self) -> None:
        enter(self.page, "Poses")
        poses = self.page.locator('[role=treeitem][data-node^="pose:"]').all()
        self.rng.choice(poses).click()
        self.page.get_by_role("button", name="Play").first.click()
        self.page.wait_for_timeout(3000)

    def _cords(self) -> list[Any]:
        cords: list[Any] = self.page.locator('[role=treeitem][data-node^="cord:"]').all()
        return cords

    def _drag(self, handle: Any, steps: int) -> None:
        self.page.keyboard.press("f")  # a handle outside the view would be under another control
        self.page.wait_for_timeout(500)
        x, y = middle(handle)
        dx, dy = self.rng.uniform(-30, 30), self.rng.uniform(-30, 30)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for k in range(1, steps + 1):
            self.page.mouse.move(x + dx * k / steps, y + dy * k / steps)
            self.page.wait_for_timeout(30)
        self.page.mouse.up()


def use_studio(device: Path, minutes: float, seed: int) -> None:
    """Use the studio by a script, while another client is connected, and print a line a minute.

    Args:
        device: Folder of a copy of a built device, which is changed.
        minutes: Duration.
        seed: Seed of the random actions.
    """
    with open_studio(device) as studio, open_chromium() as browser:
        client = SocketClient(studio.port)
        is_finished = threading.Event()
        reading = threading.Thread(target=_read, args=(client, is_finished))
        reading.start()
        try:
            _use(studio, browser, minutes, random.Random(seed))
        finally:
            is_finished.set()
            reading.join()
            client.close()


def _use(studio: Studio, browser: Any, minutes: float, rng: random.Random) -> None:
    context = browser.new_context(viewport=SIZE)
    context.add_init_script(_COUNTER)
    page = context.new_page()
    page.goto(studio.url)
    page.get_by_role("navigation", name="Steps").wait_for(timeout=1e3 * TIMEOUT_S)
    page.set_default_timeout(20_000)
    metrics = context.new_cdp_session(page)
    metrics.send("Performance.enable")
    server = [studio.process.pid]
    chromium = [number for number in process_tree(os.getpid()) if number not in server]
    user = _User(page, rng, failures=[])
    started_at = reported_at = time.monotonic()
    used = _used(server, chromium)
    print(_HEADER)
    while time.monotonic() - started_at < 60 * minutes:
        user.act()
        time.sleep(rng.uniform(*_PAUSE_S))
        if time.monotonic() - reported_at < 60:
            continue
        duration, before = time.monotonic() - reported_at, used
        chromium = [n for n in process_tree(os.getpid()) if n not in process_tree(server[0])]
        used = _used(server, chromium)
        reported_at = time.monotonic()
        shares = [(after - start) / duration for after, start in zip(used, before, strict=True)]
        minute = round((reported_at - started_at) / 60)
        _report(minute, page, metrics, (server, chromium), shares, user)
    for failure in sorted(set(user.failures or [])):
        print(f"  failed: {failure}")


def _report(
    minute: int,
    page: Any,
    metrics: Any,
    processes: tuple[list[int], list[int]],
    shares: list[float],
    user: _User,
) -> None:
    metrics.send("HeapProfiler.collectGarbage")
    values = {m["name"]: m["value"] for m in metrics.send("Performance.getMetrics")["metrics"]}
    counts = page.evaluate("() => objectCounts")
    server, chromium = processes
    print(
        f"{minute:3d}   {memory_mb(process_tree(server[0])):6.0f} {shares[0]:9.2f}"
        f"   {memory_mb(chromium[1:]):6.0f} {shares[1]:7.2f}"
        f"   {values['JSHeapUsedSize'] / 1e6:10.1f}   {values['Nodes']:5.0f}"
        f"   {values['JSEventListeners']:9.0f}   {counts['buffers']:7d} {counts['textures']:8d}"
        f" {counts['programs']:8d}   {user.action_count:7d} {len(user.failures or []):6d}"
        f"   {load_average():4.1f}",
        flush=True,
    )


def _used(server: list[int], chromium: list[int]) -> tuple[float, float]:
    """Return the CPU seconds of the server and of the browser."""
    return processor_seconds(process_tree(server[0])), processor_seconds(chromium[1:])


def _read(client: SocketClient, is_finished: threading.Event) -> None:
    """Receive and drop all messages, as a second browser does."""
    while not is_finished.is_set():
        client.drain(1.0)
