"""Render the pictures of the pages on making devices.

    python docs/making/make_pictures.py FOLDER [NAME...]

FOLDER is a folder for the devices and parts that the pictures show; missing ones are made first.
"""

from __future__ import annotations

import base64
import os
import re
import shutil
import subprocess
import sys
from io import BytesIO
from pathlib import Path

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")  # works without a screen

import numpy as np
import pyvista as pv
import trimesh
from picture_devices import FIXTURES, MADE, defsense
from PIL import Image

import defsense_fab as df
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.repair.mesh_repair import repair_mesh
from defsense_fab.report.guide.drawing import Drawing
from defsense_fab.report.guide.templates import cord_line
from defsense_fab.report.pictures.scene import Scene, poly
from defsense_fab.report.pictures.sheet import Sheet
from defsense_fab.report.pictures.views import looking
from defsense_fab.store.build import Build

HERE = Path(__file__).parent
UP = np.array([0.0, 0.0, 1.0])
UNTURNED = np.eye(3)
PART, OTHER, CUP = "#e58b98", "#4c9aa8", "#9fb0ba"
CORD, WIRE, FERRULE, PIN, TRACE = "#161616", "#c1121f", "#c9a227", "#3a86ff", "#3b4a54"
REGION_MM = 15.01  # depth of the regions base and tip
RAIL_MM = 3.0  # height of a jig's rails above its surface
CHECK_PORT = 8124
WAIT_MS = 300_000


def read(path):
    """Return the surface of a mesh file."""
    mesh = trimesh.load_mesh(path)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def move(surface, shift, rotation=UNTURNED):
    """Return a surface, rotated about the origin and then shifted."""
    return Surface(surface.vertices @ rotation.T + shift, surface.faces)


def turn(axis, degrees):
    """Return the rotation matrix about an axis."""
    return trimesh.transformations.rotation_matrix(np.radians(degrees), axis)[:3, :3]


def save(image, name, colors=160):
    """Save an image as a PNG with few colors."""
    image.convert("RGB").quantize(colors, dither=Image.Dither.NONE).save(
        HERE / f"{name}.png", optimize=True
    )


def decode(uri):
    """Return the image of a data URI."""
    return Image.open(BytesIO(base64.b64decode(uri.partition("base64,")[2])))


def save_drawing(drawing, name):
    """Save a labeled drawing."""
    save(decode(drawing.png()), name)


def draw_cord(drawing, device, build, cord):
    """Add a cord with its ferrules and wires, and return the middles of its ferrules."""
    line = cord_line(build.layout, cord)
    length = device.cord.ferrule_length
    middles = [line.ferrule(end, length) for end in (0, 1)]
    inner = [e.pocket - length / 2 for e in cord.ends]
    points = line.along(inner[0], cord.channel_length - inner[1])
    drawing.rod(points, device.cord.diameter / 2, CORD)
    for end, middle in enumerate(middles):
        radius = device.cord.ferrule_diameter / 2
        drawing.cylinder(middle, line.way_out(end), radius, length, FERRULE)
        wire = cord.ends[end].wire
        if len(wire.path):
            drawing.rod(np.asarray(wire.path), device.fabrication.wire_diameter / 2, WIRE)
    return middles


def opened(folder):
    """Draw the joystick with its joint open."""
    device, build = load_device(folder / "my-joystick"), Build(folder / "my-joystick/build")
    manifest = build.manifest
    names = [p.name for p in manifest.parts]
    opens = np.asarray(manifest.assembly[0].opens)
    lower, upper = names if build.parts[names[1]].vertices.mean(0) @ opens > 0 else names[::-1]
    view = looking(np.array([-0.5, 0, 0.0]) + 0.75 * opens + 0.1 * UP, np.array([1.0, 0, 0]))
    drawing = Drawing(view)
    side = np.cross(opens, UP)
    drawing.part(build.parts[lower], PART)
    # The other part is turned over, so that both cut faces are visible.
    across = np.ptp(build.parts[lower].vertices @ side)
    rotation = turn(UP, 180)
    shift = 1.6 * across * side
    plane = np.asarray(manifest.assembly[0].pins[0].center)
    drawing.part(move(build.parts[upper], plane + shift - rotation @ plane, rotation), OTHER)
    cord = manifest.cords[0]
    middles = draw_cord(drawing, device, build, cord)
    for pin in manifest.assembly[0].pins:
        kind = next(p for p in manifest.pins if p.name == pin.name)
        drawing.cylinder(np.asarray(pin.center), opens, kind.diameter / 2, kind.length, PIN)
    drawing.label(np.asarray(manifest.assembly[0].pins[0].center) + 2 * opens, "pin")
    drawing.label(middles[0], "ferrule in its pocket")
    line = cord_line(build.layout, cord)
    drawing.label(line.along(0, 60)[-1], "cord in its groove")
    other = cord_line(build.layout, manifest.cords[1])
    drawing.label(other.along(0, 40)[-1], "groove without its cord")
    wire = np.asarray(cord.ends[1].wire.path)
    drawing.label(wire[-1], "wire, leaves through a bend")
    save_drawing(drawing, "opened")


