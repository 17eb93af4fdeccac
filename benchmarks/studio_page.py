"""Delays, frames and loading of the studio's page in Chromium, without a graphics card."""

from __future__ import annotations

import gzip
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studio_server import ROOT, TIMEOUT_S, Studio, load_average, open_studio

PROBE = Path(__file__).with_name("studio_probe.js").read_text(encoding="utf-8")
SIZE = {"width": 1280, "height": 800}
_STEP_PX, _PAUSE_MS = 5, 30  # between movements of the pointer
_DRAG_COUNT = 40  # movements for each delay
_TURN_SECONDS = 10.0  # during which the camera turns
_MIN_BODY_TRIANGLES = 500  # in a frame that shows the body
_ANSWER_TIMEOUT_S = 10.0
_HEADLINE = ".prediction .headline"
_MIDDLE = """(element) => {
  if (element.getTotalLength) {
    const point = element.getPointAtLength(element.getTotalLength() / 2);
    const { x, y } = point.matrixTransform(element.getScreenCTM());
    return [x, y];
  }
  const { left, top, width, height } = element.getBoundingClientRect();
  return [left + width / 2, top + height / 2];
}"""


@contextmanager
def open_chromium() -> Iterator[Any]:
    """Run the Chromium of this machine until the block ends."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium") or shutil.which("chromium-browser")
    switches = ["--enable-unsafe-swiftshader", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=switches)
        try:
            yield browser
        finally:
            browser.close()


def open_page(browser: Any, url: str) -> Any:
    """Return a page of a new context that shows the studio and its body."""
    context = browser.new_context(viewport=SIZE)
    context.add_init_script(PROBE)
    page = context.new_page()
    page.set_default_timeout(1e3 * TIMEOUT_S)
    page.goto(url)
    wait_for_body(page)
    return page


def wait_for_body(page: Any) -> float:
    """Wait until a body is drawn; return the time since the navigation, s."""
    frame = page.wait_for_function(
        f"() => studioProbe.frames.find((f) => f.triangles > {_MIN_BODY_TRIANGLES})"
    )
    return float(frame.json_value()["at"]) / 1e3


def enter(page: Any, step: str) -> None:
    """Enter a step, and close the offer of the introduction."""
    offer = page.get_by_role("button", name="Not now")
    if offer.is_visible():
        offer.click()
    page.get_by_role("navigation", name="Steps").get_by_role("button", name=step).click()
    page.wait_for_timeout(1000)


def measure_page(device: Path) -> None:
    """Print delays from the pointer to the page, and the time of loading.

    Args:
        device: Folder of a copy of a device, whose poses are simulated.
    """
    with open_studio(device) as studio, open_chromium() as browser:
        _print_loading(browser, studio)
        page = open_page(browser, studio.url)
        print(f"{device.name} in Chromium, from the pointer to the page:")
        _print("dragged point to error", _drag_point(page))
        _print_pair("plane to section", *_move_plane(page))
        _print_pair("pose to shape", *_turn_region(page))


def measure_frames(device: Path, checkout: Path | None) -> None:
    """Print the frames per second while the camera turns.

    Args:
        device: Folder of a device with a body.
        checkout: Folder of other code, whose page is measured as well, or None.
    """
    for name, code in (("this page", ROOT), ("the other page", checkout)):
        if code is None:
            continue
        with open_studio(device, code) as studio, open_chromium() as browser:
            page = open_page(browser, studio.url)
            page.wait_for_timeout(3000)
            if code == ROOT:
                enter(page, "Body")
            rate, triangles, pixels = turn_camera(page)
        print(
            f"{device.name}, {name}: {rate:.1f} frames/s, {triangles:,.0f} triangles and"
            f" {pixels / 1e6:.2f} megapixels a frame (load {load_average():.1f})",
            flush=True,
        )


def turn_camera(page: Any) -> tuple[float, float, float]:
    """Turn the camera by the mouse; return frames per second, and medians of their size."""
    box = page.locator("canvas").first.bounding_box()
    x, y = box["x"] + 0.4 * box["width"], box["y"] + 0.85 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    for warm_up in (True, False):
        page.evaluate("() => (studioProbe.frames = [])")
        started_at = time.monotonic()
        duration = 2.0 if warm_up else _TURN_SECONDS
        while time.monotonic() - started_at < duration:
            turn = 2 * np.pi * (time.monotonic() - started_at) / 3
            page.mouse.move(x + 150 * np.sin(turn), y + 20 * np.sin(2 * turn))
            page.wait_for_timeout(5)
    frames = page.evaluate("() => studioProbe.frames")
    page.mouse.up()
    seconds = (frames[-1]["at"] - frames[0]["at"]) / 1e3
    triangles, pixels = (np.median([f[key] for f in frames]) for key in ("triangles", "size"))
    return (len(frames) - 1) / seconds, float(triangles), float(pixels)


def _print_loading(browser: Any, studio: Studio) -> None:
    context = browser.new_context(viewport=SIZE)
    context.add_init_script(PROBE)
    page = context.new_page()
    sizes: dict[str, tuple[float, float]] = {}

    def add(response: Any) -> None:
        content = response.body()
        name = response.url.rpartition("/")[2] or "index.html"
        sizes[name] = len(content) / 1e3, len(gzip.compress(content)) / 1e3

    page.on("response", add)
    times = []
    for _ in ("cold", "warm"):
        page.goto(studio.url)
        page.get_by_role("navigation", name="Steps").wait_for()
        times.append(wait_for_body(page))
    print(f"page loaded and body drawn: {times[0]:.2f} s, again {times[1]:.2f} s")
    for name, (raw, zipped) in sorted(sizes.items()):
        print(f"  {name:12} {raw:7.1f} kB, gzip {zipped:6.1f} kB")
    context.close()


def _drag_point(page: Any) -> np.ndarray:
    enter(page, "Sensors")
    page.locator('[role=treeitem][data-node^="cord:"]').first.click()
    handle = page.get_by_role("button", name="point 3 of").first
    _press(page, handle)
    page.evaluate("(selector) => watchText(selector)", _HEADLINE)
    delays = []
    for _ in _moves(page, handle):
        at = _wait_for(page, "(p, t) => p.texts.find((x) => x > t)")
        if at is not None:
            delays.append(at)
    page.mouse.up()
    return np.array(delays)


def _move_plane(page: Any) -> tuple[np.ndarray, np.ndarray]:
    """Move the plane by its arrow: coarse sections while it moves, a fine one at its release."""
    enter(page, "Inside")
    handle = page.get_by_role("button", name="Move the plane along its normal")
    coarse: list[float | None] = []
    fine: list[float | None] = []
    for _ in range(4):
        _press(page, handle)
        moves = _moves(page, handle, _DRAG_COUNT // 4)
        coarse += [_wait_for(page, _answer("kind === 'show-section'")) for _ in moves]
        page.mouse.up()
        fine.append(_wait_for(page, _answer("detail === 'fine'"), "releases"))
    return _known(coarse), _known(fine)


def _turn_region(page: Any) -> tuple[np.ndarray, np.ndarray]:
    enter(page, "Poses")
    page.locator('[role=treeitem][data-node^="pose:"]').first.click()
    handle = page.locator('.viewer-overlay [aria-label^="Turn"]').locator("visible=true").first
    page.wait_for_timeout(3000)
    coarse, fine = [], []
    _press(page, handle)
    for _ in _moves(page, handle, _DRAG_COUNT // 2):
        coarse.append(_wait_for(page, _answer("name === 'pose-shape'")))
        fine.append(_wait_for(page, _answer("phase === 'solved'")))
    page.mouse.up()
    return _known(coarse), _known(fine)


def _press(page: Any, handle: Any) -> None:
    page.mouse.move(*middle(handle))
    page.mouse.down()


def middle(handle: Any) -> tuple[float, float]:
    """Return the pixel in the middle of a button, or of a line."""
    x, y = handle.evaluate(_MIDDLE)
    return float(x), float(y)


def _moves(page: Any, handle: Any, count: int = _DRAG_COUNT) -> Iterator[int]:
    """Move the pointer a little up and down, and wait for the caller in between."""
    x, y = middle(handle)
    for k in range(count):
        shift = _STEP_PX * (1 + k % 4) * (-1) ** k
        page.mouse.move(x, y + shift)
        yield k
        page.wait_for_timeout(_PAUSE_MS)


def _answer(condition: str) -> str:
    """Return a function that finds the frame after an answer of the server."""
    return (
        "(p, t) => { const a = p.arrivals.find(({ at, name, kind, detail, phase }) =>"
        f" at > t && ({condition})); return a && p.frames.find((f) => f.at > a.at)?.at; }}"
    )


def _wait_for(page: Any, find: str, since: str = "pointers") -> float | None:
    """Return the time from the last event of the pointer to what a function finds, s."""
    script = (
        f"() => {{ const p = studioProbe, t = p.{since}.at(-1);"
        f" const found = ({find})(p, t); return found ? found - t : 0; }}"
    )
    deadline = time.monotonic() + _ANSWER_TIMEOUT_S
    while time.monotonic() < deadline:
        delay = page.evaluate(script)
        if delay:
            return float(delay) / 1e3
        page.wait_for_timeout(10)
    return None


def _known(delays: list[float | None]) -> np.ndarray:
    return np.array([delay for delay in delays if delay is not None])


def _print_pair(name: str, coarse: np.ndarray, fine: np.ndarray) -> None:
    _print(f"{name}, coarse", coarse)
    _print(f"{name}, fine", fine)


def _print(name: str, seconds: np.ndarray) -> None:
    if not len(seconds):
        print(f"  {name:24} no answer")
        return
    median, largest = np.percentile(1e3 * seconds, [50, 95])
    print(f"  {name:24} {median:7.0f} ms (95 %: {largest:.0f} ms; {len(seconds)} times;"
          f" load {load_average():.1f})", flush=True)  # fmt: skip
