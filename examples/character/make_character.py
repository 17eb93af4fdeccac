"""Write character.stl: a standing figure in mm with arms and legs apart, a closed surface.

The surface is the level set of a smooth minimum of capsules: round limbs that blend into each
other. The figure looks towards low y, and its left arm is at high x. Run it again with:

    python make_character.py
"""

from pathlib import Path

import numpy as np
import trimesh

#: Ends (mm) and radii of trunk, neck, head; of an arm, a leg and a foot at high x.
MIDDLE = [
    ((0, 0, 70), (0, 0, 96), 21, 19),
    ((0, 0, 104), (0, 0, 118), 11, 10),
    ((0, 0, 134), (0, -2, 139), 17, 15),
]
SIDE = [
    ((14, 0, 101), (74, 0, 92), 11, 9.5),
    ((14, 0, 60), (31, 0, 14), 14, 11.5),
    ((31, 4, 10), (33, -15, 10), 11, 10),
]
BLEND = 2.5  # mm
CELL = 2.2  # mm


def distance(points):
    """Return approximate distances (k,) of points (k, 3) from the figure, negative inside."""
    each = []
    mirrored = points * [-1, 1, 1]
    for p, limbs in ((points, MIDDLE + SIDE), (mirrored, SIDE)):
        for start, end, thick, thin in limbs:
            a, b = np.array(start, float), np.array(end, float)
            t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            closest = a + t[:, None] * (b - a)
            each.append(np.linalg.norm(p - closest, axis=1) - (thick + t * (thin - thick)))
    each = np.array(each)
    smallest = each.min(0)
    return smallest - BLEND * np.log(np.exp(-(each - smallest) / BLEND).sum(0))


def character():
    """Return vertices and faces."""
    import pyvista as pv

    low, high = np.array([-90, -32, -6]), np.array([90, 28, 164])
    counts = np.ceil((high - low) / CELL).astype(int) + 1
    grid = pv.ImageData(dimensions=counts, spacing=[CELL] * 3, origin=low)
    # Soles: cut off the part below z = 0, so that the figure stands upright.
    points = np.asarray(grid.points)
    value = np.maximum(distance(points), -points[:, 2])
    surface = grid.contour([0.0], scalars=value, method="marching_cubes").clean()
    surface = surface.triangulate().smooth_taubin(n_iter=20, pass_band=0.1)
    return np.asarray(surface.points), np.asarray(surface.faces).reshape(-1, 4)[:, 1:]


if __name__ == "__main__":
    mesh = trimesh.Trimesh(*character(), process=False)
    if mesh.volume < 0:
        mesh.invert()
    mesh.export(Path(__file__).with_name("character.stl"))
