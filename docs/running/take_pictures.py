"""Take the pictures of the pages on training and running: prints, screens, reports and cameras.

    python docs/running/take_pictures.py FOLDER [NAME...]

FOLDER is the folder in which the commands of these pages are run; missing results are computed
first, which takes about half an hour. A Chromium must be installed; it renders by the CPU.
"""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
from contextlib import chdir
from io import BytesIO, StringIO
from pathlib import Path

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")  # works without a screen

import numpy as np
import pypdfium2
from PIL import Image
from playwright.sync_api import sync_playwright
from rich.console import Console
from rich.terminal_theme import SVG_EXPORT_THEME

from defsense_fab.cli.terminal.guided_screen import pages
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.guided_parts import Picture
from defsense_fab.core.mesh import Surface
from defsense_fab.report.pictures.scene import Scene
from defsense_fab.report.pictures.views import looking
from defsense_fab.workflow.sessions.options import RecordOptions
from defsense_fab.workflow.sessions.recording import record_session

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "guide"))
from make_pictures import PORT, WAIT, defsense, page_of  # noqa: E402

DEVICE, BAR = "my-joystick", "my-device"
MODEL = f"{DEVICE}/model.json"
REHEARSAL = ("--board", "my-cameras", "--calibration", "rehearsal.toml")
OWN = ("--signals", "own/walk.csv", "--targets", "own/lean.csv")
MADE = {  # what is there once a command has been typed
    f"{DEVICE}/device.toml": ("new", DEVICE, "--body", "joystick"),
    f"{DEVICE}/build/guide.html": ("build", DEVICE),
    "session/quality.json": ("twin", DEVICE, "--minutes", "4", "--out", "session"),
    MODEL: ("train", "session", "--device", DEVICE),
    f"{DEVICE}/evaluation/evaluation.html": ("evaluate", MODEL, "session", "--device", DEVICE),
    f"{BAR}/device.toml": ("new", BAR, "--body", "twist-bar"),
    f"{BAR}/build/guide.html": ("build", BAR),
    f"{BAR}/markers/markers.pdf": (
        "capture", "markers", BAR, "--count", "6", "--side", "0,-1,1",
    ),
    "my-cameras/board.pdf": ("capture", "board", "my-cameras"),
    "rehearsal.html": ("capture", "camera", "calibrate", "twin", *REHEARSAL),
    "filmed/report.html": (
        "twin", BAR, "--minutes", "0.7", "--cameras", "webcam", "--out", "filmed",
    ),
    "bend.npz": (
        "run", MODEL, "--port", "twin", "--seconds", "25", "--animation", "bend.npz", "--no-record",
    ),
}  # fmt: skip
POSE_STEP, POSE_PROGRESS = 1, 0.7  # when the screen of the recording is taken
COLORS = 256
WIDTH = 1000  # pixels
RECORDED = RecordOptions(rounds=1, seconds=10.0, free=2.0, rest=4.0, out=Path("recorded"))


def save(image, name, colors=COLORS):
    """Save an image as a PNG with few colors."""
    method = Image.Quantize.MAXCOVERAGE
    reduced = image.convert("RGB").quantize(colors, method, dither=Image.Dither.NONE)
    reduced.save(HERE / f"{name}.png", optimize=True)


def screenshot(page, name, height=None, colors=COLORS):
    """Save the page, or its top."""
    clip = None if height is None else {"x": 0, "y": 0, "width": WIDTH, "height": height}
    image = Image.open(
        BytesIO(page.screenshot(timeout=WAIT, clip=clip, full_page=clip is not None))
    )
    save(image, name, colors)


def figure(page, path, name, width):
    """Save a figure of an evaluation with a width in pixels."""
    svg = path.read_text(encoding="utf-8")
    page.set_viewport_size({"width": width, "height": 400})
    page.set_content(
        f"<body style='margin:0'>{svg[svg.index('<svg') :]}</body>"
        "<style>svg{width:100%;height:auto;display:block}</style>"
    )
    save(Image.open(BytesIO(page.locator("svg").first.screenshot(timeout=WAIT))), name, 64)


def pdf_page(path, number, width):
    """Return a page of a PDF as an image."""
    document = pypdfium2.PdfDocument(path)
    sheet = document[number]
    return sheet.render(scale=width / sheet.get_width()).to_pil()


