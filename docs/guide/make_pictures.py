"""Take the screenshots of the first page of the documentation.

    python docs/guide/make_pictures.py FOLDER [NAME...]

FOLDER is the folder in which the commands of the page were run; missing results are computed first.
A Chromium must be installed; it renders by the CPU.
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

HERE = Path(__file__).parent
DEVICE, MODEL = "my-joystick", "my-joystick/model.json"
MADE = {  # what is there once a command has been typed
    f"{DEVICE}/device.toml": ("new", DEVICE, "--body", "joystick"),
    f"{DEVICE}/build/guide.html": ("build", DEVICE),
    MODEL: ("train", "--device", DEVICE),
}
SIZE = {"width": 1100, "height": 640}
COLORS = 256
PORT = 8123
WAIT, SETTLED = 300_000, 12_000  # ms


def defsense(*words):
    """Return the command line of a `defsense` command."""
    return [sys.executable, "-m", "defsense_fab.cli.main", *words]


@contextmanager
def page_of(folder, *words):
    """Yield the address of the page of a running command."""
    with subprocess.Popen(
        defsense(*words), cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    ) as running:
        try:
            while str(PORT) not in (line := running.stdout.readline()):
                if not line:
                    sys.exit(f"defsense {' '.join(words)} showed no page")
            yield f"http://localhost:{PORT}"
        finally:
            running.terminate()


def save(page, name):
    """Save a screenshot as a PNG with few colors."""
    image = Image.open(BytesIO(page.screenshot(timeout=WAIT))).convert("RGB")
    method = Image.Quantize.MAXCOVERAGE
    image.quantize(COLORS, method, dither=Image.Dither.NONE).save(
        HERE / f"{name}.png", optimize=True
    )


def open_joints(page):
    """Draw the parts of a 3D view apart."""
    page.locator("[data-open]").first.evaluate(
        "it => { it.value = it.max; it.dispatchEvent(new Event('input')); }"
    )
    page.locator("[data-ready]").first.evaluate("view => view.scrollIntoView()")
    page.wait_for_timeout(SETTLED)


def report(page, folder):
    """Take the top of the report: what the device takes, and its expected error."""
    page.set_viewport_size(SIZE | {"height": 760})
    page.goto((folder / DEVICE / "build/report.html").absolute().as_uri())
    page.locator("[data-ready]").first.wait_for(timeout=WAIT)
    save(page, "report")


def assembly(page, folder):
    """Take the exploded view of the assembly guide."""
    page.goto((folder / DEVICE / "build/guide.html").absolute().as_uri())
    page.locator("[data-ready]").first.wait_for(timeout=WAIT)
    open_joints(page)
    save(page, "assembly")


def studio(page, folder):
    """Take the studio with the strain inside the bent body."""
    with page_of(folder, "studio", DEVICE, "--port", str(PORT), "--no-browser", "--trust") as url:
        page.goto(url, timeout=WAIT)
        page.get_by_role("button", name="Not now").click(timeout=WAIT)
        steps = page.get_by_role("navigation", name="Steps")
        steps.get_by_role("button", name="Inside").click(timeout=WAIT)
        page.wait_for_timeout(SETTLED)
        save(page, "studio")


def live(page, folder):
    """Take the page of a run whose twin moves automatically."""
    words = ("run", MODEL, "--device", DEVICE, "--port", "twin")
    with page_of(folder, *words, "--view", str(PORT), "--no-browser") as url:
        page.goto(url, timeout=WAIT)
        page.get_by_text("trusted").first.wait_for(timeout=WAIT)
        page.wait_for_timeout(SETTLED)
        save(page, "live")


PICTURES = {"report": report, "assembly": assembly, "studio": studio, "live": live}


def main():
    """Run missing commands and take the screenshots."""
    sys.path.append(str(HERE.parent))
    from picture_tools import make_missing, open_chromium

    folder, *names = sys.argv[1:]
    folder = make_missing(folder, MADE)
    with sync_playwright() as playwright:
        for name in names or PICTURES:
            browser = open_chromium(playwright)
            PICTURES[name](browser.new_page(viewport=SIZE), folder)
            browser.close()


if __name__ == "__main__":
    main()
