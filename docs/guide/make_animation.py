"""Write the animation of the first page: a twin is bent, and the live model follows.

    python docs/guide/make_animation.py FOLDER [FRAME...]

A bar is built, recorded and trained in FOLDER, unless that was done before. A live run then
decodes the signals of its twin, which moves through a sequence of poses. FRAME are numbers of
frames to save in FOLDER as PNG files, to check them.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pyvista as pv
from PIL import Image

from defsense_fab.core.mesh import Surface
from defsense_fab.report.pictures.scene import Scene
from defsense_fab.report.pictures.sheet import INK, SOFT, Sheet, extent
from defsense_fab.report.pictures.views import looking
from defsense_fab.runtime.view.live_place import LivePlace
from defsense_fab.runtime.view.viewed_device import carried_cords
from defsense_fab.studio.session.cord_colors import CORD_COLORS
from defsense_fab.workflow.run.live_device import live_device
from defsense_fab.workflow.run.run import prepare_run

HERE = Path(__file__).parent
DEVICE, MODEL = "my-bar", "my-bar/model.json"
MADE = {  # what is there once a command has been run
    f"{DEVICE}/device.toml": ("new", DEVICE, "--body", "bar"),
    f"{DEVICE}/build/guide.html": ("build", DEVICE),
    "session": ("twin", DEVICE, "--minutes", "6", "--out", "session"),
    MODEL: ("train", "session", "--device", DEVICE),
}
SECONDS, FRAME_RATE_HZ = 20.0, 12.5
REST_S = 8.0  # before the sequence, in which the resistances at rest are measured
REST_TAKEN_S = 1.0  # before the sequence, when the present readings are taken as those at rest
#: Time, levels of the poses, and the name of the movement that ends at this time.
KEYFRAMES = (
    (0.0, {}, ""),
    (1.0, {}, "rest"),
    (2.8, {"bend_up": 1.0}, "bend up"),
    (3.6, {"bend_up": 1.0}, "bend up"),
    (5.2, {}, "bend up"),
    (6.8, {"bend_down": 1.0}, "bend down"),
    (7.4, {"bend_down": 1.0}, "bend down"),
    (9.0, {}, "bend down"),
    (10.8, {"twist": 1.0}, "twist"),
    (11.6, {"twist": 1.0}, "twist"),
    (13.2, {}, "twist"),
    (15.0, {"bend_up": 0.5, "twist": 0.5}, "bend up and twist"),
    (16.6, {"bend_down": 0.5, "twist": 0.5}, "bend down and twist"),
    (18.4, {}, "back to rest"),
    (20.0, {}, "rest"),
)
WIDTH, HEIGHT = 720, 448  # pixels
PANEL = (344, 190)  # largest size of a body, pixels
PLOT = (64, 312, 628, 104)  # left, top, width, height, pixels
TITLE, LABEL = 18, 15  # font sizes, pixels
VIEW = looking(np.array([0.5, -1.0, 0.4]), np.array([0, 0, 1.0]))
TRUE_COLOR, MODEL_COLOR, GRID_COLOR = "#b9a58e", "#9db4c0", "#d5dce0"
TICK_STEP = 5  # % of the resistance
MAX_BRIGHTNESS = 250  # of 255; brighter colors are made white
COLORS, PALETTE_FRAMES = 224, 25  # few colors make lossless pictures small


@dataclass
class Moment:
    """What is shown at one time: the signals (c,), and the true and the decoded surface (v, 3)."""

    time: float
    signals: np.ndarray
    true: np.ndarray
    decoded: np.ndarray
    quality: str


class Stage(LivePlace):
    """A place for a live run that keeps its frames instead of showing them in a browser."""

    def __init__(self):
        self.moments = []

    def open(self, device, actions):
        """Keep the device and its actions."""
        self.device, self.actions = device, actions

    def send(self, frame):
        """Keep a frame, with the true shape of the twin at this time."""
        if frame.vertices is not None:
            shape = self.actions.shape()
            quality = str(frame.quality)
            self.moments.append(
                Moment(frame.arrived, frame.signals, shape, frame.vertices, quality)
            )

    def close(self):
        """Release no resources."""


def levels_at(seconds):
    """Return the levels of the poses at a time of the sequence."""
    times = np.array([at for at, _, _ in KEYFRAMES])
    k = int(np.clip(np.searchsorted(times, seconds, side="right") - 1, 0, len(times) - 2))
    share = np.clip((seconds - times[k]) / (times[k + 1] - times[k]), 0, 1)
    share = share * share * (3 - 2 * share)
    first, last = KEYFRAMES[k][1], KEYFRAMES[k + 1][1]
    names = {*first, *last}
    return {n: (1 - share) * first.get(n, 0.0) + share * last.get(n, 0.0) for n in names}


def movement_at(seconds):
    """Return the name of the movement at a time of the sequence."""
    return next((name for at, _, name in KEYFRAMES[1:] if seconds <= at), "rest")


def run_twin(folder):
    """Return the device of a live run of the twin, and its moments in the sequence."""
    stage = Stage()
    run = prepare_run(live_device(folder / MODEL), "twin", view=stage, keeps_readings=False)
    run.loop.start()
    started_at = time.monotonic() + REST_S
    is_rest_taken = False
    try:
        while (now := time.monotonic() - started_at) < SECONDS + 0.2:
            stage.actions.bend(levels_at(now))
            if now > -REST_TAKEN_S and not is_rest_taken:
                is_rest_taken = True
                stage.actions.rest()
            if not run.loop.wait(0.01):
                sys.exit("the run has ended early")
    finally:
        run.close()
    for moment in stage.moments:
        moment.time -= started_at
    return stage.device, [m for m in stage.moments if m.time >= -0.1]


def body_scene(surface, corners, color, cords, radius, opacity):
    """Return a scene of a body and its cords, with room for `corners` (4, 3) mm."""
    scene = Scene()
    scene.mesh(pv.PolyData(corners), corners, opacity=0.0)
    scene.solid(surface, color, opacity=opacity)
    for path, cord_color in zip(cords, CORD_COLORS, strict=False):
        scene.tube(path, cord_color, radius)
    return scene


class Painter:
    """Draws the frames of the animation from the moments of a run."""

    def __init__(self, device, moments):
        self.device, self.moments = device, moments
        self.times = np.array([m.time for m in moments])
        self.percent = 100 * np.array([m.signals for m in moments])
        self.cords = carried_cords(device)
        points = np.concatenate([m.true for m in moments] + [m.decoded for m in moments])
        flat = VIEW.flat(points)
        self.corners = points[[*flat.argmin(0), *flat.argmax(0)]]
        reach = np.nanmax(np.abs(self.percent))
        self.top = TICK_STEP * np.ceil(1.02 * reach / TICK_STEP)

    def body(self, vertices, color, opacity, has_cords):
        """Return an image of the surface, the same size for all shapes."""
        moved = vertices - self.device.vertices
        paths = [points + weights @ moved for points, weights in self.cords] if has_cords else []
        surface = Surface(vertices, self.device.faces)
        with body_scene(
            surface, self.corners, color, paths, 1.2 * self.device.cord_radius, opacity
        ) as scene:
            return scene.shot(VIEW, *PANEL).image

    def plot(self, sheet, last):
        """Draw the signals up to a moment."""
        left, top, width, height = PLOT

        def place(seconds, percent):
            return left + width * seconds / SECONDS, top + height * (0.5 - percent / self.top / 2)

        for tick in (-self.top, 0, self.top):
            ends = [place(0, tick), place(SECONDS, tick)]
            sheet.line(ends, GRID_COLOR, 1.0)
            sheet.text((left - 8, ends[0][1]), f"{tick:+.0f} %" if tick else "0", LABEL, SOFT, "rm")
        for seconds in range(0, int(SECONDS) + 1, 5):
            x, y = place(seconds, -self.top)
            sheet.text((x, y + 8), f"{seconds} s" if seconds else "0", LABEL, SOFT, "mt")
        for k, color in zip(range(len(self.cords)), CORD_COLORS, strict=False):
            points = zip(self.times.clip(0), self.percent[:, k], strict=True)
            line = [place(*p) for p in points][: last + 1]
            if len(line) > 1:
                sheet.line(line, color, 2.4)
            if line:
                sheet.dot(line[-1], color, 4.5)

    def legend(self, sheet):
        """Write what the plot shows, with a dot in the color of each cord."""
        y = PLOT[1] - 20
        sheet.text((12, y), "Change of resistance of each cord", TITLE, INK, "lm", bold=True)
        x = WIDTH - 16
        for name, color in reversed(list(zip(self.device.channels, CORD_COLORS, strict=False))):
            sheet.text((x, y), name, LABEL, INK, "rm")
            x -= extent(name, LABEL)[0] + 10
            sheet.dot((x, y), color, 5)
            x -= 22

    def frame(self, seconds):
        """Return the picture at a time of the sequence."""
        last = int(np.clip(np.searchsorted(self.times, seconds), 1, len(self.times) - 1))
        before, after = self.moments[last - 1], self.moments[last]
        share = np.clip((seconds - before.time) / (after.time - before.time), 0, 1)
        true = (1 - share) * before.true + share * after.true
        decoded = (1 - share) * before.decoded + share * after.decoded
        sheet = Sheet(WIDTH, HEIGHT)
        for k, (title, words) in enumerate(
            (
                ("Body", "simulated, as if bent by hand"),
                ("Live model", "decoded from the cords alone"),
            )
        ):
            x = 12 + k * WIDTH / 2
            sheet.text((x, 18), title, TITLE, INK, "lm", bold=True)
            sheet.text((x, 40), words, LABEL, SOFT, "lm")
        bodies = (
            self.body(true, TRUE_COLOR, 1.0, has_cords=False),
            self.body(decoded, MODEL_COLOR, 0.35, has_cords=True),
        )
        for k, image in enumerate(bodies):
            h, w = image.shape[:2]
            sheet.paste(image, (WIDTH / 4 + k * WIDTH / 2 - w / 2, 58 + (PANEL[1] - h) / 2))
        sheet.text((WIDTH / 2, 262), movement_at(seconds), TITLE, "#00798c", "mm", bold=True)
        self.legend(sheet)
        self.plot(sheet, last)
        return Image.open(BytesIO(sheet.png())).convert("RGB")


def write_webp(file, frames):
    """Write an animation without loss, in the colors that its frames have in common."""
    shown = frames[:: len(frames) // PALETTE_FRAMES]
    sheet = Image.new("RGB", (WIDTH, HEIGHT * len(shown)))
    for k, frame in enumerate(shown):
        sheet.paste(frame, (0, HEIGHT * k))
    palette = sheet.quantize(COLORS, dither=Image.Dither.NONE)
    values = np.array(palette.getpalette()).reshape(-1, 3)
    values[values.min(axis=1) > MAX_BRIGHTNESS] = 255
    palette.putpalette(values.ravel().tolist())
    reduced = [f.quantize(palette=palette, dither=Image.Dither.NONE).convert("RGB") for f in frames]
    first, *others = reduced
    first.save(
        file,
        save_all=True,
        append_images=others,
        duration=round(1000 / FRAME_RATE_HZ),
        loop=0,
        lossless=True,
        quality=80,
        method=4,
    )


def main():
    """Run missing commands, then the twin, and write the animation."""
    sys.path.append(str(HERE.parent))
    from picture_tools import make_missing

    folder, *chosen = sys.argv[1:]
    folder = make_missing(folder, MADE)
    painter = Painter(*run_twin(folder))
    times = np.arange(0, SECONDS, 1 / FRAME_RATE_HZ)
    frames = [painter.frame(seconds) for seconds in times]
    for number in map(int, chosen):
        frames[number].save(folder / f"frame-{number}.png")
    file = HERE / "animation.webp"
    write_webp(file, frames)
    errors = [np.sqrt(((m.true - m.decoded) ** 2).sum(1).mean()) for m in painter.moments]
    qualities = {m.quality for m in painter.moments}
    sys.stdout.write(
        f"{file}: {file.stat().st_size / 1e6:.2f} MB; {len(painter.moments)} surfaces; RMSE"
        f" {np.mean(errors):.2f} mm, at most {np.max(errors):.2f} mm; {qualities}\n"
    )


if __name__ == "__main__":
    main()
