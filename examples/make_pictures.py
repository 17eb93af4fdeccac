"""Write the picture.png of examples: the body with its cords, at rest and in each pose.

    python examples/make_pictures.py examples/organ-pipe examples/character
    python examples/make_pictures.py examples/sheet --also "1*left+1*right"

Folders of devices that `defsense reproduce` built work, too:

    python examples/make_pictures.py reproduced/sheet/four --out examples/sheet
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")  # works without a screen

import numpy as np
import pyvista as pv
from PIL import Image

import defsense_fab as df

MAX_COLUMNS = 5
WIDTH_PX, TITLE_PX = 1100, 14
SMOOTHING = 2  # pictures are drawn this many times larger than they are saved
VIEW_DIRECTION = (0.45, -1.0, 0.55)  # from the body to the camera
BODY_COLOR = "#b5c4cf"
CORD_COLORS = ("#d1495b", "#00798c", "#edae49", "#66a182", "#8d5a97", "#2e4057")


def list_states(simulation, further):
    """Return (title, index of the state) of rest (None), of each pose, and of further states."""
    states = [("at rest", None)]
    for pose in simulation.device.poses:
        amounts = {
            weights[pose]: k
            for k, weights in enumerate(simulation.weights)
            if set(weights) == {pose} and weights[pose] <= 1
        }
        states.append((pose.replace("_", " "), amounts[max(amounts)]))
    for name in further:
        title = name.replace("1*", "").replace("+", " and ")
        states.append((title, simulation.index(name)))
    return states


def draw_device(folder, further=()):
    """Return an image of a device at rest, in its poses and in further states, at one scale."""
    simulation = df.simulate(df.Device.load(folder))
    layout = df.optimize(simulation)
    states = list_states(simulation, further)
    shifts = np.concatenate([simulation.displacements, np.zeros((1, *simulation.nodes.shape))])
    rest = len(shifts) - 1
    columns = min(len(states), MAX_COLUMNS)
    rows = -(-len(states) // columns)

    shapes = simulation.nodes + shifts[[rest if k is None else k for _, k in states]]
    low, high = shapes.min(axis=(0, 1)), shapes.max(axis=(0, 1))
    center, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    size = SMOOTHING * WIDTH_PX // columns
    plotter = pv.Plotter(
        off_screen=True,
        shape=(rows, columns),
        border=False,
        window_size=(columns * size, rows * size),
    )
    tetrahedra = {pv.CellType.TETRA: simulation.cells[:, :4]}
    for panel, ((title, state), nodes) in enumerate(zip(states, shapes, strict=True)):
        plotter.subplot(*divmod(panel, columns))
        body = pv.UnstructuredGrid(tetrahedra, nodes).extract_surface(algorithm="dataset_surface")
        plotter.add_mesh(body, color=BODY_COLOR, opacity=0.45, split_sharp_edges=True)
        for k, cord in enumerate(layout.cords):
            points = cord.points if state is None else simulation.displaced(cord.points)[state]
            tube = pv.lines_from_points(points).tube(radius=cord.cord_diameter / 2)
            plotter.add_mesh(tube, color=CORD_COLORS[k % len(CORD_COLORS)])
        plotter.add_text(
            title, position="lower_edge", font_size=SMOOTHING * TITLE_PX // 2, color="#3c4a54"
        )
        plotter.camera.focal_point = center
        plotter.camera.position = center + 4 * radius * np.array(VIEW_DIRECTION)
        plotter.camera.up = (0, 0, 1)
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = radius
        plotter.reset_camera_clipping_range()
    image = Image.fromarray(plotter.screenshot(return_img=True))
    plotter.close()
    size = (image.width // SMOOTHING, image.height // SMOOTHING)
    return image.resize(size, Image.Resampling.LANCZOS).quantize(128)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+", help="folders of devices")
    parser.add_argument("--also", nargs="*", default=[], help="names of states besides the poses")
    parser.add_argument("--out", type=Path, help="folder of the picture, if not the device's own")
    options = parser.parse_args()
    for folder in options.folders:
        target = (options.out or folder) / "picture.png"
        draw_device(folder, options.also).save(target, optimize=True)
