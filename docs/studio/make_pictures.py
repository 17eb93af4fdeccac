"""Take the screenshots of the page on the studio, one for each step.

    python docs/studio/make_pictures.py FOLDER [NAME...]

The bar is created, built and trained in FOLDER, unless that was done before. A Chromium must
be installed; it renders by the CPU.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image, ImageOps
from playwright.sync_api import sync_playwright

HERE = Path(__file__).parent
DEVICE = "my-bar"
MADE = {  # what is there once a command has been run
    f"{DEVICE}/device.toml": ("new", DEVICE, "--body", "bar"),
    f"{DEVICE}/build/guide.html": ("build", DEVICE),
    f"{DEVICE}/model.json": ("train", "--device", DEVICE),
}
SIZE = {"width": 1100, "height": 640}
MAX_BYTES = 145_000
PORT = 8124
WAIT_MS, SETTLED_MS = 300_000, 8_000


def defsense(*words):
    """Return the command line of a `defsense` command."""
    return [sys.executable, "-m", "defsense_fab.cli.main", *words]


@contextmanager
def studio_of(folder, name):
    """Yield the address of the studio of a device's folder."""
    words = ("studio", name, "--port", str(PORT), "--no-browser", "--trust")
    settings = {"DEFSENSE_CONFIG": str((folder / "settings").resolve())}  # no recent devices
    with subprocess.Popen(
        defsense(*words),
        cwd=folder,
        env=os.environ | settings,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as running:
        try:
            while str(PORT) not in (line := running.stdout.readline()):
                if not line:
                    sys.exit("the studio showed no page")
            yield f"http://localhost:{PORT}"
        finally:
            running.terminate()


def enter(page, step):
    """Enter a step, and wait until its scene is drawn."""
    steps = page.get_by_role("navigation", name="Steps")
    steps.get_by_role("button", name=step).click(timeout=WAIT_MS)
    page.wait_for_timeout(SETTLED_MS)


def select_pose(page):
    """Select a pose, which shows its regions and the deformed body."""
    enter(page, "Poses")
    page.get_by_role("group", name="States").get_by_role("button", name="bend_up").click()


def cut_body(page):
    """Cut the body across the axis that it is bent about."""
    enter(page, "Inside")
    page.keyboard.press("y")


def select_cord(page):
    """Select a cord, which shows its control points."""
    enter(page, "Sensors")
    page.get_by_role("treeitem", name="B", exact=True).click()


def open_joints(page):
    """Draw the parts apart."""
    enter(page, "Make")
    slider = page.get_by_role("slider").first
    slider.focus()
    slider.press("End")


def run_live(page):
    """Run the model on the simulated twin, and bend it by its first pose."""
    enter(page, "Measure")
    page.locator(".outline-item").filter(has_text="Live").click()
    page.get_by_role("button", name="Start", exact=True).click()
    slider = page.get_by_role("slider", name="Bend by bend_up")
    slider.wait_for(timeout=WAIT_MS)
    page.wait_for_timeout(SETTLED_MS)  # the resistances at rest are measured
    slider.press("End")


STEPS = {
    "body": lambda page: enter(page, "Body"),
    "poses": select_pose,
    "inside": cut_body,
    "sensors": select_cord,
    "optimize": lambda page: enter(page, "Optimize"),
    "make": open_joints,
    "measure": run_live,
}


def save(page, name):
    """Save a screenshot as a PNG, with coarser colors if it would be large."""
    page.wait_for_timeout(SETTLED_MS)
    file = HERE / f"{name}.png"
    image = Image.open(BytesIO(page.screenshot(timeout=WAIT_MS))).convert("RGB")
    for bits in (8, 7, 6, 5):
        ImageOps.posterize(image, bits).save(file, optimize=True)
        if file.stat().st_size < MAX_BYTES:
            break


def main():
    """Run missing commands and take the screenshots."""
    sys.path.append(str(HERE.parent))
    from picture_tools import make_missing, open_chromium

    folder, *names = sys.argv[1:]
    folder = make_missing(folder, MADE)
    with sync_playwright() as playwright:
        browser = open_chromium(playwright)
        for name in names or ("start", *STEPS):
            page = browser.new_page(viewport=SIZE)
            with studio_of(folder, "new" if name == "start" else DEVICE) as url:
                page.goto(url, timeout=WAIT_MS)
                if name == "start":
                    page.get_by_role("button", name="Choose a file").wait_for(timeout=WAIT_MS)
                else:
                    page.get_by_role("button", name="Not now").click(timeout=WAIT_MS)
                    STEPS[name](page)
                save(page, name)
            page.close()
        browser.close()


if __name__ == "__main__":
    main()