def from_guide(folder, start, name, device="my-joystick"):
    """Save the picture of a device's assembly guide whose text starts with some words."""
    page = (folder / device / "build/guide.html").read_text(encoding="utf-8")
    for tag in re.findall(r'<img[^>]*src="data:image/png[^>]*>', page):
        if f'alt="{start}' in tag:
            save(decode(re.search(r'src="([^"]*)"', tag)[1]), name)
            return
    raise ValueError(f"no picture: {start}")


def exploded(folder):
    """Save the guide's exploded view of the bar."""
    from_guide(folder, "exploded", "exploded", "my-bar")


def pins(folder):
    """Save the guide's picture of the pins of a joint."""
    from_guide(folder, "Put ", "pins")


def insert(folder):
    """Save the guide's picture of the cords that are inserted."""
    from_guide(folder, "Insert cord", "insert")


def closing(folder):
    """Save the guide's picture of a joint that is closed, with its red lines."""
    from_guide(folder, "Close the joint without glue", "closing")


def plate(folder):
    """Draw the plate of the joystick on its bed."""
    device, build = load_device(folder / "my-joystick"), Build(folder / "my-joystick/build")
    parts = folder / "my-joystick/build/parts/print"
    bed = device.fabrication.bed
    with Scene() as scene:
        slab = trimesh.creation.box((bed[0], bed[1], 2.0))
        slab.apply_translation((bed[0] / 2, bed[1] / 2, -1.01))
        scene.solid(Surface(slab.vertices, slab.faces), "#dfe5e8")
        for step in range(20, int(bed[0]), 20):
            for line in ([[step, 0, 0], [step, bed[1], 0]], [[0, step, 0], [bed[0], step, 0]]):
                scene.line(np.array(line, float), "#b9c3ca", 1.0)
        for name, bounds in build.manifest.plates[0].parts.items():
            piece = read(parts / f"{re.sub(r'_[0-9]+$', '', name)}.stl")
            low, high = np.asarray(bounds, float)
            size = np.ptp(piece.vertices, axis=0)
            if np.abs(size - (high - low)).max() > 0.1:
                piece = move(piece, 0.0, turn(UP, 90))
            color = PIN if name.startswith("pin") else PART
            scene.solid(move(piece, low - piece.vertices.min(0)), color)
        view = looking(np.array([-0.35, -1.0, 0.9]), UP)
        save(Image.fromarray(scene.shot(view, 760, 520).image), "plate")


def mould(folder):
    """Draw a part of the silicone joystick and the pieces of its mould, apart."""
    build = Build(folder / "my-cast/build")
    record = build.manifest.moulds[0]
    parts = folder / "my-cast/build/parts"
    view = looking(np.array([-0.8, -0.9, 0.55]), UP)
    up = np.asarray(record.up, float)
    view = looking(0.55 * up + np.cross(up, UP) * 0.9 - 0.25 * UP, up)
    drawing = Drawing(view)
    drawing.part(build.parts[record.part], PART, name=record.part)
    drawing.label(record.part, "the part, of silicone")
    for piece in record.pieces:
        opens = np.asarray(piece.opens, float)
        surface = read(parts / piece.stl)
        reach = np.ptp(surface.vertices @ opens) + 12
        is_lid = "lid" in piece.name
        drawing.part(surface, CUP if is_lid else OTHER, reach * opens, piece.name)
        drawing.label(piece.name, "lid: forms the joint face" if is_lid else "cup: forms the skin")
    save_drawing(drawing, "mould")