def sheets(_page, folder):
    """Draw the sheet of tags and the board, next to each other."""
    board = pdf_page(folder / "my-cameras/board.pdf", 0, 650)
    tags = pdf_page(folder / BAR / "markers/markers.pdf", 0, 650 / 2)
    image = Image.new("RGB", (WIDTH, board.height + 16), "#8a97a3")
    image.paste(tags, (8, 8))
    image.paste(board, (tags.width + 16, 8))
    save(image, "sheets", 32)


def tag_places(_page, folder):
    """Draw the first picture of the places of tags."""
    sheet = pdf_page(folder / BAR / "markers/markers.pdf", 1, 1400)
    dark = np.asarray(sheet.convert("L")) < 250
    rows = np.flatnonzero(dark.any(axis=1))
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 8) + 1)
    first, last = max(parts, key=len)[[0, -1]]
    columns = np.flatnonzero(dark[first:last].any(axis=0))
    box = (columns[0] - 10, first - 10, columns[-1] + 10, last + 10)
    image = sheet.crop(tuple(map(int, box)))
    save(image.resize((900, round(900 * image.height / image.width))), "tag-places", 64)


def cameras(page, folder):
    """Take the report of a calibration."""
    page.set_viewport_size({"width": WIDTH, "height": 860})
    page.goto((folder / "rehearsal.html").absolute().as_uri())
    screenshot(page, "cameras", 770, 64)


class ViewTaker:
    """A screen that keeps the state of a recording in the middle of a step."""

    def __init__(self):
        self.view, self.pictures = None, []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def key(self, timeout):
        """Press no key."""
        import time

        time.sleep(timeout)

    def show(self, view):
        """Keep the last state of a pose's step in which all cameras gave an image."""
        is_pose = view.state.phase == "active" and view.state.step == POSE_STEP
        pictures = [part for part in view.parts if isinstance(part, Picture)]
        is_complete = all(p.image is not None for p in pictures)
        is_better = self.view is None or len(view.notes) <= len(self.view.notes)
        if is_pose and view.progress < POSE_PROGRESS and is_complete and is_better:
            self.view, self.pictures = view, pictures


def recording(page, folder):
    """Record the twist bar before simulated cameras, and take the screen and the cameras."""
    taker = ViewTaker()
    shutil.rmtree(folder / "recorded", ignore_errors=True)
    with chdir(folder):
        device = load_device(Path(BAR))
        record_session(
            device, ("twin:webcam,seed=1,cameras=2",), "twin", RECORDED,
            open_screen=lambda _: taker, auto=True,
        )  # fmt: skip
    console = Console(record=True, width=118, file=StringIO(), color_system="truecolor")
    console.print(next(pages(taker.view, console.width)))
    html = console.export_html(theme=SVG_EXPORT_THEME, inline_styles=True)
    style = (
        "<style>body{margin:12px!important}pre{font:14px/1.12 'DejaVu Sans Mono'!important}</style>"
    )
    page.set_viewport_size({"width": WIDTH, "height": 720})
    page.set_content(html.replace("</head>", style + "</head>"))
    pre = page.locator("pre").bounding_box()
    screenshot(page, "record", min(pre["height"] + 24, 900))
    images = [Image.fromarray(picture.image).convert("RGB") for picture in taker.pictures]
    wide = Image.new("RGB", (WIDTH, round(496 * images[0].height / images[0].width)), "white")
    for k, image in enumerate(images):
        wide.paste(image.resize((496, wide.height)), (504 * k, 0))
    save(wide, "twin-cameras", 128)
    save(
        images[0].resize((700, round(700 * images[0].height / images[0].width))), "twin-camera", 96
    )


def session(page, folder):
    """Take the report of a session that was filmed by simulated cameras."""
    page.set_viewport_size({"width": WIDTH, "height": 900})
    page.goto((folder / "filmed/report.html").absolute().as_uri())
    page.locator("img").nth(1).scroll_into_view_if_needed()
    screenshot(page, "session", 850, 96)


def evaluation(page, folder):
    """Take the top of an evaluation, and its figure of paths."""
    page.set_viewport_size({"width": WIDTH, "height": 900})
    page.goto((folder / DEVICE / "evaluation/evaluation.html").absolute().as_uri())
    screenshot(page, "evaluation", 900)
    figure(page, folder / DEVICE / "evaluation/paths.svg", "predicted", 820)


