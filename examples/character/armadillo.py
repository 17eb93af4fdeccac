"""Create a device of an armadillo-like figure from a file.

    python examples/character/armadillo.py Armadillo.ply my-armadillo
    defsense build my-armadillo

The Armadillo is available from the Stanford 3D Scanning Repository. Any figure with arms and
legs in a PLY, STL, OBJ or OFF file works if its height is along y or z and its arms are along x. It
is scaled to a height of 150 mm. Hands, feet and trunk are located relative to the bounding box.
"""

import argparse
import shutil
from pathlib import Path

import numpy as np
import trimesh

HEIGHT = 150.0  # mm
#: Of the half width, from which on there are hands; of the height, the feet, and the trunk.
HANDS, FEET, TRUNK = 0.78, 0.08, (0.42, 0.66)
ARM, LEG = 35, 30  # degrees

TEXT = """schema = 1
name = "{name}"

[body]
mesh = "{file}"
scale = {scale:.5g}

[material]
name = "ninjaflex-85a"

[mesh]
edge_length = 7.0

[regions]
{regions}
{poses}
[states]
ramp = [0.5, 1.0]

[outputs]
markers = 60
anchor = "trunk"

[cord]
name = "rubber-2mm"
noise = 0.002

[fabrication]
process = "fdm-tpu"

[design]
sensors = 4
decoder = "affine"
"""


def regions(points, up):
    """Return boxes by name for points (n, 3) mm."""
    low, high = points.min(0), points.max(0)
    tall, middle = high[up] - low[up], (low[0] + high[0]) / 2
    half = (high[0] - low[0]) / 2

    def box(x, heights):
        a, b = low - 1, high + 1
        a[0], b[0] = middle + half * np.array(x)
        a[up], b[up] = low[up] + tall * np.array(heights)
        return np.round(a, 1).tolist(), np.round(b, 1).tolist()

    return {
        "trunk": box((-0.2, 0.2), TRUNK),
        "left_hand": box((HANDS, 1.1), (0.4, 1.1)),
        "right_hand": box((-1.1, -HANDS), (0.4, 1.1)),
        "left_foot": box((0, 1.1), (-0.1, FEET)),
        "right_foot": box((-1.1, 0), (-0.1, FEET)),
    }


def poses(up):
    """Return movements of arms and legs in the figure's plane and out of it."""
    side = np.eye(3, dtype=int)[0].tolist()
    upright = np.eye(3, dtype=int)[up].tolist()
    depth = np.cross(side, upright).tolist()  # the axis of turns in the figure's plane
    return [
        ("left_arm_up", "left_hand", depth, ARM),
        ("right_arm_out", "right_hand", upright, ARM),
        ("left_leg_out", "left_foot", depth, LEG),
        ("right_leg_out", "right_foot", side, LEG),
    ]


def main():
    """Write the device."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path)
    parser.add_argument("folder", type=Path)
    options = parser.parse_args()
    if options.file.suffix.lower() not in (".ply", ".stl", ".obj", ".off"):
        parser.error(f"{options.file}: give a PLY, STL, OBJ or OFF file")
    points = np.asarray(trimesh.load_mesh(options.file).vertices)
    size = np.ptp(points, axis=0)
    up = 1 + int(size[2] > size[1])
    scale = HEIGHT / size[up]
    places = "\n".join(
        f"{name} = {{ box = [{a}, {b}] }}" for name, (a, b) in regions(scale * points, up).items()
    )
    moves = "\n".join(
        f'[[poses]]\nname = "{name}"\nfixed = ["trunk"]\n[[poses.handles]]\nregion = "{region}"\n'
        f'rotate = {{ axis = {axis}, degrees = {degrees} }}\ntranslate = "free"\n'
        for name, region, axis, degrees in poses(up)
    )
    options.folder.mkdir(parents=True)
    shutil.copy(options.file, options.folder / options.file.name)
    (options.folder / "device.toml").write_text(
        TEXT.format(
            name=options.folder.name,
            file=options.file.name,
            scale=scale,
            regions=places,
            poses="\n" + moves,
        )
    )
    print(f"{options.folder / 'device.toml'}: a body {HEIGHT:g} mm tall; next: defsense build")


if __name__ == "__main__":
    main()
