"""Takes the pictures of the first page: `python docs/guide/make_pictures.py FOLDER`.

FOLDER is where the page's commands were typed; what is missing there is made first. A Chromium must
be installed; its windows are drawn by the processor.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

HERE = Path(__file__).parent
DEVICE, SESSION, MODEL = "my-device", "session", "my-device/model.json"
MADE = {  # what is there once a command has been typed
    "my-device/device.toml": ("new", DEVICE, "--body", "twist-bar"),
    "my-device/build/guide.html": ("build", DEVICE),
    "session/session.json": ("twin", DEVICE, "--minutes", "1.5", "--out", SESSION),
    MODEL: ("train", SESSION, "--device", DEVICE),
}
SIZE = {"width": 1100, "height": 640}
COLORS = 96
PORT = 8123


def defsense(*words):
    """The command, as a process is started."""
    return [sys.executable, "-m", "defsense_fab.cli.main", *words]


@contextmanager
def page_of(folder, *words):
    """A page that a command shows, while it is needed."""
    with subprocess.Popen(
        defsense(*words), cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    ) as running:
        try:
            while (line := running.stdout.readline()) and str(PORT) not in line:
                pass
            yield f"http://localhost:{PORT}"
        finally:
            running.terminate()


def save(shot, name):
    """As a PNG of few colours."""
    image = Image.open(BytesIO(shot)).convert("RGB")
    image.quantize(COLORS, dither=Image.Dither.NONE).save(HERE / f"{name}.png", optimize=True)


def take(browser, folder):
    """All pictures."""
    page = browser.new_page(viewport=SIZE)
    page.goto((folder / DEVICE / "build/report.html").absolute().as_uri())
    page.wait_for_timeout(8000)
    save(page.screenshot(), "report")
    page.goto((folder / DEVICE / "build/guide.html").absolute().as_uri())
    page.wait_for_timeout(8000)
    save(page.screenshot(), "assembly")
    with page_of(folder, "studio", DEVICE, "--port", str(PORT), "--no-browser", "--trust") as url:
        page.goto(url)
        page.wait_for_timeout(30_000)
        save(page.screenshot(), "studio")
    live = ("run", MODEL, "--port", "twin", "--view", str(PORT), "--no-browser")
    with page_of(folder, *live) as url:
        page.goto(url)
        page.wait_for_timeout(30_000)
        save(page.screenshot(), "live")


def main():
    """See above."""
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    for made, words in MADE.items():
        if not (folder / made).exists():
            subprocess.run(defsense(*words), cwd=folder, check=True)
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    switches = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    switches += ["--no-sandbox"] if os.geteuid() == 0 else []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=switches)
        take(browser, folder)
        browser.close()


if __name__ == "__main__":
    main()
