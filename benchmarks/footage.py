"""Detect tags in real pictures and a board in real videos; compare with plain OpenCV.

    python -m benchmarks.footage FOLDER

FOLDER contains `webcam_tags/*.png` (pictures of 4X4_50 tags), and `apriltag/*.jpg` of 36h11 tags
with their corners in a `.txt` of the same name (number, then four times x y, px).
`charuco_two_cameras/` contains two videos, the board in `charuco.toml`, and the cameras that
another program calibrated in `camera_array.toml` (meters).
"""

from __future__ import annotations

import re
import sys
import tempfile
import tomllib
from pathlib import Path

import cv2
import numpy as np

from defsense_fab.capture.cameras.rig_file import read_rig
from defsense_fab.capture.tags.detection import Detector
from defsense_fab.capture.tags.tag_patterns import Dictionary, dictionary
from defsense_fab.cli.main import main as defsense
from defsense_fab.core.arrays import Float
from defsense_fab.core.camera import Camera


def both(path: Path, family: Dictionary) -> tuple[list[Float], list[Float]]:
    """Return corners (4, 2) px of the tags in a picture, by our detector and by plain OpenCV."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    size = (image.shape[1], image.shape[0])
    K = np.array([[float(size[0]), 0, size[0] / 2], [0, float(size[0]), size[1] / 2], [0, 0, 1]])
    camera = Camera("camera", size, K, np.zeros(5), np.eye(3), np.zeros(3))
    plain = cv2.aruco.ArucoDetector(family.table, cv2.aruco.DetectorParameters())
    quads = plain.detectMarkers(image)[0]
    return list(Detector(camera, family).find(image).corners), [q[0].astype(float) for q in quads]


def webcam_tags(folder: Path) -> None:
    paths = sorted(folder.glob("*.png"))
    detections = np.array([[len(f) > 0 for f in both(p, dictionary("4X4_50"))] for p in paths])
    sys.stdout.write(
        f"{folder.name}: of {len(paths)} pictures a tag is found in {detections[:, 0].sum()},"
        f" by OpenCV in {detections[:, 1].sum()}\n"
    )


def apriltag(folder: Path) -> None:
    for path in sorted(folder.glob("*.jpg")):
        lines = path.with_suffix(".txt").read_text().splitlines()
        marked = [
            np.array(re.findall(r"\((\S+) (\S+)\)", line), float) for line in lines if "(" in line
        ]
        marked_found = []
        for corners in both(path, dictionary("APRILTAG_36H11")):
            distance = [
                min(float(np.abs(np.roll(m, k, axis=0)[::s] - c).max())
                    for k in range(4) for s in (1, -1))
                for c in corners
                for m in [min(marked, key=lambda m: float(np.linalg.norm(m.mean(0) - c.mean(0))))]
            ]  # fmt: skip
            marked_found.append(
                f"{len(distance)} (corners within {np.median(distance):.1f} px of those by hand)"
            )
        sys.stdout.write(
            f"{path.name}: of {len(marked)} tags marked by hand {marked_found[0]},"
            f" by OpenCV {marked_found[1]}\n"
        )


def board(folder: Path) -> None:
    truth = tomllib.loads((folder / "charuco.toml").read_text())
    other = tomllib.loads((folder / "camera_array.toml").read_text())["cameras"]
    side = 10 * truth["square_size_override_cm"]
    with tempfile.TemporaryDirectory() as temporary:
        out = ["--board", temporary, "--calibration", f"{temporary}/cameras.toml"]
        videos = [str(folder / f"cam_{k}.mkv") for k in other]
        defsense(
            ["capture", "board", temporary, "--columns", str(truth["columns"]), "--rows",
             str(truth["rows"]), "--square", str(side), "--marker",
             str(side * truth["aruco_scale"]), "--dictionary",
             truth["dictionary"].removeprefix("DICT_")]
            + ["--inverted"] * truth["inverted"]
        )  # fmt: skip
        if defsense(["capture", "camera", "calibrate", *videos, *out]) or defsense(
            ["capture", "camera", "arrange", *videos, *out]
        ):
            raise SystemExit(1)
        rig = read_rig(Path(temporary) / "cameras.toml")
    placed = []
    for camera, (name, c) in zip(rig.cameras, other.items(), strict=True):
        K = np.array(c["matrix"])
        ratio = camera.focal / K[[0, 1], [0, 1]] - 1
        sys.stdout.write(f"camera {name}: focal lengths {ratio[0]:+.2%}, {ratio[1]:+.2%}\n")
        placed.append((np.array(c["rotation"]), 1e3 * np.array(c["translation"])))
    (R0, t0), (R1, t1) = placed
    theirs = R1 @ R0.T, t1 - R1 @ R0.T @ t0
    a, b = rig.cameras
    mine = b.rotation @ a.rotation.T, b.translation - b.rotation @ a.rotation.T @ a.translation
    angle = np.degrees(np.linalg.norm(cv2.Rodrigues(mine[0] @ theirs[0].T)[0]))
    lengths = [float(np.linalg.norm(t)) for _, t in (mine, theirs)]
    sys.stdout.write(
        f"cameras {lengths[0]:.1f} mm apart, {lengths[1]:.1f} by the other program; turned to each"
        f" other {angle:.2f} degrees otherwise than there\n"
    )


def main() -> None:
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        raise SystemExit(__doc__)
    folder = Path(sys.argv[1])
    webcam_tags(folder / "webcam_tags")
    apriltag(folder / "apriltag")
    board(folder / "charuco_two_cameras")


if __name__ == "__main__":
    main()