def own_sensor(page, folder):
    """Train a sensor on two tables, and take the figure of its values."""
    if not (folder / "own.json").exists():
        write_tables(folder)
        subprocess.run(defsense("train", *OWN, "--out", "own.json"), cwd=folder, check=True)
    done = folder / "own-evaluation"
    if not done.exists():
        words = ("evaluate", "own.json", *OWN, "--out", "own-evaluation")
        subprocess.run(defsense(*words), cwd=folder, check=True)
    figure(page, done / "values.svg", "own-sensor", 820)


def write_tables(folder):
    """Write the twin's resistances, and the angle of the stick, as tables."""
    (folder / "own").mkdir(exist_ok=True)
    with (folder / "session/samples.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name.endswith("_ohm")]
    with (folder / "own/walk.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *names])
        writer.writerows([row["time"], *(row[name] for name in names)] for row in rows)
    truth = np.load(folder / "session/truth.npz")
    poses = [str(name) for name in truth["poses"]]
    weights = dict(zip(poses, truth["weights"].T, strict=True))
    lean = 25 * (weights["lean_right"] - weights["lean_left"])
    with (folder / "own/lean.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "lean_deg"])
        every = slice(None, None, 3)
        pairs = zip(truth["sample_time"][every], lean[every], strict=True)
        writer.writerows((f"{t:.4f}", f"{angle:.3f}") for t, angle in pairs)


def fallback(page, folder):
    """Take the page of a run whose cord is cut."""
    name = load_device(folder / DEVICE).sensors[0].name
    port = f"twin:unit=1,seed=7,cut={name}@3-300"
    words = ("run", MODEL, "--device", DEVICE, "--port", port, "--no-record")
    page.set_viewport_size({"width": 1100, "height": 640})
    with page_of(folder, *words, "--view", str(PORT), "--no-browser") as url:
        page.goto(url, timeout=WAIT)
        page.get_by_text("fallback").first.wait_for(timeout=WAIT)
        page.wait_for_timeout(6000)
        screenshot(page, "fallback")


def websocket(page, folder):
    """Take the page of the WebSocket output."""
    words = ("run", MODEL, "--device", DEVICE, "--port", "twin", "--no-record")
    page.set_viewport_size({"width": WIDTH, "height": 545})
    with page_of(folder, *words, "--output", f"websocket,port={PORT}") as url:
        page.goto(url, timeout=WAIT)
        page.wait_for_timeout(9000)
        screenshot(page, "websocket")


def animation(_page, folder):
    """Draw frames of a recorded animation next to each other."""
    recorded = np.load(folder / "bend.npz")
    rest, positions, faces = (recorded[name] for name in ("rest", "positions", "faces"))
    moved = np.linalg.norm(positions - rest, axis=2).max(axis=1)
    frames, order = [], np.argsort(-moved)
    for k in order:  # the shapes that differ most
        shape = positions[k]
        if all(np.linalg.norm(shape - positions[f], axis=1).max() > 12 for f in frames):
            frames.append(int(k))
        if len(frames) == 4:
            break
    view = looking(np.array([0.5, -1.0, 0.45]), np.array([0, 0, 1.0]))
    images = []
    for shape in [rest, *(positions[f] for f in sorted(frames))]:
        with Scene() as scene:
            scene.solid(Surface(np.asarray(shape, float), faces), "#7fa6c9", edges=False)
            shot = scene.shot(view, 190, 330)
        images.append((Image.fromarray(shot.image), shot.scale))
    scale = min(s for _, s in images)
    image = Image.new("RGB", (WIDTH, 340), "white")
    for k, (picture, own) in enumerate(images):
        size = [round(n * scale / own) for n in picture.size]
        place = (200 * k + (200 - size[0]) // 2, 335 - size[1])
        image.paste(picture.resize(size), place)
    save(image, "animation", 64)


PICTURES = {
    "sheets": sheets,
    "tag-places": tag_places,
    "cameras": cameras,
    "recording": recording,
    "session": session,
    "evaluation": evaluation,
    "own-sensor": own_sensor,
    "fallback": fallback,
    "websocket": websocket,
    "animation": animation,
}


def main():
    """Run missing commands and take the pictures."""
    sys.path.append(str(HERE.parent))
    from picture_tools import make_missing, open_chromium

    folder, *names = sys.argv[1:]
    folder = make_missing(folder, MADE)
    with sync_playwright() as playwright:
        for name in names or PICTURES:
            browser = open_chromium(playwright)
            PICTURES[name](browser.new_page(viewport={"width": WIDTH, "height": 700}), folder)
            browser.close()


if __name__ == "__main__":
    main()
