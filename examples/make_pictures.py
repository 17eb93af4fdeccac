"""Writes picture.png of examples that are built: the body with its cords at rest and in its poses.

    python examples/make_pictures.py examples/organ-pipe examples/character
    python examples/make_pictures.py examples/sheet --also "1*left+1*right"

or, of devices that were built by `defsense reproduce`:

    python examples/make_pictures.py reproduced/sheet/four --out examples/sheet
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.mesh import Surface
from defsense_fab.core.device.build_folder import build_folder
from defsense_fab.store.fields import load_fields
from defsense_fab.report.colors import COLORS
from defsense_fab.report.pictures.scene import poly, Scene
from defsense_fab.report.pictures.views import looking
from defsense_fab.twin.devices.simulated_device import load_simulated_device

VIEW = looking(np.array([0.45, -1.0, 0.55]), np.array([0, 0, 1.0]))
COLUMNS, SMOOTH = 5, 2
WIDTH, GAP, TEXT = 1100, 12, 16  # pixels


def picture(folder, also=()):
    """Rest, each pose at its full amplitude, and other states by name, all at one scale."""
    device = load_device(folder)
    found = load_simulated_device(device, np.zeros((0, 3)))
    states = [("at rest", None)] + [(r.name.replace("_", " "), r.states[-1]) for r in found.ramps]
    names = load_fields(build_folder(device)).names
    states += [(s.replace("1*", "").replace("+", " and "), names.index(s)) for s in also]
    columns = min(len(states), COLUMNS)
    size = (WIDTH - GAP * (columns + 1)) // columns
    shots = [shot(found, state, device.cord.diameter / 2, size) for _, state in states]
    scale = min(s.scale for s in shots) / SMOOTH
    images = []
    for s in shots:
        image = Image.fromarray(s.image)
        w, h = (max(round(n * scale / s.scale), 1) for n in s.size)
        images.append(image.resize((w, h), Image.Resampling.LANCZOS))
    height = max(i.height for i in images)
    rows = -(-len(states) // columns)
    out = Image.new("RGB", (WIDTH, rows * (height + TEXT + 2 * GAP)), (255, 255, 255))
    draw = ImageDraw.Draw(out)
    for k, ((name, _), image) in enumerate(zip(states, images, strict=True)):
        x = GAP + (k % columns) * (size + GAP)
        y = GAP + (k // columns) * (height + TEXT + 2 * GAP)
        out.paste(image, (x + (size - image.width) // 2, y + height - image.height))
        draw.text((x + size / 2, y + height + TEXT / 2), name, "#3c4a54", anchor="mm", font_size=14)
    return out.quantize(128)


def shot(found, state, radius, size):
    """One state, SMOOTH times as large as it is shown."""
    moved = 0.0 if state is None else found.skin[state]
    surface = Surface(found.rest.vertices + moved, found.rest.faces)
    with Scene() as drawing:
        drawing.mesh(
            poly(surface), surface.vertices, color="#b5c4cf", opacity=0.45, split_sharp_edges=True
        )
        for k, (cord, u) in enumerate(zip(found.cords, found.moved, strict=True)):
            path = cord.path if state is None else cord.path + u[state]
            drawing.tube(path, COLORS[k % len(COLORS)], radius)
        return drawing.shot(VIEW, SMOOTH * size, SMOOTH * size)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--also", nargs="*", default=[], help="states besides the poses")
    parser.add_argument("--out", type=Path, help="in place of the device's own folder")
    asked = parser.parse_args()
    for folder in asked.folders:
        picture(folder, asked.also).save((asked.out or folder) / "picture.png", optimize=True)