def bay(folder):
    """Draw a bar with a bay, with its cords and wires."""
    device, build = load_device(folder / "my-bay"), Build(folder / "my-bay/build")
    surface = load_body(device.body).surface
    view = looking(np.array([-0.55, -1.0, 1.0]), UP)
    drawing = Drawing(view)
    drawing.shapes.append(lambda scene: scene.outline(surface, opacity=0.22))
    for cord in build.manifest.cords:
        middles = draw_cord(drawing, device, build, cord)
    drawing.label(np.array([4.0, 0, 3]), "bay")
    drawing.label(middles[1], "ferrule")
    points = build.layout.sensors[-1].points
    drawing.label(points[len(points) // 2], "cord")
    wire = max((np.asarray(c.ends[1].wire.path) for c in build.manifest.cords), key=len)
    drawing.label(wire[len(wire) // 2], "wire")
    save_drawing(drawing, "bay")


def bend(surface, radius):
    """Return a straight bar along x, bent over a cylinder of a radius below it, mm."""
    x, y, z = surface.vertices.T
    angle = x / (radius + np.ptp(z) / 2)
    reach = radius + z - z.min()
    points = np.stack([reach * np.sin(angle), y, reach * np.cos(angle) - radius], axis=1)
    return Surface(points, surface.faces)


def specimen(folder):
    """Draw the bending specimen on a jig, and one of its halves."""
    out = folder / "my-specimen"
    radius, (length, width, thickness), offset = 100.0, (150.0, 20.0, 15.0), 2.0
    half = read(out / "specimen-left.stl")
    block = read(out / f"jig-{radius:g}.stl")
    block = move(block, 0.0, turn([1, 0, 0], -90))
    low, high = block.vertices.min(0), block.vertices.max(0)
    block = move(block, -np.append((low + high)[:2] / 2, high[2] - RAIL_MM))
    ends = np.linspace(-length / 2, length / 2, 61)
    bar = trimesh.creation.box((length, width, thickness))
    bar = trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(bar.vertices, bar.faces, 4.0))
    bar = bend(Surface(np.asarray(bar.vertices), np.asarray(bar.faces)), radius)
    neutral = radius + thickness / 2
    drawing = Drawing(looking(np.array([-0.45, -1.0, 0.6]), UP))
    drawing.part(block, CUP, name="jig")
    drawing.shapes.append(lambda scene: scene.solid(bar, "#f0b3bb", 0.55, edges=False))
    names = {offset - thickness / 2: "bottom cord", 0.0: "neutral cord",
             thickness / 2 - offset: "top cord"}  # fmt: skip
    for height, name in names.items():
        angles = ends / neutral
        line = np.stack([(neutral + height) * np.sin(angles), 0 * angles,
                         (neutral + height) * np.cos(angles) - radius], axis=1)  # fmt: skip
        drawing.rod(line, 1.0, CORD)
        drawing.label(line[0], name)
    corner = np.array([low[0] - (low + high)[0] / 2, -width / 2 - 60, low[2] - high[2]])
    drawing.part(move(half, corner - half.vertices.min(0)), PART, name="half")
    drawing.label("half", "half of the specimen, open")
    drawing.label("jig", "jig")
    save_drawing(drawing, "specimen")


def response(folder):
    """Save the picture of the response in the page of a fit."""
    page = (folder / "my-response/response.html").read_text(encoding="utf-8")
    save(decode(re.search(r'src="(data:image/png[^"]*)"', page)[1]), "response")


def coupon(folder):
    """Draw the fit coupon: a plate and the peg."""
    pieces = [read(p) for p in sorted((folder / "my-coupon").glob("*.stl"))]
    pieces.sort(key=lambda s: -np.ptp(s.vertices[:, 0]))
    with Scene() as scene:
        scene.solid(pieces[0], PART)
        peg = pieces[1]
        corner = pieces[0].vertices.max(0) * [1, 0, 0] + [8, 5, 0]
        scene.solid(move(peg, corner - peg.vertices.min(0)), PIN)
        view = looking(np.array([-0.25, -1.0, 1.1]), UP)
        save(Image.fromarray(scene.shot(view, 760, 420).image), "coupon")


def trace_coupon(folder):
    """Draw the coupon of printed traces, with a transparent body."""
    stls = sorted((folder / "my-traces").rglob("*.stl"))
    bodies = sorted((read(p) for p in stls), key=lambda s: -np.ptp(s.vertices, axis=0).prod())
    with Scene() as scene:
        scene.solid(bodies[0], "#c9d3d8", opacity=0.45)
        for trace in bodies[1:]:
            scene.solid(trace, TRACE, edges=False)
        view = looking(np.array([-0.3, -1.0, 1.2]), UP)
        save(Image.fromarray(scene.shot(view, 760, 480).image), "trace-coupon")


def poses(folder):
    """Draw the four poses of a new bar next to each other."""
    simulation = df.simulate(df.Device.load(folder / "my-poses"))
    shapes = {"rest": simulation.nodes}
    for pose in simulation.device.poses:
        states = {w[pose]: k for k, w in enumerate(simulation.weights) if set(w) == {pose}}
        k = states[max(a for a in states if a <= 1)]
        shapes[pose] = simulation.nodes + simulation.displacements[k]
    low, high = (f([f(n, axis=0) for n in shapes.values()], axis=0) for f in (np.min, np.max))
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    cells = {pv.CellType.TETRA: simulation.cells[:, :4]}
    view = looking(np.array([-0.3, -1.0, 0.75]), UP)
    shots = []
    for name, nodes in shapes.items():
        skin = pv.UnstructuredGrid(cells, nodes).extract_surface(algorithm="dataset_surface")
        skin = skin.triangulate()
        surface = Surface(np.asarray(skin.points), skin.faces.reshape(-1, 4)[:, 1:])
        with Scene() as scene:
            ends = simulation.nodes[:, 0]
            low, high = ends.min() + REGION_MM, ends.max() - REGION_MM
            scene.solid(surface, "#d5dde2")
            for end, color in ((ends < low, "#8fa3b0"), (ends > high, "#e9a13b")):
                chosen = np.asarray(end)[np.asarray(skin["vtkOriginalPointIds"])]
                faces = surface.faces[chosen[surface.faces].all(1)]
                patch = poly(Surface(surface.vertices, faces))
                scene.mesh(patch, surface.vertices[np.unique(faces)], color=color)
            for corner in corners:  # all pictures have one scale
                scene.line(np.stack([corner, corner + 1e-3]), "#ffffff", 1.0)
            shots.append((name, scene.shot(view, 300, 220)))
    columns, width, height = 3, 300, 250
    sheet = Sheet(columns * width, 2 * height)
    for k, (name, shot) in enumerate(shots):
        left, top = k % columns * width, k // columns * height
        w, h = shot.size
        sheet.paste(shot.image, (left + (width - w) // 2, top + (height - 30 - h) // 2))
        sheet.text((left + width / 2, top + height - 16), name, 20, anchor="mm")
    save(Image.open(BytesIO(sheet.png())), "poses")


def repair(folder):
    """Draw a mesh with defects, and the repaired mesh."""
    blob = read(FIXTURES / "blob" / "blob.stl")
    vertices, faces = blob.vertices, blob.faces
    view = looking(np.array([0.55, -1.0, 0.6]), UP)
    size = np.ptp(vertices, axis=0).max()
    front = vertices[np.argmax(vertices @ view.back)]
    centers = vertices[faces].mean(1)
    is_hole = np.linalg.norm(centers - front, axis=1) < 0.035 * size
    ball = trimesh.creation.icosphere(3, 0.02 * size)
    away = vertices[np.argmax(vertices @ (view.up + view.right))]
    ball.apply_translation(away + 0.05 * size * (view.up + view.right))
    broken = Surface(
        np.concatenate([vertices, ball.vertices]),
        np.concatenate([faces[~is_hole], ball.faces + len(vertices)]),
    )
    fixed = Surface(*repair_mesh(broken.vertices, broken.faces, "blob.stl")[:2])
    shots = []
    for surface, title in ((broken, "as it was in the file"), (fixed, "repaired")):
        with Scene() as scene:
            mesh = poly(surface)
            scene.mesh(mesh, surface.vertices, color="#b5c4cf", split_sharp_edges=False)
            edges = mesh.extract_feature_edges(
                boundary_edges=True, feature_edges=False, manifold_edges=False
            )
            if edges.n_cells:
                points = np.asarray(edges.points)
                scene.mesh(edges, points, color=WIRE, line_width=5, lighting=False)
            corners = broken.vertices
            scene.line(np.array([corners.max(0)] * 2), "#ffffff", 1.0)
            shots.append((title, scene.shot(view, 430, 330)))
    height = 260
    sheet = Sheet(900, height + 40)
    for k, (title, shot) in enumerate(shots):
        w, h = shot.size
        corner = np.array([450 * k + (450 - w) // 2, height - h])
        sheet.paste(shot.image, corner)
        sheet.text((450 * k + 225, height + 22), title, 20, anchor="mm")
        if k == 0:
            names = {"separate piece": ball.vertices.mean(0), "hole": front}
            for name, (x, y) in zip(
                names, shot.pixel(np.stack(list(names.values()))) + corner, strict=True
            ):
                is_hole = name == "hole"
                place = (x - 26, y) if is_hole else (x + 10, y - 24)
                sheet.text(place, name, 18, WIRE, "rm")
    save(Image.open(BytesIO(sheet.png())), "repair")
    del folder


def character(folder):
    """Draw the character, whose cords a build proposes."""
    surface = load_body(load_device(FIXTURES / "character").body).surface
    view = looking(np.array([0.35, -1.0, 0.3]), UP)
    with Scene() as scene:
        scene.solid(surface, "#9db2bf", edges=False)
        image = Image.fromarray(scene.shot(view, 1100, 620).image)
    image.thumbnail((450, 210), Image.Resampling.LANCZOS)
    page = Image.new("RGB", (480, 240), "white")
    page.paste(image, ((480 - image.width) // 2, (240 - image.height) // 2))
    save(page, "character", 64)
    del folder


def check(folder):
    """Take the page of the wiring check, with a twin that has a fault."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    switches = ["--no-sandbox"] if os.geteuid() == 0 else []
    words = ("my-joystick", "--port", "twin:speed=2,loose=A*400", "--auto")
    command = defsense("board", "check", *words, "--view", str(CHECK_PORT))
    with (
        subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, text=True,
                         stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as running,
        sync_playwright() as playwright,
    ):  # fmt: skip
        while str(CHECK_PORT) not in (line := running.stderr.readline()):
            if not line:
                sys.exit("the check showed no page")
        browser = playwright.chromium.launch(executable_path=chromium, args=switches)
        page = browser.new_page(viewport={"width": 900, "height": 330})
        page.goto(f"http://localhost:{CHECK_PORT}", timeout=WAIT_MS)
        page.get_by_text("Wiggle").first.wait_for(timeout=WAIT_MS)
        page.wait_for_timeout(1000)
        save(Image.open(BytesIO(page.screenshot())), "check", 128)
        browser.close()
        running.terminate()


PICTURES = {
    f.__name__.replace("_", "-"): f
    for f in (
        opened, exploded, pins, insert, closing, plate, mould, bay, specimen, response, coupon,
        trace_coupon, poses, repair, character, check,
    )
}  # fmt: skip
NEEDS = {
    "exploded": "my-bar", "opened": "my-joystick", "pins": "my-joystick", "insert": "my-joystick",
    "closing": "my-joystick",
    "plate": "my-joystick", "check": "my-joystick", "mould": "my-cast", "bay": "my-bay",
    "specimen": "my-specimen", "coupon": "my-coupon", "trace-coupon": "my-traces",
    "poses": "my-poses", "response": "my-response",
}  # fmt: skip


def main():
    """Make what is missing, and draw the pictures."""
    folder, *names = sys.argv[1:]
    folder = Path(folder).absolute()
    folder.mkdir(exist_ok=True)
    for name in names or PICTURES:
        for result, make in MADE.items():
            if result.split("/")[0] == NEEDS.get(name) and not (folder / result).exists():
                make(folder)
        PICTURES[name](folder)


if __name__ == "__main__":
    main()
