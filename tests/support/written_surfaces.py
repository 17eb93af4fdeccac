"""Read the surfaces in written files by the places of their corners, as slicers do."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

Triangles = np.ndarray[Any, Any]


def read_triangles(path: Path) -> dict[str, Triangles]:
    """Return the corners (m, 3, 3) of each surface in an STL or 3MF file, in single precision."""
    if path.suffix == ".stl":
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("tag", "<u2")])
        return {path.stem: np.frombuffer(path.read_bytes()[84:], record)["corners"]}
    text = zipfile.ZipFile(path).read("3D/3dmodel.model").decode()
    out = {}
    for name, mesh in re.findall(
        r'<object [^>]*?name="([^"]*)"[^>]*>\s*<mesh>(.*?)</mesh>', text, re.S
    ):
        places = re.findall(r'<vertex x="([^"]*)" y="([^"]*)" z="([^"]*)"', mesh)
        corners = re.findall(r'<triangle v1="(\d+)" v2="(\d+)" v3="(\d+)"', mesh)
        out[name] = np.array(places, float).astype("<f4")[np.array(corners, int)]
    return out


def count_faults(triangles: Triangles) -> tuple[int, int]:
    """Return how many triangles have two corners in one place, and how many directed edges lack
    exactly one opposite edge.
    """
    _, index = np.unique(triangles.reshape(-1, 3) + np.float32(0), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1).sum()
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    directed, counts = np.unique(edges, axis=0, return_counts=True)
    opposite = np.unique(edges[:, ::-1], axis=0)
    unmatched = len(directed) != len(opposite) or (directed != opposite).any()
    return int(degenerate), int((counts != 1).sum()) + int(unmatched)
